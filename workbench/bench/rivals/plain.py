"""The few lines that a reviewer would write first, without a library for the task."""

import numpy as np

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.numeric.circle import masked_gaussian
from endoct.fusion.geometry.alignment import Alignment, NotAligned
from endoct.fusion.registration.align import orientations_of
from endoct.stitching.panorama import Panorama
from endoct.workbench.bench.rivals.depth import optical_flow
from endoct.workbench.bench.tasks.depth import Views

STEP_MM = 0.04
N_AROUND = 256
WALL_MM, CAP_MM = 0.6, 0.3
"""The wall is the mean over this width; what lies farther behind it counts as this deep."""
AWAY = 8
"""A second peak lies at least so many samples from the first."""
SECOND = 0.9
SCALES = np.linspace(0.95, 1.05, 5)
BEHIND_MM = 0.06
"""Cells lie so far behind the median of their slice."""
SHALLOW_MM = 0.1


def fft_correlation(a: Panorama, b: Panorama) -> Alignment | NotAligned:
    """Correlate darkness with depth by FFT, over orientations and five scales; one sample is located to a tenth.

    Says no where another place comes to nine tenths of the best.
    """
    image_a = _evidence(a, 1.0, False, False)
    n_z = 2 * max(len(image_a), round((b.z_mm[-1] - b.z_mm[0]) * SCALES[-1] / STEP_MM) + 1)
    spectrum = np.fft.rfft2(image_a, (n_z, N_AROUND))
    found: list[tuple[float, float, Alignment]] = []
    for mirrored, reversed_ in orientations_of(a, b):
        tried: list[tuple[float, float, Alignment]] = []
        for scale in SCALES.tolist():
            image_b = _evidence(b, scale, mirrored, reversed_)
            scores = np.fft.irfft2(spectrum * np.conj(np.fft.rfft2(image_b, (n_z, N_AROUND))), (n_z, N_AROUND))
            row, column = (int(at) for at in np.unravel_index(np.argmax(scores), scores.shape))
            far = _apart(n_z, row)[:, np.newaxis] | _apart(N_AROUND, column)
            z = row + _vertex(scores[:, column], row)
            theta_rad = 2 * np.pi / N_AROUND * (column + _vertex(scores[row], column))
            begin_mm = scale * float(-b.z_mm[-1] if reversed_ else b.z_mm[0])
            z_mm = float(a.z_mm[0]) + STEP_MM * (z - n_z if z > n_z / 2 else z) - begin_mm
            place = Alignment(theta_rad, z_mm, scale, mirrored, reversed_)
            tried.append((float(scores[row, column]), float(scores[far].max()), place))
        found.append(max(tried, key=lambda one: one[0]))
    found.sort(key=lambda one: -one[0])
    if max(found[0][1], *(peak for peak, _, _ in found[1:]), 0.0) >= SECOND * found[0][0]:
        return NotAligned("a second place correlates nearly as well")
    return found[0][2]


def _apart(n: int, at: int) -> Mask:
    """Return which of ``n`` samples on a circle lie farther than :data:`AWAY` from one, (n,)."""
    return np.asarray(np.abs((np.arange(n) - at + n // 2) % n - n // 2) > AWAY)


def behind_the_median(panorama: Panorama) -> Mask:
    """Return what lies 60 µm behind the median of its slice, or is darker than half of it where there is no depth."""
    values = panorama.intensity if panorama.depth_mm is None else panorama.depth_mm
    slices = zip(values, panorama.valid, strict=True)
    typical = np.array([np.median(row[seen]) if seen.any() else 0 for row, seen in slices])[:, np.newaxis]
    cells = values < typical / 2 if panorama.depth_mm is None else values > typical + BEHIND_MM
    return np.asarray(panorama.valid & cells)


def flow_or_wall(views: Views) -> Image:
    """Return the depth of optical flow, and the wall where that is less than 0.1 mm or not known."""
    depth_mm = np.nan_to_num(optical_flow(views))
    return np.where(depth_mm < SHALLOW_MM, 0, depth_mm).astype(np.float32)


def _vertex(values: Coordinates, at: int) -> float:
    """Return where the parabola through a peak and its neighbours on the circle is highest, from ``at``, samples."""
    before, peak, after = (float(values[(at + k) % len(values)]) for k in (-1, 0, 1))
    curved = before - 2 * peak + after
    return 0.5 * (before - after) / curved if curved else 0.0


def _evidence(panorama: Panorama, scale: float, mirrored: bool, reversed_: bool) -> Image:
    """Return depth behind the wall, or darkness, even steps of z and θ, mean 0, float64 (n_z, :data:`N_AROUND`)."""
    grid = panorama.grid
    values = -np.log(np.maximum(panorama.intensity, 1)) if panorama.depth_mm is None else panorama.depth_mm
    values = np.where(panorama.valid, values, 0).astype(np.float32)
    wall = masked_gaussian(values, panorama.valid, WALL_MM / grid.dz_mm, WALL_MM / grid.dtheta_mm)
    fine = masked_gaussian(values - wall, panorama.valid, STEP_MM / 2 / grid.dz_mm, STEP_MM / 2 / grid.dtheta_mm)
    shown = np.where(panorama.valid, np.clip(fine, -CAP_MM, CAP_MM), 0)
    z_mm = scale * (panorama.z_mm - panorama.z_mm[0])
    rows = np.searchsorted(z_mm, np.arange(0, z_mm[-1], STEP_MM)).clip(0, len(z_mm) - 1)
    columns = np.arange(N_AROUND) * grid.n_theta // N_AROUND
    image = shown[np.ix_(rows, columns)]
    image = image[::-1] if reversed_ else image
    image = np.roll(image[:, ::-1], 1, axis=1) if mirrored else image
    return np.asarray((image - image.mean()) / max(float(image.std()), 1e-9))
