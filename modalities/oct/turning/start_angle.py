"""Where every turn starts, from what does not turn with the optics.

Sheath lines are drawn from off the sheath's axis. The direction of that offset stays put while the catheter is pulled,
so that in a turn that starts later it is seen earlier. Two lines or more that keep their angle to one another through
the recording are such a mark; how well they keep it says how well they tell. The mark itself is allowed to creep from
slice to slice, which nothing in the recording can tell from a creeping start: that share of the twist stays unknown
and is stated. The direction of the capillary's offset from the catheter, which drifts by degrees a slice, and cells
that span two slices, are what is left where turns start anywhere and no sheath is seen.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from endoct.modalities.oct.face.capillary import Faces, starts_anywhere
from endoct.modalities.oct.face.sine import circle_distance_mm
from endoct.modalities.oct.face.slices import SliceEvidence
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.turning.rotation import Rotation
from endoct.modalities.oct.turning.sheath import Mark, sheath_mark
from endoct.modalities.oct.turning.start_chain import separated
from endoct.stitching.arrays import Coordinates
from endoct.stitching.circle import wrap_rad

CREEP_RAD = 0.0017  # of a mark from slice to slice: 0.1°
LEAST_START_RAD = 0.002
DRIFT_RAD = 0.09  # of the capillary's direction from slice to slice: 5°
PROFILE_MM = (0.02, 0.10)  # behind the nominal wall: dark in cells
N_PROFILE = 192
NEAR_RAD = 0.7
LEAST_LIKENESS = 0.6
CELLS_RAD = 0.035  # how far cells' own shapes shift one slice against the next: 2°


def measure_starts(
    slices: Sequence[SliceEvidence],
    faces: Faces,
    rotation: Rotation,
    radius_mm: float,
    bore_mm: float,
    mm_per_px: float,
    parameters: OctParameters,
) -> tuple[Rotation, str]:
    """Return ``rotation`` with starts, and a sentence on what told them, or "".

    ``slices`` in the order of z with beam angles for nominal ones, ``radius_mm`` of the outer face, ``bore_mm`` of the
    nominal wall. Starts are given against their mean where turns are triggered, against the first slice where not.
    """
    free = starts_anywhere(faces.x_mm, faces.y_mm, ~faces.bridged, parameters)
    mark = sheath_mark(slices, faces, radius_mm, mm_per_px)
    if free:
        return _free(slices, faces, rotation, mark, bore_mm, mm_per_px)
    if mark is None:
        return rotation, ""
    told = _triggered(rotation, mark)
    if _belied(told.start_rad, faces):
        return rotation, (
            "The sheath's lines tell of starts that make the capillary jump from slice to slice; they were not used."
        )
    return told, ""


def _belied(start_rad: Coordinates, faces: Faces) -> bool:
    """Return whether the capillary's direction jumps from slice to slice with these starts, but not without them."""
    seen = ~faces.bridged
    recorded = np.arctan2(faces.y_mm, faces.x_mm)[seen]
    if recorded.size < 2:
        return False
    without, jumps = (
        float(np.mean(np.abs(wrap_rad(np.diff(direction))))) for direction in (recorded, recorded + start_rad[seen])
    )
    return jumps > max(DRIFT_RAD, 2 * without)


def _triggered(rotation: Rotation, mark: Mark) -> Rotation:
    """Turns begin near one angle, so that long ones lie later in the mean; slow changes are rather the mark's."""
    seen = np.isfinite(mark.direction_rad)
    later = np.pi * rotation.stretch
    direction = mark.direction_rad + later
    centre = np.angle(np.sum(np.exp(1j * direction[seen])))
    moved = np.where(seen, wrap_rad(direction - centre), 0.0)
    steps = np.diff(moved[seen])
    usual = max(LEAST_START_RAD, 1.4826 * float(np.median(np.abs(steps))) / np.sqrt(2)) if steps.size else 0.0
    if not usual:
        return rotation
    early, spread = separated(moved, np.where(seen, mark.sigma_rad, np.inf), usual, CREEP_RAD)
    start = early + later
    return replace(
        rotation,
        start_rad=np.where(seen, start - start[seen].mean(), 0.0),
        start_known=seen,
        start_sigma_rad=np.where(seen, spread, np.nan),
    )


