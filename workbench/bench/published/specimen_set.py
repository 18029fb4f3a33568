"""A published set on disk: a folder for each specimen, and ``set.json`` that lists them with their digests.

A specimen's folder is laid out as ``endoct simulate`` writes it. The panorama of each recording lies next to it, as
``oct.zarr`` and ``endoscope.zarr``. So methods that begin with a panorama all get the same one, whatever version of
endoct runs them.

A seed gives the same bytes on every x86-64 processor with the same libraries. With other libraries, such as another C
library, a few samples in ten thousand of an OCT recording are rounded the other way. Unrolling makes more of that. So a
set also has means of every frame, of the truth and of the panoramas. Two specimens are alike where these are equal but
for rounding.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from importlib.resources import files
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import plain_name, read_small, sha256_of
from endoct.base.zarr.zarr_store import read_arrays
from endoct.modalities.recognition import open_recording
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import load_panorama
from endoct.workbench.bench.published.definition import Difficulty, Generator, Half, Planned, Size, Split, Stored
from endoct.workbench.dataset.set_files import digest_of

SET_FILE, SPECIMEN_FILE = "set.json", "specimen.json"
FORMAT = "endoct bench set 1"
SIDES = ("oct", "endoscope")
PANORAMAS = tuple(f"{side}.zarr" for side in SIDES)
MOST_SET_BYTES = 16_000_000
ROUNDED = 0.01
"""Means of samples that are equal but for rounding differ by less: 0.0002 of the samples differ by a count."""
ROUNDED_UNROLLED = 0.5
"""Means of panoramas that are unrolled from such recordings differ by less: the largest so far was 0.21."""


class Entry(Stored):
    """What a set says of one specimen.

    ``recorded``: the digest of each of its folders and files, ``oct``, ``truth`` and so on. ``unrolled``: by side, the
    digest of its panorama. ``means``: by side, the mean of each frame, counts. By panorama, the means of intensity and
    of depth in hundredths of a mm, and the percentages that are valid and that have a depth. Of ``truth``, the mean
    depth in hundredths of a mm, the percentage in cells, and the mean of each entry of ``recording.json``.
    """

    name: str
    generator: Generator
    difficulty: Difficulty
    tasks: tuple[str, ...]
    split: Split
    recorded: dict[str, str]
    unrolled: dict[str, str]
    means: dict[str, tuple[float, ...]]

    @property
    def digest(self) -> str:
        """Return the sha256 of all digests."""
        lines = "".join(f"{name} {sha}\n" for part in (self.recorded, self.unrolled) for name, sha in part.items())
        return hashlib.sha256(f"{self.name}\n{lines}".encode()).hexdigest()

    def cases(self, task: str) -> int:
        """Return how many cases of a task it is: of poses by both sides and by each, of masks by each."""
        sides = len(self.unrolled)
        return {"segmentation": sides, "pose": sides + 1 if sides > 1 else 1}.get(task, 1)

    def is_alike(self, other: "Entry") -> bool:
        """Say whether another specimen has the same truth and the same samples, but for rounding."""
        if self.name != other.name:
            return False
        if {part: len(means) for part, means in self.means.items()} != {p: len(m) for p, m in other.means.items()}:
            return False
        return all(
            np.allclose(means, other.means[part], rtol=0, atol=ROUNDED_UNROLLED if part in PANORAMAS else ROUNDED)
            for part, means in self.means.items()
        )


class SpecimenSet(Stored):
    """The content of ``set.json``: which set it is, what it was made with, and its specimens in order.

    ``key``: the sha256 of the key that its seeds follow from. A set that is not finished has no specimens.
    """

    format: str = FORMAT
    set: str
    half: Half
    size: Size
    key: str
    versions: dict[str, str]
    specimens: tuple[Entry, ...]

    @property
    def digest(self) -> str:
        """Return the sha256 of the digests of all specimens."""
        return digest_of_entries(self.specimens)


def digest_of_entries(entries: Sequence[Entry]) -> str:
    """Return the sha256 of the digests of specimens, in order."""
    return hashlib.sha256("".join(entry.digest for entry in entries).encode()).hexdigest()


def shipped_entries(name: str) -> dict[str, Entry]:
    """Return the specimens of a benchmark's public half as they were published, by name; of the small set."""
    path = files(__package__).joinpath(f"{name}.public.json")
    if not path.is_file():
        return {}
    return {specimen.name: specimen for specimen in SpecimenSet.model_validate_json(path.read_text("utf-8")).specimens}


def read_set(folder: Path) -> SpecimenSet:
    """Return what a set's ``set.json`` says. Raises :class:`EndoctError` where the folder is no set."""
    path = folder / SET_FILE
    if not path.is_file():
        raise EndoctError(
            f"{folder} is no set of a published benchmark",
            expected=f"a folder with {SET_FILE}",
            remedy="make one with `endoct bench make`, or download it",
        )
    with refusing(f"{path} is damaged", remedy="make or download the set again"):
        read = SpecimenSet.model_validate_json(read_small(path, MOST_SET_BYTES))
        if read.format != FORMAT:
            raise ValueError(f"its format is {read.format[:40]!r}")
        for entry in read.specimens:
            plain_name(entry.name, f"a specimen of {path}")
    return read


