"""How one would unroll a pullback with what is at hand.

The rivals for uneven rotation begin with our unrolling without it, so that they differ in that alone. None of them
knows more of a turn than that neighbouring slices should look alike.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from skimage.measure import CircleModel, ransac
from skimage.registration import phase_cross_correlation

from endoct.base.arrays import Coordinates, Image
from endoct.modalities.recognition import open_recording
from endoct.stitching.panorama import Panorama
from endoct.workbench.bench.tasks.oct import even

N_BLOCKS = 8
TURNING = ("start_angle", "turn_length", "rotation_", "lost_")
"""Values per frame whose names begin so are unknown to a chain of shifts."""
WINDOW = 6
"""Width of the window over which blocks are compared, in units of the distance between blocks."""


def ransac_circle(recording: Path) -> Panorama:
    """A circle through the brightest samples of every slice (scikit-image), the wall about its centre."""
    base = even(recording)
    _, stream = open_recording(recording)
    sidecar = stream.acquisition.model_dump()
    mm, sense = float(sidecar["axial_pixel_mm"]), -1 if sidecar["handedness"] == "mirrored" else 1
    depth = np.zeros(base.grid.shape)
    theta = base.grid.theta_rad
    for row, i in enumerate(base.per_frame["slice_index"].values):
        samples = np.asarray(stream[int(i)].samples, dtype=np.float32)
        alpha = sidecar["theta_origin_rad"] + sense * 2 * np.pi * np.arange(samples.shape[0]) / samples.shape[0]
        first = round(0.3 * samples.shape[1])  # past the sheath's lines, which would always win
        reach = (first + np.argmax(samples[:, first:], axis=1)) * mm
        points = np.stack([reach * np.cos(alpha), reach * np.sin(alpha)], axis=1)
        model, _ = ransac(points, CircleModel, min_samples=3, residual_threshold=0.03, max_trials=200, rng=0)
        if model is None:
            continue
        # scikit-image 0.26 renamed them
        x, y, radius = (*model.center, model.radius) if hasattr(model, "center") else model.params
        at = np.mod(np.arctan2(points[:, 1] - y, points[:, 0] - x), 2 * np.pi)
        order = np.argsort(at)
        beyond = np.hypot(points[:, 0] - x, points[:, 1] - y) - radius
        depth[row] = np.interp(theta, at[order], beyond[order], period=2 * np.pi)
    return replace(base, depth_mm=depth.astype(np.float32), valid=np.ones_like(base.valid))


def phase_correlation(recording: Path) -> Panorama:
    """Every slice turned onto the one before by scikit-image's phase correlation of the depth."""
    base = even(recording)

    def shift(before: Image, here: Image) -> Coordinates:
        if not (np.ptp(before) > 0 and np.ptp(here) > 0):
            return np.zeros(here.size)  # a row without relief, or not valid
        # two rows, as the function wants an image
        offset = phase_cross_correlation(np.stack([before] * 2), np.stack([here] * 2), upsample_factor=10)[0]
        return np.full(here.size, float(offset[1]))

    return _chained(base, shift)


def blockwise(recording: Path) -> Panorama:
    """Every slice warped onto the one before: cyclic cross-correlation in blocks, as published for A-lines."""
    base = even(recording)

    def shift(before: Image, here: Image) -> Coordinates:
        n = here.size
        centres = (np.arange(N_BLOCKS) + 0.5) * n / N_BLOCKS
        whole = _lag(before, here, n // 2)
        lags = []
        for centre in centres:
            apart = (np.arange(n) - centre + n / 2) % n - n / 2
            weight = np.exp(-0.5 * (apart / (WINDOW * n / N_BLOCKS / 4)) ** 2)
            lags.append(whole + _lag(before * weight, np.roll(here, whole) * weight, n // 36))
        return np.asarray(np.interp(np.arange(n), centres, np.asarray(lags, dtype=float), period=n))

    return _chained(base, shift)


def _lag(before: Image, here: Image, most: int) -> int:
    spectrum = np.fft.rfft(before - before.mean()) * np.conj(np.fft.rfft(here - here.mean()))
    alike = np.fft.irfft(spectrum, n=here.size)
    lags = np.arange(-most, most + 1)
    return int(lags[int(np.argmax(alike[lags % here.size]))])


def _chained(panorama: Panorama, shift: Callable[[Image, Image], Coordinates]) -> Panorama:
    """The panorama with each row resampled by ``shift`` (samples, at each column) onto the corrected row before."""
    depth = np.array(panorama.depth_mm)
    relief = np.clip(depth, 0, 0.3)
    intensity, valid = panorama.intensity.copy(), panorama.valid.copy()
    column = np.arange(relief.shape[1])
    for row in range(1, relief.shape[0]):
        wanted = np.round(column - shift(np.clip(depth[row - 1], 0, 0.3), relief[row])).astype(int) % column.size
        depth[row], intensity[row], valid[row] = depth[row, wanted], intensity[row, wanted], valid[row, wanted]
    kept = {name: values for name, values in panorama.per_frame.items() if not name.startswith(TURNING)}
    return replace(panorama, depth_mm=depth, intensity=intensity, valid=valid, per_frame=kept)
