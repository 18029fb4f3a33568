"""The simplest competent chain, as a rival: what an afternoon with NumPy and SciPy gives where everything is known.

It is given the annulus, the visible length and the sheath's size, trusts a linear view, a catheter that stays where it
is and the nominal slices, and never says that it does not know.
"""

from itertools import pairwise

import numpy as np
from scipy import ndimage
from skimage.filters import threshold_li

from benchmarks.independent.bore import Floats
from benchmarks.independent.catheter import Pullback
from benchmarks.independent.judge import Wall
from benchmarks.independent.ours import Answer
from benchmarks.independent.pair import Pair
from benchmarks.independent.recipe import Recipe
from benchmarks.independent.truth import Place

COLUMNS, STEP_MM, DEEPEST_MM = 720, 0.02, 0.4


def simplest_answer(pair: Pair) -> Answer:
    """Return the chain's answer to a pair at hand."""
    endoscope, darkness = _endoscope(pair)
    oct_, relief = simplest_oct(pair.oct, pair.recipe)
    senses = (False,) if pair.recipe.oct.states_handedness else (False, True)
    found = [_lay(darkness, endoscope, relief, oct_, sense) for sense in senses]
    return Answer(endoscope, oct_, max(found, key=lambda one: one[0])[1])


def _endoscope(pair: Pair) -> tuple[Wall, Floats]:
    recipe, journey = pair.recipe.endoscope, pair.endoscope
    optics, length = journey.optics, journey.optics.band_mm[1] - journey.optics.band_mm[0]
    theta = 2 * np.pi * np.arange(COLUMNS) / COLUMNS
    n = int(0.94 * length / STEP_MM)
    along = np.linspace(0.03, 0.97, n)[:, None]
    radius = optics.inner_px + (recipe.outer_px - optics.inner_px) * (along if recipe.ahead else along[::-1])
    at = optics.centre_px[1] + radius * np.sin(theta), optics.centre_px[0] + radius * np.cos(theta)
    step = 0.94 * length / (n - 1)
    frames = journey.frames if recipe.travel == "in" else journey.frames[::-1]
    strips = np.stack([ndimage.map_coordinates(f.astype(float), at, order=1) for f in frames])
    strips /= np.maximum(ndimage.gaussian_filter1d(np.median(strips, axis=0), 40, axis=1, mode="wrap"), 1)
    feed = np.cumsum([0, *(_shift(a, b) for a, b in pairwise(strips))])
    total = np.zeros((n + int(feed[-1]) + 1, COLUMNS))
    count = np.zeros((total.shape[0], 1))
    for start, strip in zip(feed.astype(int), strips, strict=True):
        total[start : start + n] += strip
        count[start : start + n] += 1
    picture = ndimage.gaussian_filter(total / np.maximum(count, 1), (1.5, 2), mode=("nearest", "wrap"))
    darkness = -np.log(np.maximum(picture / np.median(picture), 0.05))
    cells = darkness > threshold_li(darkness)
    # z = 0 is the middle of the first strip
    z = step * (np.arange(total.shape[0]) - (n - 1) / 2)
    return Wall(picture.astype(np.float32), cells, np.broadcast_to(count > 0, cells.shape), z, theta), darkness


def _shift(first: Floats, second: Floats) -> int:
    """Return by how many rows the second strip lies farther in: where the two correlate best."""
    n = len(first)
    return max(
        range(1, int(0.6 * n)), key=lambda k: float(np.corrcoef(first[k:].ravel(), second[: n - k].ravel())[0, 1])
    )