def read_finished_set(folder: Path) -> SpecimenSet:
    """Return what a set's ``set.json`` says. Raises :class:`EndoctError` where specimens are still missing."""
    read = read_set(folder)
    if not read.specimens:
        raise EndoctError(f"the set {folder} is not finished", remedy="start the command again that makes it")
    return read


def check_specimen(folder: Path, entry: Entry) -> None:
    """Compare a specimen with its digests. Raises :class:`EndoctError` where anything of it changed."""
    recorded = recorded_digests(folder / entry.name)
    unrolled = unrolled_digests(panoramas_of(folder / entry.name))
    changed = [name for name in {**entry.recorded, **recorded} if entry.recorded.get(name) != recorded.get(name)]
    changed += [
        f"{side}.zarr" for side in {**entry.unrolled, **unrolled} if entry.unrolled.get(side) != unrolled.get(side)
    ]
    if changed:
        raise EndoctError(
            f"{entry.name} in {folder} is not as it was made",
            found=f"another {', '.join(changed)}",
            remedy="make or download it again",
        )


def entry_of(folder: Path, specimen: Planned) -> Entry:
    """Return the entry of a specimen that was made in ``folder``, with its panoramas."""
    panoramas, kind = panoramas_of(folder), specimen.kind
    means = {f"{side}.zarr": panorama_means(panorama) for side, panorama in panoramas.items()}
    return Entry(
        name=specimen.name,
        generator=kind.generator,
        difficulty=kind.difficulty,
        tasks=kind.tasks,
        split=specimen.split,
        recorded=recorded_digests(folder),
        unrolled=unrolled_digests(panoramas),
        means=frame_means(folder) | means | {"truth": truth_means(folder / "truth")},
    )


def recorded_digests(folder: Path) -> dict[str, str]:
    """Return, for each folder and file of a specimen, the sha256 of the lines of ``sha256sum`` over its files."""
    left_out = {SPECIMEN_FILE, *PANORAMAS}
    files: dict[str, dict[str, tuple[int, str]]] = {}
    for path in sorted(folder.rglob("*")):
        relative = path.relative_to(folder)
        if path.is_file() and relative.parts[0] not in left_out:
            of_part = files.setdefault(relative.parts[0], {})
            of_part[relative.as_posix()] = (path.stat().st_size, sha256_of(path))
    return {name: digest_of(of_part) for name, of_part in files.items()}


def frame_means(folder: Path) -> dict[str, tuple[float, ...]]:
    """Return by side the mean of each frame as recorded, counts, to four decimals."""
    streams = {side: open_recording(folder / side)[1] for side in SIDES if (folder / side).is_dir()}
    return {side: tuple(_mean(stream[k].samples) for k in range(len(stream))) for side, stream in streams.items()}


def panorama_means(panorama: Panorama) -> tuple[float, ...]:
    """Return the means of intensity and of depth where these are known, and the percentages that are."""
    valid = panorama.valid
    means = [_mean(panorama.intensity[valid]), _mean(100 * valid)]
    depths = panorama.depth_mm, panorama.parallax_depth_mm
    for depth_mm in (of for of in depths if of is not None):
        known = valid & np.isfinite(depth_mm)
        if known.any():
            means += [_mean(100 * depth_mm[known]), _mean(100 * known)]
    return tuple(means)


def truth_means(truth: Path) -> tuple[float, ...]:
    """Return the mean depth of the true wall in hundredths of a mm, the percentage in cells, and means of the rest."""
    wall = read_arrays(truth / "wall.zarr", ("relief_mm", "cell"))
    recording = json.loads(read_small(truth / "recording.json", MOST_SET_BYTES))
    return _mean(100 * wall["relief_mm"]), _mean(100 * wall["cell"]), *_means_of(recording)


def _means_of(stated: object) -> Iterator[float]:
    """Yield the mean of each number and of each list of numbers, depth first; a text has none."""
    if isinstance(stated, Mapping):
        for part in stated.values():
            yield from _means_of(part)
    elif isinstance(stated, list) and any(isinstance(part, Mapping) for part in stated):
        for part in stated:
            yield from _means_of(part)
    elif isinstance(stated, list | int | float):
        yield _mean(stated)


def _mean(samples: ArrayLike) -> float:
    values = np.asarray(samples, np.float64)
    return round(float(values.mean()), 4) if values.size else 0.0


def panoramas_of(folder: Path) -> dict[str, Panorama]:
    """Return the panoramas of a specimen, by side."""
    stores = {side: folder / f"{side}.zarr" for side in SIDES}
    return {side: load_panorama(store) for side, store in stores.items() if store.is_dir()}


def unrolled_digests(panoramas: Mapping[str, Panorama]) -> dict[str, str]:
    """Return by side the digest of a panorama."""
    return {side: panorama_digest(panorama) for side, panorama in panoramas.items()}


def panorama_digest(panorama: Panorama) -> str:
    """Return the sha256 of all that a panorama's store holds, except how it was made and what was said of it.

    Depth by parallax that is known nowhere is as none.
    """
    stated = {name: value for name, value in panorama.attributes().items() if name != "provenance"}
    digest = hashlib.sha256(json.dumps(stated, sort_keys=True).encode())
    for name, (_, array, _) in sorted(panorama.variables().items()):
        if name.startswith("parallax") and np.isnan(array).all():
            continue
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
