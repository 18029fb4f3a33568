"""Which images of a folder are the frames of one recording, and in what order: by their names and their content.

Copies are left out, by their bytes; images of one place in two files by their pixels. What belongs to another series
is refused. What names leave open is doubted.
"""

from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from endoct.base.errors import EndoctError, some_of
from endoct.modalities.reading.frame_names import (
    LONGEST_NUMBER,
    Name,
    Unit,
    read_names,
    resolution_of,
    seems_negative,
    spacing_in,
    varying,
)
from endoct.modalities.reading.numbering import Along
from endoct.modalities.reading.remarks import NONE, Remarks, doubted, some_names
from endoct.modalities.reading.repeated_frames import sets_of_equal, size_of

COMPARED, COMPARED_BYTES = 16, 400_000_000
"""Where a folder has images twice, the pixels of this many pairs are compared; of all, if they have no more bytes
together."""
_PREFERRED = (".tif", ".tiff", ".btf", ".tf8", ".png", ".bmp", ".jpg", ".jpeg")
_BY_NAMES = "the numbers in names"

Alike = Callable[[Path, Path], bool]


@dataclass(frozen=True, eq=False)
class FrameFiles:
    """``files``: a frame each, in their order; ``along``: what their names say of their places."""

    files: tuple[Path, ...]
    along: Along | None
    remarks: Remarks


def choose_frames(folder: Path, files: Sequence[Path], alike: Alike) -> FrameFiles:
    """Return the frames among the images ``files`` of ``folder``.

    ``alike`` says of two files whether they hold the same pixels. Raises :class:`EndoctError` where there are two
    images of one place that differ, or several series.
    """
    names, unclear = read_names(files)
    kept, remarks = _without_copies(names)
    kept, on_twins = _without_twins(folder, kept, alike)
    remarks += on_twins
    if len(kept) < len(names):  # others may be read in another way
        names, unclear = read_names([name.path for name in kept])
    if len(names) < 2:
        return FrameFiles(tuple(name.path for name in names), None, remarks)
    if unclear:
        remarks += doubted(
            "names-unclear",
            f"Numbers in names can be read with decimals or without, in different orders; {_run(names)} was taken.",
        )
    if len({name.form for name in names}) > 1:
        names, field, on_forms = _of_several_forms(folder, names)
        remarks += on_forms
    else:
        field, on_order = _counting(names)
        remarks += on_order
    along = None
    if field is not None and max(abs(float(name.numbers[field])) for name in names) < 10**LONGEST_NUMBER:
        along = _along(names, field)
        remarks += _on_signs(names, field)
    elif field is not None and spacing_in(names, field).kind != "even":
        what = f"Numbers in names are too long to count frames, and uneven; frames were placed evenly: {_run(names)}."
        remarks += doubted("frames-uneven", what)
    return FrameFiles(tuple(name.path for name in names), along, remarks)


def _without_copies(names: Sequence[Name]) -> tuple[list[Name], Remarks]:
    """Leave out files whose bytes are those of another, unless their names count them as frames of their own."""
    by_path = {name.path: name for name in names}
    usual = Counter(name.form for name in names).most_common(1)[0][0] if names else ""
    left_out: list[Path] = []
    repeated: list[str] = []
    for group in sets_of_equal([name.path for name in names]):
        members = sorted(
            (by_path[path] for path in group),
            key=lambda name: (name.form != usual, len(name.path.name), name.path.name),
        )
        counted = {name.numbers: name for name in reversed(members) if name.form == members[0].form}
        keep = {name.path for name in counted.values()} if members[0].form == usual else {members[0].path}
        left_out += [name.path for name in members if name.path not in keep]
        if len(keep) > 1:
            repeated.append(" = ".join(sorted(path.name for path in keep)[:3]))
    remarks = NONE
    if left_out:
        listed = some_names(sorted(path.name for path in left_out))
        remarks += Remarks(notes=(f"Copies of other images, byte for byte, were left out: {listed}.",))
    if repeated:
        what = f"Images with different numbers are the same, byte for byte: {some_names(repeated)}. One may be missing."
        remarks += doubted("frames-repeated", what)
    return [name for name in names if name.path not in set(left_out)], remarks


def _without_twins(folder: Path, names: Sequence[Name], alike: Alike) -> tuple[list[Name], Remarks]:
    """Of images with the same name but for suffix, case or zeros before a number, keep one, if their pixels agree."""
    by_place: dict[object, list[Name]] = defaultdict(list)
    for name in names:
        by_place[name.form, name.numbers].append(name)
    twins = [each for each in by_place.values() if len(each) > 1]
    if not twins:
        suffixes = Counter(name.path.suffix.lower() for name in names)
        return list(names), _on_suffixes(suffixes)
    some = len(twins) if sum(size_of(name.path) for each in twins for name in each) <= COMPARED_BYTES else COMPARED
    for k in sorted({int(at) for at in np.linspace(0, len(twins) - 1, some)}):
        first, *others = twins[k]
        for other in others:
            if not alike(first.path, other.path):
                raise EndoctError(
                    f"{folder} holds two images of one place that differ",
                    found=f"{first.path.name} and {other.path.name}",
                    expected="one image a place",
                    remedy="keep each recording in a folder of its own",
                )
    covered = Counter(suffix for each in by_place.values() for suffix in {name.path.suffix.lower() for name in each})

    def worth(name: Name) -> tuple[int, int, str]:
        suffix = name.path.suffix.lower()
        return -covered[suffix], _PREFERRED.index(suffix) if suffix in _PREFERRED else 99, name.path.name

    kept = {min(each, key=worth).path for each in by_place.values()}
    listed = some_names(sorted(name.path.name for name in names if name.path not in kept))
    note = f"Images of the same places, with the same pixels, were left out: {listed}."
    remaining = [name for name in names if name.path in kept]
    return remaining, Remarks(notes=(note,)) + _on_suffixes(Counter(name.path.suffix.lower() for name in remaining))


