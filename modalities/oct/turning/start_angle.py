"""Where every turn starts, from what does not turn with the optics.

The sheath is a landmark (:mod:`endoct.modalities.oct.turning.sheath`). It may creep from slice to slice, which nothing
in the recording can distinguish from starts that creep: that share of the twist stays unknown and is stated. Where
turns start anywhere and no sheath is seen, neighbouring slices are compared
(:mod:`endoct.modalities.oct.turning.slice_matching`).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from endoct.modalities.oct.face.faces import Faces
from endoct.modalities.oct.face.glass import Glass
from endoct.modalities.oct.face.neighbours import starts_anywhere
from endoct.modalities.oct.face.slices import SliceFeatures
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.turning.rotation import Rotation
from endoct.modalities.oct.turning.sheath import Mark, sheath_mark
from endoct.modalities.oct.turning.slice_matching import DRIFT_RAD, starts_from_neighbours
from endoct.modalities.oct.turning.start_chain import separated
from endoct.stitching.arrays import Coordinates
from endoct.stitching.circle import mean_angle_rad, wrap_rad
from endoct.stitching.robust import robust_sigma

CREEP_RAD = 0.0017  # of a mark from slice to slice: 0.1°
LEAST_START_RAD = 0.002

BY_SHEATH = "Turns start anywhere; where each does was measured from the sheath's lines."
BY_NEIGHBOURS = (
    "Turns start anywhere and no sheath line shows where; cells that span two slices and the capillary's direction "
    "were followed from slice to slice, so that the twist along the bore is uncertain."
)
CONTRADICTED = (
    "According to the sheath's lines turns start so that the capillary jumps from slice to slice; they were not used."
)


def measure_starts(
    slices: Sequence[SliceFeatures],
    faces: Faces,
    glass: Glass,
    rotation: Rotation,
    acquisition: OctAcquisition,
    parameters: OctParameters,
) -> tuple[Rotation, str]:
    """Return ``rotation`` with starts, and a note on how they were measured, or "".

    ``slices`` in the order of z, their angles those of beams. Starts are relative to their mean where turns are
    triggered, to the first slice where they start anywhere.
    """
    mark = sheath_mark(slices, faces, glass, acquisition.mm_per_px)
    if mark is not None:  # it is seen at the angles that the turn's shape gives
        mark = replace(mark, sigma_rad=np.hypot(mark.sigma_rad, np.nan_to_num(rotation.shape_sigma_rad)))
    if starts_anywhere(faces.observed, parameters.start):
        if mark is not None:
            start, sigma = _from_mark(mark, faces)
            return _from_first(rotation, start, sigma), BY_SHEATH
        start, sigma = starts_from_neighbours(slices, faces, acquisition)
        return _from_first(rotation, start, sigma), BY_NEIGHBOURS
    if mark is None:
        return rotation, ""
    triggered = _triggered(rotation, mark)
    if _contradicted(triggered.start_rad, faces):
        return rotation, CONTRADICTED
    return triggered, ""


def _contradicted(start_rad: Coordinates, faces: Faces) -> bool:
    """Whether the capillary's direction jumps from slice to slice with these starts, but not without them."""
    seen = ~faces.bridged
    recorded = faces.capillary.direction_rad[seen]
    if recorded.size < 2:
        return False
    without, jumps = (
        float(np.mean(np.abs(wrap_rad(np.diff(direction))))) for direction in (recorded, recorded + start_rad[seen])
    )
    return jumps > max(DRIFT_RAD, 2 * without)


def _triggered(rotation: Rotation, mark: Mark) -> Rotation:
    """Turns start near one angle, so that long ones lie later in the mean; slow changes are rather the mark's."""
    seen = np.isfinite(mark.direction_rad)
    later = np.pi * rotation.stretch
    direction = mark.direction_rad + later
    moved = np.where(seen, wrap_rad(direction - mean_angle_rad(direction[seen])), 0.0)
    steps = np.diff(moved[seen])
    if not steps.size:
        return rotation
    # what the steps scatter by more than the mark is sure of
    scatter = robust_sigma(steps) ** 2 / 2 - np.median(mark.sigma_rad[seen]) ** 2
    usual = max(LEAST_START_RAD, float(np.sqrt(max(scatter, 0.0))))
    early, spread = separated(moved, np.where(seen, mark.sigma_rad, np.inf), usual, CREEP_RAD)
    start = early + later
    return replace(
        rotation,
        start_rad=np.where(seen, start - start[seen].mean(), 0.0),
        start_known=seen,
        start_sigma_rad=np.where(seen, spread, np.nan),
    )


def _from_mark(mark: Mark, faces: Faces) -> tuple[Coordinates, Coordinates]:
    """Starts and their standard deviations from the mark; NaN where neither it nor the capillary is seen.

    Slices that do not show the mark go by the capillary's direction, between slices that show both.
    """
    n = len(faces.capillary)
    capillary = faces.observed.direction_rad
    seen = np.isfinite(mark.direction_rad)
    start = np.where(seen, -mark.direction_rad, np.nan)
    away = np.abs(np.arange(n) - int(np.flatnonzero(seen)[0]))
    sigma = np.where(seen, np.hypot(mark.sigma_rad, CREEP_RAD * np.sqrt(away)), np.nan)
    both = seen & np.isfinite(capillary)
    left = ~seen & np.isfinite(capillary)
    if both.any() and left.any():
        at, common = np.flatnonzero(both), np.unwrap((capillary + start)[both])
        start = np.where(left, np.interp(np.arange(n), at, common) - capillary, start)
        either_side = np.searchsorted(at, np.arange(n)) - np.array([[1], [0]])
        distance = np.abs(np.arange(n) - at[np.clip(either_side, 0, at.size - 1)]).min(axis=0)
        sigma = np.where(left, DRIFT_RAD * np.sqrt(distance), sigma)
    return start, sigma


def _from_first(rotation: Rotation, start: Coordinates, sigma: Coordinates) -> Rotation:
    """``rotation`` with starts relative to the first known one; NaN where not known."""
    known = np.isfinite(start)
    start = np.where(known, start, 0.0)
    if known.any():
        start = start - start[int(np.flatnonzero(known)[0])]
    return replace(
        rotation,
        start_rad=np.where(known, np.mod(start, 2 * np.pi), 0.0),
        start_known=known,
        start_sigma_rad=np.where(known, sigma, np.nan),
    )