def _free(
    slices: Sequence[SliceEvidence],
    faces: Faces,
    rotation: Rotation,
    mark: Mark | None,
    bore_mm: float,
    mm_per_px: float,
) -> tuple[Rotation, str]:
    n = len(slices)
    capillary = np.where(faces.bridged, np.nan, np.arctan2(faces.y_mm, faces.x_mm))
    if mark is not None:
        seen = np.isfinite(mark.direction_rad)
        start = np.where(seen, -mark.direction_rad, np.nan)
        first = int(np.flatnonzero(seen)[0])
        away = np.abs(np.arange(n) - first)
        sigma = np.where(seen, np.hypot(mark.sigma_rad, CREEP_RAD * np.sqrt(away)), np.nan)
        how = "Turns start anywhere; where each does was told by the sheath's lines."
        # what shows no sheath goes by the capillary's direction, between slices that show both
        both = seen & np.isfinite(capillary)
        left = ~seen & np.isfinite(capillary)
        if both.any() and left.any():
            at, common = np.flatnonzero(both), np.unwrap((capillary + start)[both])
            start = np.where(left, np.interp(np.arange(n), at, common) - capillary, start)
            either_side = np.searchsorted(at, np.arange(n)) - np.array([[1], [0]])
            distance = np.abs(np.arange(n) - at[np.clip(either_side, 0, at.size - 1)]).min(axis=0)
            sigma = np.where(left, DRIFT_RAD * np.sqrt(distance), sigma)
    else:
        start, sigma = _from_neighbours(slices, faces, capillary, bore_mm, mm_per_px)
        how = (
            "Turns start anywhere and no sheath line tells where; cells that span two slices and the capillary's "
            "direction were followed from slice to slice, so that the twist along the bore is uncertain."
        )
    known = np.isfinite(start)
    start = np.where(known, start, 0.0)
    if known.any():
        start = start - start[int(np.flatnonzero(known)[0])]
    return (
        replace(
            rotation,
            start_rad=np.where(known, np.mod(start, 2 * np.pi), 0.0),
            start_known=known,
            start_sigma_rad=np.where(known, sigma, np.nan),
        ),
        how,
    )


def _from_neighbours(
    slices: Sequence[SliceEvidence], faces: Faces, capillary_rad: Coordinates, bore_mm: float, mm_per_px: float
) -> tuple[Coordinates, Coordinates]:
    """Return starts and their standard deviations against the first slice, each found from the one before."""
    profiles = _profiles(slices, faces, bore_mm, mm_per_px)
    n = len(slices)
    start, variance = np.full(n, np.nan), np.full(n, np.nan)
    last = -1
    for i in range(n):
        if not np.isfinite(capillary_rad[i]):
            continue
        if last < 0:
            start[i], variance[i] = 0.0, 0.0
        else:
            by_capillary = float(wrap_rad(np.asarray(capillary_rad[last] - capillary_rad[i])))
            sigma = DRIFT_RAD * np.sqrt(i - last)
            by_cells, likeness = _turned_by(profiles[last], profiles[i], by_capillary)
            step, spread = by_capillary, sigma
            if likeness > LEAST_LIKENESS:
                share = sigma**2 / (sigma**2 + CELLS_RAD**2)
                step = by_capillary + share * by_cells
                spread = np.sqrt(share) * CELLS_RAD
            start[i], variance[i] = start[last] + step, variance[last] + spread**2
        last = i
    return start, np.sqrt(variance)


def _turned_by(a: Coordinates, b: Coordinates, about_rad: float) -> tuple[float, float]:
    """Return by how much more than ``about_rad`` the start of b lies behind that of a, and how alike they are then."""
    spectrum = np.fft.rfft(a) * np.conj(np.fft.rfft(b))
    shift = np.fft.rfftfreq(a.size, 1 / a.size) * about_rad
    alike = np.fft.irfft(spectrum * np.exp(1j * shift), n=a.size) / max(
        float(np.sqrt(np.sum(a**2) * np.sum(b**2))), 1e-9
    )
    reach = round(NEAR_RAD / (2 * np.pi) * a.size)
    near = np.roll(alike, reach)[: 2 * reach + 1]
    k = int(np.argmax(near))
    if k in (0, 2 * reach):
        return 0.0, 0.0
    before, here, after = near[k - 1 : k + 2]
    sub = 0.5 * (before - after) / min(before - 2 * here + after, -1e-12)
    return (k + sub - reach) * 2 * np.pi / a.size, float(here)


def _profiles(slices: Sequence[SliceEvidence], faces: Faces, bore_mm: float, mm_per_px: float) -> Coordinates:
    """Return how bright each slice is just behind the nominal wall, over θ in its own frame, float64 (n, N_PROFILE)."""
    theta = 2 * np.pi * np.arange(N_PROFILE) / N_PROFILE
    found = np.zeros((len(slices), N_PROFILE))
    for i, one in enumerate(slices):
        x, y, depth = faces.x_mm[i], faces.y_mm[i], faces.axis_depth_mm[i]
        along = circle_distance_mm(one.ascan_angle_rad, x, y, bore_mm)
        total = np.concatenate([np.zeros((one.ascans.shape[0], 1)), np.cumsum(one.ascans, axis=1, dtype=float)], axis=1)
        low, high = (
            np.clip(np.round((depth + along + beyond) / mm_per_px).astype(int), 0, one.ascans.shape[1])
            for beyond in PROFILE_MM
        )
        each = np.arange(low.size)
        level = (total[each, high] - total[each, low]) / np.maximum(high - low, 1)
        at = np.arctan2(y + along * np.sin(one.ascan_angle_rad), x + along * np.cos(one.ascan_angle_rad))
        order = np.argsort(np.mod(at, 2 * np.pi))
        found[i] = np.interp(theta, np.mod(at, 2 * np.pi)[order], level[order], period=2 * np.pi)
    dark, bright = np.percentile(found, 5), np.median(found)
    found = np.clip((found - dark) / max(bright - dark, 1e-9), 0, 1)
    return np.asarray(found - found.mean(axis=1, keepdims=True))
