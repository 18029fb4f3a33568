"""Folders of images as people have them: named, renamed, doubled, mixed. Each returns what is right."""

from collections.abc import Callable, Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from random import Random

import cv2
import imagecodecs
import numpy as np
import tifffile

from benchmarks.frame_faults.drawn import PITCH_MM, Frames, Truth, drawn, missing, with_sidecar

Naming = Callable[[int], str]
Write = Callable[[Path, Random], Truth]
_LOSSLESS = (".png", ".tif", ".bmp")


def save(path: Path, frame: Frames, level: int = 3) -> None:
    """Write one image, in the format of the suffix; ``level``: of compression."""
    if path.suffix.lower() in (".tif", ".tiff"):
        tifffile.imwrite(path, frame, photometric="minisblack", compression="zlib" if level > 1 else None)
    elif path.suffix.lower() == ".png":
        path.write_bytes(imagecodecs.png_encode(np.ascontiguousarray(frame), level=level))
    else:
        done, data = cv2.imencode(path.suffix, frame)
        assert done
        path.write_bytes(data.tobytes())


def namings(rng: Random, n: int) -> Mapping[str, Naming]:
    """Return ways to name frames that put them in order beyond doubt, or nearly so."""
    word = rng.choice(("frame", "slice", "IMG", "scan 2", "B-scan", "pullback_2024", "a#1", "s"))
    first, step = rng.choice((0, 1, 7, 98)), rng.choice((1, 1, 1, 2, 5, 10))
    between = rng.choice(("", "_", "-", " ", ".", "__"))
    zero = rng.randint(0, n - 1)
    begun = datetime(2024, rng.randint(1, 12), rng.randint(1, 28), rng.randint(0, 23), 59, 58, 700_000, tzinfo=UTC)
    epoch = int(begun.timestamp() * 1000)
    jitter = [rng.randint(-4, 4) for _ in range(4 * n)]
    return {
        "padded": lambda k: f"{word}{between or '_'}{first + step * k:04d}",
        "counted": lambda k: f"{word}{between or '_'}{first + step * k}",
        "upper and lower": lambda k: (
            f"{word}{'_'}{first + step * k:03d}".upper() if k % 2 else f"{word}_{first + step * k:03d}".lower()
        ),
        "with a constant": lambda k: f"{word}_{first + step * k:03d}_10um",
        "brackets": lambda k: f"{word} ({k + 1})",
        "square brackets": lambda k: f"{word} [{k}]",
        "bare, then brackets": lambda k: f"{word} ({k})" if k else word,
        "millimetres": lambda k: f"z{PITCH_MM * k:.4g}mm",
        "millimetres, comma": lambda k: f"z_{PITCH_MM * k:.4g} mm".replace(".", ","),
        "padded decimals": lambda k: f"z{PITCH_MM * k:.2f}",
        "decimals": lambda k: f"z{PITCH_MM * k:.4g}",
        "decimals with an end": lambda k: f"pos{PITCH_MM * k:.4g}_x",
        "micrometres": lambda k: f"{word}_{1000 * PITCH_MM * k:.0f}um",
        "minus signs": lambda k: f"z{PITCH_MM * (k - zero):.4g}mm",
        "minus signs, counted": lambda k: f"p_{k - zero}",
        "all negative": lambda k: f"z{PITCH_MM * (k - n):.4g}mm",
        "odd places": lambda k: f"z{PITCH_MM * k:.4g}mm",
        "clock": lambda k: (begun + timedelta(milliseconds=40 * k)).strftime("%Y-%m-%d_%H-%M-%S-%f")[:-3],
        "clock, close": lambda k: (begun + timedelta(milliseconds=40 * k)).strftime("cam_%Y%m%d_%H%M%S%f"),
        "milliseconds": lambda k: f"img_{epoch + 40 * k + jitter[k]}",
        "count and time": lambda k: f"f{k:03d}_t{0.04 * k:.3f}",
        "outer number": lambda k: f"run{k // 4}_{k:02d}",
        "section and item": lambda k: f"s1.{k + 1}",
    }


