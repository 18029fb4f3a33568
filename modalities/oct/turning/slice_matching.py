"""Where turns start, from one slice to the next, where no sheath is seen.

The direction of the capillary's offset from the catheter drifts by degrees a slice, and cells span two slices.
"""

from collections.abc import Sequence

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.numeric.circle import wrap_rad
from endoct.modalities.oct.bscan import mean_between
from endoct.modalities.oct.face.circle import Circle, circle_distance_mm
from endoct.modalities.oct.face.faces import Faces
from endoct.modalities.oct.face.slices import SliceFeatures
from endoct.modalities.oct.manifest import OctAcquisition

DRIFT_RAD = 0.09  # of the capillary's direction from slice to slice: 5°
PROFILE_MM = (0.02, 0.10)  # behind the nominal wall: dark in cells
N_PROFILE = 192
NEAR_RAD = 0.7
LEAST_LIKENESS = 0.6
CELLS_RAD = 0.035  # how far the shapes of cells shift one slice against the next: 2°


def starts_from_neighbours(
    slices: Sequence[SliceFeatures], faces: Faces, acquisition: OctAcquisition
) -> tuple[Coordinates, Coordinates]:
    """Return starts and their standard deviations relative to the first slice, float64 (n_slices,), rad.

    Each is measured from the slice before; NaN where the outer face is not seen.
    """
    capillary_rad = faces.observed.direction_rad
    profiles = _profiles(slices, faces, acquisition)
    n = len(slices)
    start, variance = np.full(n, np.nan), np.full(n, np.nan)
    last = -1
    for i in map(int, np.flatnonzero(np.isfinite(capillary_rad))):
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
    """By how much more than ``about_rad`` the start of b lies behind that of a, and how alike the two are then."""
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


def _profiles(slices: Sequence[SliceFeatures], faces: Faces, acquisition: OctAcquisition) -> Coordinates:
    """How bright each slice is just behind the nominal wall, over θ in its own frame, float64 (n, N_PROFILE)."""
    profiles = np.array([_profile(each, faces.capillary.circle(i), acquisition) for i, each in enumerate(slices)])
    dark, bright = np.percentile(profiles, 5), np.median(profiles)
    profiles = np.clip((profiles - dark) / max(bright - dark, 1e-9), 0, 1)
    return np.asarray(profiles - profiles.mean(axis=1, keepdims=True))


def _profile(features: SliceFeatures, face: Circle, acquisition: OctAcquisition) -> Coordinates:
    """The mean of the samples just behind the nominal wall, over θ in the slice's own frame, float64 (N_PROFILE,)."""
    beam_rad, ascans = features.ascan_angle_rad, features.ascans
    along = circle_distance_mm(beam_rad, face.x_mm, face.y_mm, acquisition.bore_radius_mm)
    at_mm = face.axis_depth_mm + along
    first, last = (np.round((at_mm + beyond) / acquisition.mm_per_px).astype(np.intp) for beyond in PROFILE_MM)
    level = mean_between(ascans, first, last)
    at_rad = np.mod(np.arctan2(face.y_mm + along * np.sin(beam_rad), face.x_mm + along * np.cos(beam_rad)), 2 * np.pi)
    order = np.argsort(at_rad)
    theta = 2 * np.pi * np.arange(N_PROFILE) / N_PROFILE
    return np.asarray(np.interp(theta, at_rad[order], level[order], period=2 * np.pi))
