"""How far an instrument moved and rolled from frame to frame, from the overlap of the strips themselves.

Every pair of neighbours is compared by a normalised cross-correlation that is cyclic in θ, inside a window
around the nominal feed; one robust solution then reconciles all pairs. A pair that has no clear answer says
so and falls back on the nominal feed.
"""

from dataclasses import dataclass

import numpy as np
from scipy import fft
from scipy.linalg import solveh_banded

from endoct.stitching.arrays import Coordinates, Image, Mask
from endoct.stitching.circle import gaussian, wrap_rad
from endoct.stitching.errors import EndoctError

LEAST_OVERLAP = 0.15
LEAST_CORRELATION = 0.3
LEAST_RATIO = 1.3
PEAK_MM = 0.3
EDGE_MM = 0.06
MEASUREMENT_MM = 0.004
MEASUREMENT_RAD = 0.002
ROLL_PRIOR_RAD = 0.1
FEWEST_FOR_FIXED_PATTERN = 8


@dataclass(frozen=True, eq=False)
class Pairs:
    """What the overlap of each strip with the one ``step`` later says; arrays (n_pairs,) float64.

    ``feed_mm`` and ``roll_rad``: place of the later strip minus place of the earlier; ``correlation`` at the
    best place; ``ratio`` to the best place elsewhere ("I do not know" is a ratio near 1); ``trusted``.
    """

    step: int
    feed_mm: Coordinates
    roll_rad: Coordinates
    correlation: Coordinates
    ratio: Coordinates
    trusted: Mask


@dataclass(frozen=True, eq=False)
class Feed:
    """Where every strip lies; float64 (n,) unless said otherwise.

    ``z_mm`` and ``roll_rad`` relative to the first strip; ``feed_mm`` and ``turn_rad`` from the strip before
    (0 for the first); ``confidence`` of that pair, ratio of the best correlation to the next best place, and its
    ``correlation``; ``trusted``, bool: measured, not nominal (True for the first). ``direction``: −1 where
    the strips move against the nominal feed as a whole, else +1. ``measured``: whether any pair was trusted.
    """

    z_mm: Coordinates
    roll_rad: Coordinates
    feed_mm: Coordinates
    turn_rad: Coordinates
    confidence: Coordinates
    correlation: Coordinates
    trusted: Mask
    direction: int
    measured: bool


def estimate_feed(
    strips: Image,
    dz_mm: float,
    radius_mm: float,
    nominal_mm: Coordinates | None,
    *,
    valid: Mask | None = None,
    relative_sigma: float = 0.2,
) -> Feed:
    """Return feed and roll of ``strips``, float32 (n, n_rows, n_theta), z ascending and θ a full circle.

    The wall seen in row k of one strip is seen in row k − feed/``dz_mm`` of the next, and in column j of it at
    column j + roll: θ_wall = θ_strip + roll. ``nominal_mm`` (n,) is the expected place of every strip; the feed of
    a pair is believed to lie within three ``relative_sigma`` of its nominal value, in either direction of the
    whole. Without it the whole overlap is searched. ``radius_mm`` converts the peak's width to an angle;
    ``valid`` leaves samples out. Raises :class:`EndoctError` where shapes disagree.
    """
    if strips.ndim != 3 or 0 in strips.shape:
        raise EndoctError("strips to compare must be a stack", found=f"{strips.shape}", expected="(n, rows, θ)")
    n = strips.shape[0]
    if nominal_mm is not None and np.shape(nominal_mm) != (n,):
        raise EndoctError("one nominal place a strip is needed", found=f"{np.shape(nominal_mm)}", expected=f"({n},)")
    if n == 1:
        zero, one = np.zeros(1), np.ones(1)
        return Feed(zero, zero, zero, zero, one, one, np.ones(1, np.bool_), 1, False)
    textures = _textures(strips, valid, EDGE_MM / dz_mm, EDGE_MM / radius_mm / (2 * np.pi) * strips.shape[2])
    matcher = _Matcher(textures, dz_mm, radius_mm)
    steps = [step for step in (1, 2) if step < n]
    candidates = []
    for direction in (1, -1):
        pairs = [matcher.pairs(step, _windows(nominal_mm, step, direction, relative_sigma)) for step in steps]
        candidates.append((float(np.sum(pairs[0].correlation[pairs[0].trusted])), direction, pairs))
        if nominal_mm is None:
            break
    _, direction, pairs = max(candidates, key=lambda candidate: candidate[0])
    return _solve(n, pairs, None if nominal_mm is None else direction * np.diff(nominal_mm), direction, relative_sigma)


def _windows(
    nominal_mm: Coordinates | None, step: int, direction: int, relative_sigma: float
) -> list[tuple[float, float]] | None:
    if nominal_mm is None:
        return None
    feed = direction * (nominal_mm[step:] - nominal_mm[:-step])
    reach = 3 * relative_sigma * np.abs(feed) / np.sqrt(step) + 0.02
    return [(float(f - r), float(f + r)) for f, r in zip(feed, reach, strict=True)]