def simplest_oct(pullback: Pullback, of: Recipe) -> tuple[Wall, Floats]:
    """Return wall and cells by a pullback alone, and the wall's relief (z, θ) in mm."""
    recipe = of.oct
    samples = pullback.samples[:: -1 if recipe.travel == "out" else 1].astype(float)
    stack = 20 * np.log10(samples + 1) if recipe.linear else samples
    factor = recipe.fault_size if recipe.fault == "capillary" else 1.0
    outer, pixel = factor * recipe.capillary_outer_mm / 2, recipe.axial_pixel_mm
    alpha = 2 * np.pi * np.arange(recipe.a_scans) / recipe.a_scans
    ridge = (ndimage.gaussian_filter1d(stack, 1.2, axis=1) - ndimage.gaussian_filter1d(stack, 6, axis=1)).mean(axis=0)
    ridge[: int((recipe.sheath_mm / 2 + 0.03 - recipe.first_sample_mm) / pixel)] = 0
    best, e, beta, face = -np.inf, 0.0, 0.0, np.zeros(0)
    some = np.arange(0, alpha.size, 8)
    for offset in np.arange(0, 0.4, 0.005):
        for side in np.arange(0, 2 * np.pi, 0.05):
            shape = _to_wall(alpha, offset, side, outer) - outer
            rows = np.arange(len(ridge))[:, None] + np.rint(shape[some] / pixel).astype(int)
            along = ridge[np.clip(rows, 0, len(ridge) - 1), some].mean(axis=1)
            peaks = np.sort(along)[-3:].sum()
            if peaks > best:
                strong = np.flatnonzero(along > 0.5 * along.max())
                best, e, beta, face = peaks, offset, side, strong[-1] + shape / pixel
    smooth = ndimage.gaussian_filter(stack, (0, 2, 1), mode=("nearest", "nearest", "wrap"))
    depth = np.arange(len(ridge))[:, None]
    behind = (depth > face + 0.06 / pixel)[None]
    low, high = np.percentile(smooth[:, :15], 50), np.percentile(smooth[np.broadcast_to(behind, smooth.shape)], 80)
    is_bone = (smooth > (low + high) / 2) & behind
    first = np.where(is_bone.any(axis=1), is_bone.argmax(axis=1), len(ridge))
    reach = _to_wall(alpha, e, beta, outer) + (first - face) * pixel
    x, y = e * np.cos(beta) + reach * np.cos(alpha), e * np.sin(beta) + reach * np.sin(alpha)
    relief_there, theta_there = np.hypot(x, y) - of.bore.diameter_mm / 2, np.mod(np.arctan2(y, x), 2 * np.pi)
    relief = np.stack([
        np.interp(alpha, t[o], r[o], period=2 * np.pi)
        for r, t, o in zip(relief_there, theta_there, np.argsort(theta_there, axis=1), strict=True)
    ])  # fmt: skip
    if recipe.states_handedness and recipe.mirrored:
        relief = relief[:, -np.arange(alpha.size) % alpha.size]
    relief -= np.median(relief)
    cells = relief > threshold_li(np.clip(relief, 0, DEEPEST_MM))
    stated = recipe.pitch_mm * (recipe.fault_size if recipe.fault == "pitch" else 1.0)
    valid = np.ones(cells.shape, np.bool_)
    return Wall(relief.astype(np.float32), cells, valid, stated * np.arange(len(relief)), alpha), relief


def _to_wall(alpha: Floats, offset: float, side: float, radius: float) -> Floats:
    across = offset * np.sin(alpha - side)
    return np.asarray(np.sqrt(radius**2 - across**2) - offset * np.cos(alpha - side))


def _lay(darkness: Floats, a: Wall, relief: Floats, b: Wall, mirrored: bool) -> tuple[float, Place]:
    """Return how well B fits on A at its best, and where: every θ by FFT at every z shift, rows ``STEP_MM`` apart."""
    z_a, z_b = (np.arange(w.z_mm[0], w.z_mm[-1], STEP_MM) for w in (a, b))
    one = _resampled(np.clip(darkness, 0, 1), a, z_a, False)
    two = _resampled(np.clip(relief, 0, DEEPEST_MM), b, z_b, mirrored)
    spectra = np.fft.rfft(one, axis=1), np.fft.rfft(two, axis=1).conj()
    best: tuple[float, int, int] = (-1.0, 0, 0)
    least = min(len(one), len(two)) // 2
    for shift in range(least - len(two), len(one) - least):  # row of A on which row 0 of B lies
        low, high = max(0, shift), min(len(one), shift + len(two))
        p, q = slice(low, high), slice(low - shift, high - shift)
        n = (high - low) * COLUMNS
        product = np.fft.irfft((spectra[0][p] * spectra[1][q]).sum(axis=0), COLUMNS) / n
        score = (product - one[p].mean() * two[q].mean()) / max(float(one[p].std() * two[q].std()), 1e-9)
        if score.max() > best[0]:
            best = float(score.max()), shift, int(score.argmax())
    return best[0], Place(2 * np.pi * best[2] / COLUMNS, float(z_a[0] + best[1] * STEP_MM - z_b[0]), mirrored=mirrored)


def _resampled(values: Floats, wall: Wall, z_mm: Floats, mirrored: bool) -> Floats:
    rows = np.interp(z_mm, wall.z_mm, np.arange(wall.z_mm.size))
    columns = (-1 if mirrored else 1) * np.arange(COLUMNS) * (wall.theta_rad.size / COLUMNS)
    return np.asarray(
        ndimage.map_coordinates(values, np.meshgrid(rows, columns, indexing="ij"), order=1, mode="grid-wrap")
    )