def _on_suffixes(suffixes: Counter[str]) -> Remarks:
    kinds = {{".jpeg": ".jpg", ".tiff": ".tif"}.get(suffix, suffix) for suffix in suffixes}
    if len(kinds) < 2:
        return NONE
    listed = ", ".join(f"{count} {suffix}" for suffix, count in suffixes.most_common())
    return doubted("frames-of-several-kinds", f"Frames are of several kinds of file: {listed}. Is it one recording?")


def _of_several_forms(folder: Path, names: list[Name]) -> tuple[list[Name], int | None, Remarks]:
    """Put names of several forms in order, if one number tells them apart; return the number that counts them."""
    if bare := _browser_series(names):
        return bare, None, NONE
    forms = Counter(name.form for name in names)
    if not any(name.numbers for name in names):
        what = f"Names have no numbers; images were taken in alphabetical order: {_run(names)}."
        return names, None, doubted("names-without-numbers", what)
    n_leading = _leading(names)
    if len({len(name.numbers) for name in names}) == 1 and len({name.numbers for name in names}) == len(names):
        n_leading = len(names[0].numbers)
    if not n_leading or len({name.numbers[:n_leading] for name in names}) < len(names):
        one = {name.form: name.path.name[:60] for name in reversed(names)}
        listed = [f"{one[form]} ({count})" for form, count in forms.most_common()]
        raise EndoctError(
            f"{folder} holds images of several series",
            found=some_of(listed),
            expected="images whose names differ by a number alone",
            remedy="keep each recording in a folder of its own, and other images elsewhere",
        )
    ordered = sorted(names, key=lambda name: name.numbers[:n_leading])
    what = f"Names are of {len(forms)} forms; images were put in the order of their numbers: {_run(ordered)}."
    fields = [k for k in range(n_leading) if len({name.numbers[k] for name in ordered}) == len(ordered)]
    return ordered, fields[-1] if fields else None, doubted("names-of-several-forms", what)


def _browser_series(names: list[Name]) -> list[Name]:
    """Return x.png, x (1).png, x (2).png, …, as they are saved one after the other; empty for anything else."""
    for bare in names:
        others = [name for name in names if name is not bare]
        forms = {name.form for name in others}
        follows = {f"{bare.form}{space}(#)" for space in ("", " ", "_")}
        if len(forms) == 1 and forms <= follows and all(name.numbers[:-1] == bare.numbers for name in others):
            numbers = sorted(int(name.numbers[-1]) for name in others)
            if numbers in (list(range(1, len(names))), list(range(2, len(names) + 1))):
                return [bare, *sorted(others, key=lambda name: name.numbers)]
    return []


def _leading(names: Sequence[Name]) -> int:
    """Return how many numbers all names begin with, in the same form."""
    texts = [name.form.split("#") for name in names]
    n = 0
    while all(len(name.numbers) > n for name in names) and len({text[n] for text in texts}) == 1:
        n += 1
    return n


def _counting(names: list[Name]) -> tuple[int | None, Remarks]:
    """Return which number counts the frames, of names of one form; and what speaks against their order."""
    fields = varying(names)
    single = [k for k in fields if len({name.numbers[k] for name in names}) == len(names)]
    if not single:
        what = f"Names count several series, which were taken one behind the other: {_run(names)}."
        return None, doubted("names-of-several-series", what)
    rising = [k for k in single if all(a.numbers[k] < b.numbers[k] for a, b in pairwise(names))]
    if len(rising) < len(single) or not rising:
        what = f"Two numbers in names put the images in different orders; {_run(names)} was taken."
        return rising[-1] if rising else None, doubted("names-in-two-orders", what)
    kinds = {k: spacing_in(names, k).kind for k in rising}
    stated = [k for k in rising if names[0].units[k]]
    if stated:
        return stated[-1], NONE
    regular = [k for k in rising if kinds[k] != "uneven"]
    if len({kinds[k] for k in regular}) > 1:
        what = f"By one number in names images are missing, by another they are not: {_run(names)}."
        return next(k for k in regular if kinds[k] == "gaps"), doubted("names-in-two-orders", what)
    return (regular or rising)[-1], NONE


def _along(names: Sequence[Name], field: int) -> Along:
    values = [name.numbers[field] for name in names]
    unit: Unit = names[0].units[field] if len({name.units[field] for name in names}) == 1 else ""
    resolution = resolution_of(values)
    places = np.array([float(value - values[0]) for value in values])
    return Along(places, unit, _BY_NAMES, not unit and resolution < 1, resolution)


def _on_signs(names: Sequence[Name], field: int) -> Remarks:
    values = [name.numbers[field] for name in names]
    if max(values) <= 0 and min(values) < 0:
        what = (
            f"Places in names are all negative and were taken in ascending order: {_run(names)}. Was it the other way?"
        )
        return doubted("names-negative", what)
    if seems_negative(names, field):
        what = f"The hyphen before the numbers in names may be a minus sign; {_run(names)} was taken."
        return doubted("names-negative", what)
    return NONE


def _run(names: Sequence[Name]) -> str:
    return f"{names[0].path.name[:60]}, {names[1].path.name[:60]}, … {names[-1].path.name[:60]}"
