"""Light and dirt of the probe, estimated from the recording itself.

In logarithms a frame is light(r, θ_image) + pattern(r, θ_image) + wall. Light is a profile along r (the
specular ring of the mirror is part of it) with a few harmonics in θ. Dirt and scratches are the pattern, which
stays where it is while the wall moves on. Cells are dark and may cover much of a short recording. So light
follows the bright side of what is seen, and a pattern is looked for only where the wall has moved far enough.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.compute.compiled import compiled
from endoct.base.compute.memory import Room
from endoct.base.numeric.ranks import quantile, robust_sigma

WALL_QUANTILE = 0.6
VIEWS_FOR_PATTERN = 6
MOST_FRAMES = 48
SURE_PATTERN = 0.06
SATURATED_LOG = -0.01
SURE_EXPOSURE = 0.06
EVEN_COLUMNS = 512
LEAST_EVEN, MOST_EVEN = np.float32(-0.3), np.float32(0.3)


@dataclass(frozen=True, eq=False)
class FlatField:
    """``log_light``: natural logarithm of the light on bone, float32 (n_rows, n_theta), image angles; ``usable``:
    not covered by dirt. ``pattern``: what of the light is dirt and scratches, in the same unit.
    """

    log_light: Image
    pattern: Image
    usable: Mask

    def by_z(self, rim_sign: int) -> "FlatField":
        """Return the flat field of rows outward in the image as that of rows by ascending z."""
        step = slice(None, None, rim_sign)
        rows = np.ascontiguousarray
        return FlatField(rows(self.log_light[step]), rows(self.pattern[step]), rows(self.usable[step]))

    def transmission(self, rows: Coordinates, columns: Coordinates, room: Room | None = None) -> Image:
        """Return how much light there is at every pair of fractional rows and columns, θ a circle; NaN under dirt.

        Interpolated bilinearly, and so is dirt: a place is dirty where most of it is. An array of ``room``, if any.
        """
        light: Image = (room or Room()).array("light", (rows.size, columns.size))
        _pairs(self.log_light, self.usable, rows, np.mod(columns, self.usable.shape[1]), light)
        return np.exp(light, out=light)


def enough_frames(n: int) -> list[int]:
    """Return the indices of the frames, spread over all ``n``, from which a flat field is estimated."""
    return [int(k) for k in np.unique(np.linspace(0, n - 1, min(n, MOST_FRAMES)).round())]


def estimate_flat_field(logs: NDArray[np.floating[Any]], views: float, least_transmission: float) -> FlatField:
    """Return the flat field of strips in logarithms, (n, n_rows, n_theta), NaN outside the image.

    ``views``: how many different places of the wall each pixel has seen; ``least_transmission``: dirt that takes
    more light than that is not usable.
    """
    chosen = enough_frames(len(logs))
    typical = _quantile(logs[chosen], WALL_QUANTILE) if len(chosen) > 1 else np.asarray(logs[0], np.float32)
    light = _light(typical, harmonics=3 if views >= VIEWS_FOR_PATTERN else 2)
    seen = np.isfinite(typical)
    pattern = np.zeros_like(light)
    if views >= VIEWS_FOR_PATTERN:
        pattern = _pattern(np.where(seen, typical - light, 0.0).astype(np.float32))
    usable = np.exp(pattern) >= least_transmission
    return FlatField(light + pattern, pattern, np.asarray(usable & seen))


def frame_exposure(logs: Iterable[NDArray[np.floating[Any]]], flat: FlatField) -> Coordinates:
    """Return by how much each frame is brighter than the recording, natural logarithm, float64 (n,).

    Judged by the bright fifth of a frame, which is bone unless a cell fills nearly all of it. Cells and texture
    move even that by a few per cent, so only what goes beyond is taken for a change of exposure.
    """
    evened = (frame - flat.log_light for frame in logs)
    bright = [
        quantile(seen, 0.8) if (seen := strip[flat.usable & np.isfinite(strip)]).size else 0.0 for strip in evened
    ]
    change = np.array(bright) - np.median(bright)
    return np.asarray(np.sign(change) * np.maximum(np.abs(change) - SURE_EXPOSURE, 0))


def even_strip(logs: NDArray[np.floating[Any]], flat: FlatField, exposure: float) -> Image:
    """Return a strip in logarithms without light and exposure, float32 (n_rows, ``EVEN_COLUMNS``), NaN under dirt.

    Limited on both sides, so that neither a specular spot nor a deep cell decides how frames are matched.
    """
    even = np.empty((len(logs), EVEN_COLUMNS), np.float32)
    _evened(logs.astype(np.float32), flat.log_light, flat.usable, np.float32(exposure), even)
    return even


@compiled
def _evened(logs: Image, light: Image, usable: Mask, exposure: np.float32, even: Image) -> None:
    """Write the means of ``logs`` less light and exposure within limits, of equal parts of every row."""
    n = logs.shape[1] // even.shape[1]
    for k in range(even.shape[0]):
        for j in range(even.shape[1]):
            total = np.float32(0)
            for i in range(j * n, (j + 1) * n):
                part = min(max(logs[k, i] - light[k, i] - exposure, LEAST_EVEN), MOST_EVEN)
                total += part if usable[k, i] else np.float32(np.nan)
            even[k, j] = total / np.float32(n)


def _quantile(logs: NDArray[np.floating[Any]], share: float) -> Image:
    """Return a quantile over the strips, NaN only where none has a sample."""
    result = np.empty(logs.shape[1:], np.float32)
    for row in range(logs.shape[1]):
        ordered = np.array(logs[:, row].T, np.float32, order="C")  # what is sorted lies in one piece
        ordered.sort(axis=1)
        count = np.count_nonzero(np.isfinite(ordered), axis=1)
        at = np.floor(share * np.maximum(count - 1, 0)).astype(np.intp)
        result[row] = ordered[np.arange(len(ordered)), at]
    return result


def _light(typical: Image, harmonics: int) -> Image:
    """Return a profile along r plus harmonics in θ that follow the bright side of ``typical`` robustly.

    It begins with least squares; then what is darker than the rest is believed less and less. So the darker side of
    the light is not taken for a cell.
    """
    n_rows, n_theta = typical.shape
    theta = 2 * np.pi / n_theta * np.arange(n_theta)
    waves = np.stack([f(k * theta) for k in range(1, harmonics + 1) for f in (np.cos, np.sin)])
    along = np.linspace(-1, 1, n_rows) if n_rows > 1 else np.zeros(1)
    every = slice(None, None, max(1, n_theta // 256))
    coarse = typical[:, every].astype(np.float64)
    seen = np.isfinite(coarse)
    coarse = np.where(seen, coarse, 0.0)
    few = waves[:, every]
    profile = np.array([quantile(row[s], 0.6) if s.any() else 0.0 for row, s in zip(coarse, seen, strict=True)])
    weight_of_wave = np.zeros((2, len(few)))
    clipped = coarse >= SATURATED_LOG
    for tightness in np.geomspace(8, 1, 12).tolist() + [1.0] * 8:
        misfit = coarse - profile[:, None] - _waving(weight_of_wave, few, along)
        above = misfit[seen & (misfit > 0)]
        scale = max(0.02, robust_sigma(above)) if above.size else 0.02
        reach = np.where(misfit < 0, 1.5 * scale, 3 * scale) * tightness
        weight = np.where(seen, 1 / (1 + (misfit / reach) ** 2) ** 2, 0.0)
        weight[clipped & (misfit < 0)] = 0  # the light may well be brighter than the camera could say
        # every wave depends on the column alone, so sums over rows are taken first
        ridge = 1e-4 * weight.sum() + 1e-9
        sums = [along**power @ weight for power in range(3)]
        normal = np.block([[few * sums[i + j] @ few.T for j in (0, 1)] for i in (0, 1)])
        pull = np.concatenate([few @ (along**power @ (weight * misfit)) for power in (0, 1)])
        pull -= ridge * weight_of_wave.ravel()
        weight_of_wave += np.linalg.solve(normal + ridge * np.eye(pull.size), pull).reshape(2, -1)
        rest = coarse - _waving(weight_of_wave, few, along)
        total = weight.sum(axis=1)
        profile = np.where(total > 1e-6, (weight * rest).sum(axis=1) / np.maximum(total, 1e-6), profile)
    return np.asarray(profile[:, None] + _waving(weight_of_wave, waves, along), dtype=np.float32)


def _waving(weights: Coordinates, waves: Coordinates, along: Coordinates) -> Coordinates:
    """Return the sum of all ``waves`` (n, n_theta), even along r and growing with it, by ``weights`` (2, n)."""
    even, growing = weights @ waves
    return np.asarray(even + along[:, None] * growing)


def _pattern(residual: Image) -> Image:
    """Return what stands out locally. Residues of cells along a line of the wall are smooth along r."""
    levels = np.clip(residual / 1.5 * 127 + 128, 0, 255).astype(np.uint8)
    reach = max(5, 2 * (residual.shape[0] // 6) + 1)
    padded = np.pad(levels, ((reach, reach), (0, 0)), mode="reflect" if residual.shape[0] > reach else "edge")
    padded = np.pad(padded, ((0, 0), (reach, reach)), mode="wrap")
    ground = cv2.medianBlur(padded, reach)[reach:-reach, reach:-reach]
    local = residual - (ground.astype(np.float32) - 128) / 127 * 1.5
    return np.asarray(local * (local**2 / (local**2 + SURE_PATTERN**2)), dtype=np.float32)


@compiled
def _pairs(image: Image, usable: Mask, rows: Coordinates, columns: Coordinates, pairs: Image) -> None:
    """Write ``image`` bilinearly, cyclic in θ, at pairs of ``rows`` and ``columns``; NaN where half is not usable."""
    n_rows, n_theta = image.shape
    left, beside = np.empty(columns.size, np.int64), np.empty(columns.size, np.int64)
    beyond = np.empty(columns.size, np.float32)
    for j in range(columns.size):
        whole = int(columns[j])
        left[j], beside[j], beyond[j] = whole % n_theta, (whole + 1) % n_theta, columns[j] - whole
    across, known = np.empty((n_rows, columns.size), np.float32), np.empty((n_rows, columns.size), np.float32)
    for k in range(n_rows):
        for j in range(columns.size):
            one, two = image[k, left[j]], image[k, beside[j]]
            across[k, j] = one + beyond[j] * (two - one)
            of_one, of_two = np.float32(usable[k, left[j]]), np.float32(usable[k, beside[j]])
            known[k, j] = of_one + beyond[j] * (of_two - of_one)
    for i in range(rows.size):
        row = min(max(rows[i], 0.0), n_rows - 1.0)
        top = min(int(row), n_rows - 2)
        share = np.float32(row - top)
        near, far, of_near, of_far = across[top], across[top + 1], known[top], known[top + 1]
        for j in range(columns.size):
            clean = of_near[j] + share * (of_far[j] - of_near[j]) > np.float32(0.5)
            pairs[i, j] = near[j] + share * (far[j] - near[j]) if clean else np.float32(np.nan)
