"""The slices of a CT held against one even grid: every corner of each lies on it, or it is said which does not."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError, some_of
from endoct.modalities.ct.dicom_slices import ALIKE, Slice
from endoct.modalities.ct.stored import PLACE_MM

FEWEST = 3
"""A volume has at least so many slices; of two nobody could say that they are even."""
ROUNDED_MM = 0.05
"""Slices may lie this far off their grid, at most, where positions are written with few digits."""
MOST_ASKEW_DEG = 40.0
"""Slices may lie this far askew to their line; gantries tilt by up to 30°."""
TILT_APART_DEG = 0.5
"""A stated tilt may differ from that of the positions by this much."""
GAP = 1.5
"""Where slices lie more than this many usual distances apart, one is missing."""
MOST_MIXED = 4
IN_BLOCKS = ("AcquisitionNumber", "ImageType", "KVP")
"""These may change along a volume, but not to and fro."""


@dataclass(frozen=True, eq=False)
class SliceGrid:
    """Slices in order, at ``origin_mm`` + (k, j, i) · ``steps_mm``, LPS; ``tilted``: k runs askew to the slices."""

    slices: tuple[Slice, ...]
    origin_mm: Coordinates
    steps_mm: Coordinates
    tilted: bool
    notes: tuple[str, ...]
    doubts: tuple[Doubt, ...]


def slice_grid(slices: Sequence[Slice], name: str) -> SliceGrid:
    """Return the grid that all slices of a CT, called ``name``, lie on to 0.01 mm.

    Raises :class:`EndoctError`, naming slices, where there is none.
    """
    if len(slices) < FEWEST:
        found = f"{len(slices)} slice{'s' * (len(slices) > 1)}"
        raise EndoctError(f"{name} is no volume", found=found, expected=f"{FEWEST} slices at least")
    _check_alike(slices, name)
    usual = max(Counter(map(_axes, slices)).items(), key=lambda item: item[1])[0]
    turned = [slice_.name for slice_ in slices if np.abs(np.subtract(_axes(slice_), usual)).max() > 0.01]
    if turned:
        raise _refused(name, f"another orientation in {some_of(turned)}", "one orientation of all slices")
    normal = np.median([slice_.normal for slice_ in slices], axis=0)
    normal /= np.linalg.norm(normal)
    ordered = sorted(slices, key=lambda slice_: float(slice_.position_mm @ normal))
    along = np.array([slice_.position_mm @ normal for slice_ in ordered])
    _check_distances(ordered, along, name)
    positions = np.array([slice_.position_mm for slice_ in ordered])
    number = np.arange(len(ordered)) - (len(ordered) - 1) / 2
    step = number @ positions / (number @ number)
    origin = positions.mean(axis=0) + number[0] * step
    rows = np.mean([slice_.column * slice_.spacing_mm[0] for slice_ in ordered], axis=0)
    columns = np.mean([slice_.row * slice_.spacing_mm[1] for slice_ in ordered], axis=0)
    steps = np.array([step, rows, columns])
    doubts = list(_check_places(ordered, origin, steps, name))
    _check_one_volume(ordered, name)
    doubts += _of_numbers(ordered, name)
    tilted, notes, more = _tilt(ordered, step, normal, name)
    return SliceGrid(tuple(ordered), origin, steps, tilted, tuple(notes), (*doubts, *more))


def _axes(slice_: Slice) -> tuple[float, ...]:
    return tuple(np.round([*slice_.row, *slice_.column], 6).tolist())


def _check_alike(slices: Sequence[Slice], name: str) -> None:
    """Refuse slices of which some have another size, spacing or volume than most."""
    of = [
        ("size", [f"{slice_.shape[0]} × {slice_.shape[1]}" for slice_ in slices]),
        *((key, [slice_.alike[at] for slice_ in slices]) for at, key in enumerate(ALIKE)),
    ]
    for what, values in of:
        counts = Counter(values)
        if len(counts) == 1:
            continue
        usual, _ = counts.most_common(1)[0]
        others = [slice_.name for slice_, value in zip(slices, values, strict=True) if value != usual]
        value = next(value for value in values if value != usual)
        found = (
            f"{what} {str(value)[-40:] or 'not stated'} in {some_of(others)}, {str(usual)[-40:] or 'not stated'} else"
        )
        raise _refused(name, found, f"one {what} in all slices")


def _check_distances(ordered: Sequence[Slice], along: Coordinates, name: str) -> None:
    """Refuse slices that lie at one place, with gaps, or unevenly by more than rounding."""
    apart = np.diff(along)
    same = np.flatnonzero(apart < PLACE_MM)
    if same.size:
        k = int(same[0])
        found = f"{same.size} slices at the places of others, as {ordered[k].name} and {ordered[k + 1].name}"
        raise _refused(name, found, "one slice at a place", "export one volume, or one phase, by itself")
    usual = float(np.median(apart))
    gaps = np.flatnonzero(apart > GAP * usual)
    if gaps.size:
        k = int(gaps[0])
        found = f"{apart[k]:.3f} mm between {ordered[k].name} and {ordered[k + 1].name}, {usual:.3f} mm else"
        raise _refused(name, found, "slices without a gap", "copy the series again: slices are missing there")
    k = int(np.argmax(np.abs(apart - usual)))
    if abs(apart[k] - usual) > 2 * ROUNDED_MM + PLACE_MM:
        found = f"{apart[k]:.3f} mm between {ordered[k].name} and {ordered[k + 1].name}, {usual:.3f} mm else"
        raise _refused(name, found, "slices at even distances", "resample it, or export one range of slices")


def _check_places(ordered: Sequence[Slice], origin: Coordinates, steps: Coordinates, name: str) -> Iterator[Doubt]:
    """Refuse slices with a corner off the grid; yield a doubt where the digits of positions are too few to tell."""
    corners = np.array(list(np.ndindex(2, 2))) * np.subtract(ordered[0].shape, 1)
    even = [origin + k * steps[0] + corners @ steps[1:] for k in range(len(ordered))]
    lies = [slice_.corners_mm for slice_ in ordered]
    off = np.linalg.norm(np.subtract(lies, even), axis=2).max(axis=1)
    digits = max(slice_.decimals for slice_ in ordered)
    rounding = min(ROUNDED_MM, 0.5 * 10.0**-digits * float(np.sqrt(3)))
    most = float(off.max())
    if most > max(PLACE_MM, rounding):
        odd = ordered[_oddest(ordered, off)].name
        found = f"{odd} off the even grid of the others; slices lie up to {most:.3g} mm off"
        raise _refused(name, found, f"every slice on one grid, to {max(PLACE_MM, rounding):.2g} mm")
    if most > PLACE_MM:
        yield Doubt(
            "ct-positions-rounded",
            f"Positions of slices have {digits} digits after the point: slices lie up to {most:.3f} mm off an "
            "even grid, and were taken to lie on it.",
            value=most,
            unit="mm",
            expected=(0.0, PLACE_MM),
        )


def _oddest(ordered: Sequence[Slice], off: Coordinates) -> int:
    """Return which slice is off a grid: by the usual step, which one odd slice does not move as it moves the mean."""
    positions = np.array([slice_.position_mm for slice_ in ordered])
    even = np.arange(len(ordered))[:, None] * np.median(np.diff(positions, axis=0), axis=0)
    apart = np.linalg.norm(positions - even - np.median(positions - even, axis=0), axis=1)
    return int(np.argmax(apart if apart.max() > PLACE_MM else off))


def _check_one_volume(ordered: Sequence[Slice], name: str) -> None:
    """Refuse slices of two volumes that lie between each other."""
    for key in IN_BLOCKS:
        values = [slice_.file.text(key) for slice_ in ordered]
        changes = [k for k in range(1, len(values)) if values[k] != values[k - 1]]
        if len(changes) > len(set(values)) - 1:
            k = changes[0]
            found = f"{key} changes to and fro, as from {ordered[k - 1].name} to {ordered[k].name}"
            raise _refused(name, found, "slices of one volume", "export one volume by itself")
    numbers = [slice_.number for slice_ in ordered]
    if any(number is None for number in numbers):
        return
    values_of = np.array(numbers, dtype=np.float64)
    for mixed in range(2, MOST_MIXED + 1):
        parts = [np.diff(values_of[first::mixed]) for first in range(mixed)]
        whole = all(part.size and (np.all(part == 1) or np.all(part == -1)) for part in parts)
        if whole and not np.all(np.diff(values_of) == np.diff(values_of)[0]):
            found = f"slices numbered as those of {mixed} volumes by turns, as {ordered[0].name} and {ordered[1].name}"
            raise _refused(name, found, "slices of one volume", "export one volume by itself")


def _of_numbers(ordered: Sequence[Slice], name: str) -> Iterator[Doubt]:
    """Yield a doubt where slices are numbered in another order than they lie."""
    numbers = [slice_.number for slice_ in ordered if slice_.number is not None]
    if len(numbers) < len(ordered) or len(set(numbers)) == 1:
        return
    steps = np.diff(numbers)
    odd = np.flatnonzero(np.sign(steps) != np.sign(np.median(steps)))
    if odd.size:
        k = int(odd[0])
        yield Doubt(
            "ct-slices-renumbered",
            f"Slices of {name} are numbered in another order than they lie, as {ordered[k].name} and "
            f"{ordered[k + 1].name}: they were put where their positions say.",
            value=float(odd.size),
            unit="slices",
            expected=0.0,
        )


def _tilt(
    ordered: Sequence[Slice], step: Coordinates, normal: Coordinates, name: str
) -> tuple[bool, list[str], list[Doubt]]:
    """Return whether slices lie askew to their line, as a tilted gantry has them, and what is to be said of it."""
    askew = step - (step @ normal) * normal
    aside_mm = float(np.linalg.norm(askew)) * (len(ordered) - 1)
    measured = float(np.degrees(np.arctan2(np.linalg.norm(askew), step @ normal)))
    if measured > MOST_ASKEW_DEG:
        found = f"slices that lie {measured:.0f}° askew to their line"
        raise _refused(name, found, f"{MOST_ASKEW_DEG:g}° at most, as a tilted gantry has")
    stated = ordered[0].file.text("GantryDetectorTilt")
    try:
        by_header = abs(float(stated)) if stated else 0.0
    except ValueError:
        by_header = 0.0
    if aside_mm <= PLACE_MM:
        upright = np.degrees(np.arccos(min(1.0, float(np.abs(normal).max()))))
        if by_header > TILT_APART_DEG and upright < TILT_APART_DEG:
            said = f"The header of {name} says that the gantry was tilted by {by_header:g}°, its slices lie upright."
            return False, [], [Doubt("ct-tilt-contradicted", said, value=by_header, unit="°", expected=0.0)]
        return False, [], []
    where = f"each of {len(ordered)} slices was placed where it lies, up to {aside_mm:.1f} mm aside of the first"
    if max(measured, by_header) <= TILT_APART_DEG:  # a direction of few digits
        return True, [f"Slices lie {measured:.2f}° askew to their line: {where}."], []
    if abs(measured - by_header) <= TILT_APART_DEG:
        return True, [f"The gantry was tilted by {measured:.1f}°: {where}."], []
    askew_by = f"Slices of {name} lie {measured:.2f}° askew to their line"
    said = f"{askew_by}, which its header does not call a tilted gantry: {where}."
    return True, [], [Doubt("ct-slices-askew", said, value=measured, unit="°", expected=by_header)]


def _refused(name: str, actual: str, expected: str, remedy: str = "") -> EndoctError:
    return EndoctError(f"{name} is no even volume", found=actual, expected=expected, remedy=remedy)