def named(name: str, *, gaps: bool) -> Write:
    """Return what writes a folder named in one way, with frames missing or without."""

    def write(folder: Path, rng: Random) -> Truth:
        truth = drawn(rng)
        naming = namings(rng, len(truth.frames))[name]
        numbers = list(range(len(truth.frames)))
        if name == "odd places":  # as z-stacks with finer steps in between
            odd = sorted({2 * k + rng.choice((0, 0, 1)) for k in numbers} | {0})[: len(numbers)]
            places = PITCH_MM * np.array(odd) / 2
            truth = truth.part(slice(0, len(odd))).at(places)
            _write_all(folder, rng, truth, [f"z{place:.4g}mm" for place in places])
            return truth
        kept = missing(rng, len(numbers)) if gaps else numbers
        part = truth.part(kept)
        _write_all(folder, rng, part, [naming(k) for k in kept])
        return part.at(part.places_mm - part.places_mm[0])

    return write


def _write_all(folder: Path, rng: Random, truth: Truth, names: list[str], suffix: str | None = None) -> None:
    suffix = suffix or rng.choice(_LOSSLESS)
    order = list(range(len(names)))
    rng.shuffle(order)
    for k in order:
        save(folder / f"{names[k]}{suffix}", truth.frames[k])
    with_sidecar(folder, "oct")


def _sound(folder: Path, rng: Random, suffix: str = ".png") -> tuple[Truth, list[str]]:
    truth = drawn(rng)
    ways = namings(rng, len(truth.frames))
    naming = ways[rng.choice(("padded", "counted", "with a constant", "brackets", "millimetres"))]
    names = [naming(k) for k in range(len(truth.frames))]
    _write_all(folder, rng, truth, names, suffix)
    return truth, names


def copied(folder: Path, rng: Random) -> Truth:
    """Copies of some files, as file managers name them."""
    truth, names = _sound(folder, rng, rng.choice(_LOSSLESS))
    suffix = next(path.suffix for path in folder.iterdir() if path.suffix in _LOSSLESS)
    marks = ("{} (1)", "{} - Copy", "{} copy", "Copy of {}", "{} - Kopie (2)", "{}~", "x{}", "{}_old", "00{}")
    for name in rng.sample(names, rng.randint(1, 3)):
        twin = folder / (rng.choice(marks).format(name) + suffix)
        if not twin.exists():
            twin.write_bytes((folder / f"{name}{suffix}").read_bytes())
    return truth


def in_two_formats(folder: Path, rng: Random) -> Truth:
    """All frames, or some, in a second format."""
    truth, names = _sound(folder, rng)
    some = names if rng.random() < 0.5 else rng.sample(names, rng.randint(1, len(names) - 1))
    suffix = rng.choice((".tif", ".bmp", ".jpg", ".tiff", ".PNG"))
    for k, name in enumerate(names):
        if name in some and not (folder / f"{name}{suffix}").exists():
            save(folder / f"{name}{suffix}", truth.frames[k], 1)
    return truth


def in_two_formats_with_one_changed(folder: Path, rng: Random) -> Truth:
    """All frames in a second format, one of them another image there."""
    truth, names = _sound(folder, rng)
    changed = rng.randrange(len(names))
    for k, name in enumerate(names):
        save(folder / f"{name}.tif", truth.frames[k] if k != changed else 255 - truth.frames[k])
    return truth


def processed(folder: Path, rng: Random) -> Truth:
    """Filtered images among the raw ones."""
    truth, names = _sound(folder, rng)
    mark = rng.choice(("{}_filtered", "filtered_{}", "{}-seg", "{}_2", "{}.mask", "{} edited", "{}_8bit", "A{}"))
    some = names if rng.random() < 0.7 else rng.sample(names, rng.randint(1, len(names) - 1))
    for k, name in enumerate(names):
        if name in some:
            save(folder / (mark.format(name) + ".png"), cv2.GaussianBlur(truth.frames[k], (5, 5), 2))
    return truth


def two_series(folder: Path, rng: Random) -> Truth:
    """Two recordings in one folder."""
    truth, other = drawn(rng), drawn(rng)
    a, b = rng.choice((("run1_{:03d}", "run2_{:03d}"), ("a{}", "b{}"), ("1-{}", "2-{}"), ("s_{}", "s_{}_b")))
    _write_all(folder, rng, truth, [a.format(k) for k in range(len(truth.frames))], ".png")
    for k, frame in enumerate(other.frames):
        save(folder / (b.format(k) + ".png"), frame)
    return truth