def _textures(strips: Image, valid: Mask | None, sigma_rows: float, sigma_columns: float) -> Image:
    """Return the strips without what every row or every strip shows alike: 0 on average, 0 where not valid."""
    missing = ~np.isfinite(strips) if valid is None else ~(valid & np.isfinite(strips))
    textures = np.where(missing, np.nan, strips).astype(np.float32)
    with np.errstate(invalid="ignore"):
        textures -= _nanmedian(textures, axis=2)[:, :, None]
        if len(textures) >= FEWEST_FOR_FIXED_PATTERN:
            textures -= _nanmedian(textures, axis=0)[None]
    textures[missing] = 0
    # edges, not areas, say where a strip lies: without this a trace of the median frame, which the cells
    # themselves leave in it, would pull every feed towards zero
    for k, texture in enumerate(textures):
        seen = (~missing[k]).astype(np.float32)
        smooth = gaussian(texture, sigma_rows, sigma_columns) / np.maximum(
            gaussian(seen, sigma_rows, sigma_columns), 0.01
        )
        textures[k] = np.where(missing[k], 0, texture - smooth)
    return textures


def _nanmedian(values: Image, axis: int) -> Image:
    """Median without NaN, and 0 where there is nothing else."""
    if not np.isnan(values).any():
        return np.asarray(np.median(values, axis=axis), dtype=np.float32)
    ordered = np.sort(values, axis=axis)
    count = np.sum(~np.isnan(values), axis=axis, keepdims=True)
    middle = np.take_along_axis(ordered, np.maximum((count - 1) // 2, 0), axis=axis)
    return np.asarray(np.where(count > 0, middle, 0).squeeze(axis), dtype=np.float32)


class _Matcher:
    """Correlates strips by their spectra, each computed once."""

    def __init__(self, textures: Image, dz_mm: float, radius_mm: float) -> None:
        self.n, self.n_rows, self.n_theta = textures.shape
        self.dz_mm = dz_mm
        self.length = fft.next_fast_len(2 * self.n_rows, real=False)
        self.textures = textures
        self.energy = np.sum(textures.astype(np.float64) ** 2, axis=2)
        self.reach_rows = max(2, round(PEAK_MM / dz_mm))
        self.reach_columns = max(2, min(self.n_theta // 4, round(PEAK_MM / radius_mm / (2 * np.pi) * self.n_theta)))

    def pairs(self, step: int, windows: list[tuple[float, float]] | None) -> Pairs:
        results = [self._pair(k, k + step, None if windows is None else windows[k]) for k in range(self.n - step)]
        feed, roll, correlation, ratio = np.array(results, dtype=np.float64).reshape(-1, 4).T
        trusted = (correlation >= LEAST_CORRELATION) & (ratio >= LEAST_RATIO)
        return Pairs(step, feed, roll, correlation, ratio, trusted)

    def _pair(self, a: int, b: int, window: tuple[float, float] | None) -> tuple[float, float, float, float]:
        """Return (feed, roll, correlation, ratio) of strip b against strip a."""
        shifts = np.arange(-(self.n_rows - 1), self.n_rows)
        overlap = (self.n_rows - np.abs(shifts)) / self.n_rows
        allowed = overlap >= LEAST_OVERLAP
        if window is not None:
            allowed &= (shifts * self.dz_mm >= window[0]) & (shifts * self.dz_mm <= window[1])
        if not allowed.any():
            return np.nan, 0.0, 0.0, 0.0
        product = self._spectrum(a) * np.conj(self._spectrum(b))
        plane = fft.irfft2(product, s=(self.length, self.n_theta))[shifts[allowed]]
        plane = plane / np.sqrt(np.maximum(self._energies(a, b, shifts[allowed]), 1e-12))[:, None]
        # a correlation over little overlap is high by chance more often
        score = plane * np.sqrt(overlap[allowed])[:, None]
        row, column = np.unravel_index(int(np.argmax(score)), score.shape)
        best = float(plane[row, column])
        elsewhere = np.roll(score, -int(column), axis=1)
        keep = np.ones(score.shape, np.bool_)
        rows_near = np.abs(np.arange(len(score)) - row) <= self.reach_rows
        columns_near = np.minimum(np.arange(self.n_theta), self.n_theta - np.arange(self.n_theta)) <= self.reach_columns
        keep[np.ix_(rows_near, columns_near)] = False
        second = max(float(elsewhere[keep].max()) if keep.any() else 0.0, 0.02)
        fine_row = _vertex(score[:, column], int(row), cyclic=False)
        fine_column = _vertex(score[row], int(column), cyclic=True)
        feed = (shifts[allowed][0] + fine_row) * self.dz_mm
        roll = float(wrap_rad(2 * np.pi * fine_column / self.n_theta))
        return float(feed), roll, best, float(score[row, column]) / second

    def _spectrum(self, k: int) -> np.ndarray:
        return np.asarray(fft.rfft2(self.textures[k], s=(self.length, self.n_theta)))

    def _energies(self, a: int, b: int, shifts: np.ndarray) -> Coordinates:
        """Energy of both strips' rows that overlap at each shift (row of a minus row of b), multiplied."""
        sums_a, sums_b = (np.concatenate([[0.0], np.cumsum(self.energy[k])]) for k in (a, b))
        first = np.maximum(shifts, 0)
        last = np.minimum(self.n_rows + shifts, self.n_rows)
        product: Coordinates = (sums_a[last] - sums_a[first]) * (sums_b[last - shifts] - sums_b[first - shifts])
        return product


def _vertex(values: np.ndarray, at: int, *, cyclic: bool) -> float:
    """Return the place of the parabola's top through the sample ``at`` and its neighbours."""
    n = len(values)
    if not cyclic and not 0 < at < n - 1:
        return float(at)
    before, here, after = float(values[at - 1]), float(values[at]), float(values[(at + 1) % n])
    bend = before - 2 * here + after
    return at + (0.5 * (before - after) / bend if bend < 0 else 0.0)


def _solve(n: int, pairs: list[Pairs], prior_mm: Coordinates | None, direction: int, relative_sigma: float) -> Feed:
    """Return the places that agree best with all trusted pairs and, weakly, with the nominal feed."""
    first = pairs[0]
    if prior_mm is None:
        typical = float(np.median(first.feed_mm[first.trusted])) if first.trusted.any() else 0.0
        prior_mm = np.full(n - 1, typical)
    sigma_mm = np.maximum(relative_sigma * np.abs(prior_mm), 0.01)
    z_start = np.concatenate([[0.0], np.cumsum(np.where(first.trusted, first.feed_mm, prior_mm))])
    z, z_agree = _robust_chain(
        z_start, [(p.step, p.feed_mm, p.trusted) for p in pairs], prior_mm, sigma_mm, MEASUREMENT_MM, cyclic=False
    )
    roll_start = np.concatenate([[0.0], np.cumsum(np.where(first.trusted, first.roll_rad, 0.0))])
    roll, roll_agree = _robust_chain(
        roll_start,
        [(p.step, p.roll_rad, p.trusted) for p in pairs],
        np.zeros(n - 1),
        np.full(n - 1, ROLL_PRIOR_RAD),
        MEASUREMENT_RAD,
        cyclic=True,
    )
    # a pair that the others overrule was not right, however clear it looked
    trusted = first.trusted & z_agree & roll_agree
    begin = np.ones(1)
    return Feed(
        z_mm=z,
        roll_rad=roll,
        feed_mm=np.concatenate([[0.0], np.diff(z)]),
        turn_rad=np.concatenate([[0.0], np.diff(roll)]),
        confidence=np.concatenate([begin, first.ratio]),
        correlation=np.concatenate([begin, first.correlation]),
        trusted=np.concatenate([np.ones(1, np.bool_), trusted]),
        direction=direction,
        measured=bool(trusted.any()),
    )


def _robust_chain(
    start: Coordinates,
    links: list[tuple[int, Coordinates, Mask]],
    prior: Coordinates,
    prior_sigma: Coordinates,
    sigma: float,
    *,
    cyclic: bool,
) -> tuple[Coordinates, Mask]:
    """Return places by least squares with Cauchy weights on the links, and which links of step 1 agree.

    Iteratively reweighted; the normal equations have two bands beside the diagonal. The first place stays 0.
    """
    n = start.size
    place = start.copy()
    agree = np.ones(n - 1, np.bool_)
    for _ in range(30):
        bands = np.zeros((3, n))
        right = np.zeros(n)
        bands[2, 0] += 1e12
        for step, value, trusted, weight in [
            (1, prior, np.ones(n - 1, np.bool_), 1 / prior_sigma**2),
            *((s, v, t, np.full(v.size, 1 / sigma**2)) for s, v, t in links),
        ]:
            misfit = np.where(trusted, np.nan_to_num(value), 0.0) - (place[step:] - place[:-step])
            misfit = wrap_rad(misfit) if cyclic else misfit
            weight = np.where(trusted, weight / (1 + misfit**2 * weight / 9), 0.0)
            bands[2, :-step] += weight
            bands[2, step:] += weight
            bands[2 - step, step:] -= weight
            right[step:] += weight * misfit
            right[:-step] -= weight * misfit
        change = solveh_banded(bands, right)
        place += change
        if np.abs(change).max() < 1e-9:
            break
    for step, value, trusted in links[:1]:
        misfit = np.nan_to_num(value) - (place[step:] - place[:-step])
        misfit = wrap_rad(misfit) if cyclic else misfit
        agree = ~trusted | (np.abs(misfit) <= 6 * sigma)
    return place, agree