def with_others(folder: Path, rng: Random) -> Truth:
    """An image or two that are no frames."""
    truth, _ = _sound(folder, rng)
    for name in rng.sample(("overview", "calibration", "thumb", "mask_1", "screenshot 2024-05-01", "0"), 2):
        save(folder / f"{name}.png", drawn(rng).frames[0])
    return truth


def repeated(folder: Path, rng: Random) -> Truth:
    """One frame written again in place of another, byte for byte or packed otherwise."""
    truth, names = _sound(folder, rng)
    k = rng.randrange(1, len(names))
    save(folder / f"{names[k]}.png", truth.frames[k - 1], rng.choice((3, 9)))
    return truth


def renamed(folder: Path, rng: Random) -> Truth:
    """Some names, or all, replaced by ones that say nothing, or something else."""
    truth, names = _sound(folder, rng)
    for name in names if rng.random() < 0.3 else rng.sample(names, rng.randint(1, 3)):
        other = rng.choice((f"{rng.randrange(1 << 32):08x}", f"new {name}", f"{rng.randrange(100)}", f"{name}b"))
        if not (folder / f"{other}.png").exists():
            (folder / f"{name}.png").rename(folder / f"{other}.png")
    return truth


def numbers_twice(folder: Path, rng: Random) -> Truth:
    """Two images of one number that differ: with zeros before it or without, in other letters."""
    truth, _ = _sound_padded(folder, rng)
    k = rng.randrange(len(truth.frames))
    other = rng.choice((f"slice_{k}", f"slice_{k:06d}", f"SLICE_{k:03d}", f"slice_{k:03d} (1)"))
    save(folder / f"{other}{rng.choice(('.png', '.tif'))}", drawn(rng).frames[0])
    return truth


def two_orders(folder: Path, rng: Random) -> Truth:
    """Two numbers in each name, of which only the second is the order."""
    truth = drawn(rng)
    ids = rng.sample(range(100), len(truth.frames))
    _write_all(folder, rng, truth, [f"id{ids[k]}_{k}" for k in range(len(ids))])
    return truth


def uneven_numbers(folder: Path, rng: Random) -> Truth:
    """Numbers that count nothing evenly, at unknown places."""
    truth = drawn(rng)
    numbers = np.cumsum([rng.choice((1, 2, 3, 7, 20)) for _ in truth.frames])
    if len(set(np.diff(numbers))) > 2:
        truth = truth.at(numbers * PITCH_MM - numbers[0] * PITCH_MM)
    else:
        numbers = np.array([*numbers[:-1], numbers[-1] + 13, numbers[-1] + 20])[: len(truth.frames)]
        truth = truth.at((numbers - numbers[0]) * PITCH_MM)
    _write_all(folder, rng, truth, [f"n{number}" for number in numbers])
    return truth


def decimals_or_sections(folder: Path, rng: Random) -> Truth:
    """Numbers that are places with decimals, or sections and items, which nothing says."""
    truth = drawn(rng, 6, 9)
    places = sorted(
        [1.35, *rng.sample([1.1, 1.2, 1.25, 1.3, 1.4, 1.45, 1.5, 1.6, 1.7, 1.75, 1.8], len(truth.frames) - 1)]
    )
    truth = truth.at(np.array(places) - places[0])
    _write_all(folder, rng, truth, [f"z{place}" for place in places])
    return truth


def _sound_padded(folder: Path, rng: Random) -> tuple[Truth, list[str]]:
    truth = drawn(rng)
    names = [f"slice_{k:03d}" for k in range(len(truth.frames))]
    _write_all(folder, rng, truth, names, ".png")
    return truth, names


_NAMES = tuple(namings(Random(0), 4))
SOUND: Mapping[str, Write] = {
    f"{name}{', gaps' if gaps else ''}": named(name, gaps=gaps)
    for name in _NAMES
    for gaps in (False, True)
    if not (gaps and name in ("odd places", "bare, then brackets"))
}
"""What has to be read rightly, or doubted where names leave it open."""
FAULTS: Mapping[str, Write] = {
    "copies": copied,
    "two formats": in_two_formats,
    "two formats, one changed": in_two_formats_with_one_changed,
    "filtered among raw": processed,
    "two series": two_series,
    "other images": with_others,
    "one repeated": repeated,
    "renamed": renamed,
    "a number twice": numbers_twice,
    "two orders": two_orders,
    "uneven numbers": uneven_numbers,
    "decimals or sections": decimals_or_sections,
}
