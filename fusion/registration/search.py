"""The exhaustive search: every turn, every shift, a range of z scales, every orientation left open.

Its maps are masked normalised cross-correlation on the cylinder: θ is a circle, z is a line. The score says how much
a correlation is worth; :func:`chance_of` says how likely chance alone would give as much.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.numeric.circle import wrap_rad
from endoct.fusion.evidence.evidence import Evidence, blurred, on_grid, reoriented
from endoct.fusion.geometry.alignment import ALL_ORIENTATIONS, Alignment, Orientation

PIECE_MM2 = 0.25
"""Area over which the evidence is correlated, as the search sees it: one independent piece of wall."""
FEWEST_PIECES = 4
SHUFFLES = 16
SLICE_MM = 1.0
"""Height of the rings that a shuffle turns; cells, which must stay whole, are smaller."""
EULER = 0.5772156649
SEARCH_DZ_MM = 0.08
SEARCH_COLUMNS = 128
SEARCH_BAND_MM = (0.06, 0.3)
"""The structure that is searched for, as sigmas of two Gaussians. Smaller structure is noise. Larger structure has too
few independent pieces on one bore's wall to tell places apart."""
RIM_MM = 0.05
"""Blur of the evidence whose steepness shows the rims."""
DISTINCT_MM = 0.75
"""Two places nearer than this are one peak."""


@dataclass(frozen=True, eq=False)
class Spectra:
    """Fourier transforms of an image, its square and its mask, complex64, z padded to ``n_padded`` rows."""

    values: NDArray[np.complex64]
    squares: NDArray[np.complex64]
    mask: NDArray[np.complex64]
    n_z: int
    n_theta: int
    n_padded: int


def spectra(image: Image, valid: Mask, n_padded: int) -> Spectra:
    """Return the transforms of a float32 (n_z, n_theta) image of which only ``valid`` samples count."""
    # without its mean the sums of squares stay small, which float32 needs
    centred = np.where(valid, image - image[valid].mean(), np.float32(0)) if valid.any() else np.zeros_like(image)
    shape = n_padded, image.shape[1]
    values, squares, mask = (
        np.asarray(fft.rfft2(part, shape), dtype=np.complex64)
        for part in (centred, centred * centred, valid.astype(np.float32))
    )
    return Spectra(values, squares, mask, image.shape[0], image.shape[1], n_padded)


def padded_rows(n_a: int, n_b: int) -> int:
    """Return the number of rows to which images of ``n_a`` and ``n_b`` rows must be padded to correlate them."""
    return int(fft.next_fast_len(n_a + n_b - 1, real=True))


def correlate(fixed: Spectra, moved: Evidence) -> tuple[Image, Image]:
    """Return (correlation, overlap) of ``moved`` shifted over ``fixed``, as :func:`masked_correlation` does."""
    return masked_correlation(fixed, spectra(moved.values, moved.valid, fixed.n_padded))


def masked_correlation(a: Spectra, b: Spectra) -> tuple[Image, Image]:
    """Return (correlation, overlap) of ``b`` shifted over ``a`` for every shift, both float32 (n_lags, n_theta).

    Row i is the z lag i − (n_z of b − 1), column k the θ lag k. So b[y, x] meets a[y + lag_z, (x + lag_θ) mod n].
    The correlation is Pearson's over the samples valid in both (Padfield 2012, Masked object registration in
    the Fourier domain); ``overlap`` counts them. Both must have the same number of columns and padded rows.
    """
    n_lags = a.n_z + b.n_z - 1

    def shifts(of_a: NDArray[np.complex64], of_b: NDArray[np.complex64]) -> Image:
        lags = np.asarray(fft.irfft2(of_a * np.conj(of_b), (a.n_padded, a.n_theta)), dtype=np.float32)
        return np.roll(lags, b.n_z - 1, axis=0)[:n_lags]

    overlap = np.maximum(np.rint(shifts(a.mask, b.mask)), 0)
    count = np.maximum(overlap, 1)
    sum_a, sum_b = shifts(a.values, b.mask), shifts(a.mask, b.values)
    variance_a = shifts(a.squares, b.mask) - sum_a * sum_a / count
    variance_b = shifts(a.mask, b.squares) - sum_b * sum_b / count
    covariance = shifts(a.values, b.values) - sum_a * sum_b / count
    scale = np.sqrt(np.maximum(variance_a, 0) * np.maximum(variance_b, 0))
    # shifts that meet next to no structure have no correlation worth the name
    enough = scale > max(1e-3 * float(scale.max()), 1e-30)
    ratio = np.divide(covariance, scale, out=np.zeros_like(scale), where=enough)
    return np.clip(ratio, -1, 1).astype(np.float32), overlap.astype(np.float32)


def score(correlation: Image, overlap_mm2: Image) -> Image:
    """Return how far from chance each correlation is, float32 of the same shape, in standard deviations.

    Fisher's transform artanh(r) of a correlation by chance scatters with 1/√(n − 3), n the independent pieces of wall
    in the overlap. Where there are too few the score is 0.
    """
    pieces = overlap_mm2 / np.float32(PIECE_MM2) - FEWEST_PIECES
    strength = np.arctanh(np.minimum(np.abs(correlation), np.float32(0.999)))
    return np.asarray(strength * np.sqrt(np.maximum(pieces, 0)), dtype=np.float32)


def chance_of(best: float, a: Evidence, b: Evidence, orientation: Orientation, n_maps: int) -> float:
    """Return how likely ``b`` would reach the score ``best`` somewhere on ``a`` in ``n_maps`` maps if it did not match.

    A permutation null: rings of ``b``, ``SLICE_MM`` high, are turned at random against each other. So cells and light
    stay as they are, but no place is right any more. Nor is any orientation other than ``orientation``; the shuffled
    are laid on ``a`` only in these. Gumbel's distribution of extremes is fitted to the highest scores of all maps.

    ``a`` and ``b`` have rows and columns of one spacing. The same arguments give the same answer.
    """
    random = np.random.default_rng(0)
    fixed = spectra(a.values, a.valid, padded_rows(a.z_mm.size, b.z_mm.size))
    sample_mm2 = np.float32(a.dz_mm * a.column_mm)
    highest = []
    for _ in range(SHUFFLES):
        shuffled = _shuffled(b, random)
        for mirrored, z_reversed in ALL_ORIENTATIONS:
            if (mirrored, z_reversed) == orientation:
                continue
            turned = reoriented(shuffled, mirrored=mirrored, z_reversed=z_reversed, z_scale=1.0)
            correlation, overlap = correlate(fixed, turned)
            highest.append(float(score(correlation, overlap * sample_mm2).max()))
    width = max(float(np.std(highest, ddof=1)) * np.sqrt(6) / np.pi, 1e-6)
    mode = float(np.mean(highest)) - EULER * width
    return float(-np.expm1(-n_maps * np.exp(-min((best - mode) / width, 700.0))))


def _shuffled(evidence: Evidence, random: np.random.Generator) -> Evidence:
    """Return ``evidence`` with its rings turned at random."""
    values, valid = evidence.values.copy(), evidence.valid.copy()
    height = max(1, round(SLICE_MM / evidence.dz_mm))
    for first in range(-int(random.integers(height)), values.shape[0], height):
        ring = slice(max(first, 0), first + height)
        turn = int(random.integers(values.shape[1]))
        values[ring], valid[ring] = np.roll(values[ring], turn, axis=1), np.roll(valid[ring], turn, axis=1)
    return replace(evidence, values=values, valid=valid)


def search(
    a: Evidence, b: Evidence, orientations: tuple[Orientation, ...], z_scale_range: tuple[float, float]
) -> Alignment | None:
    """Return the best place on the grid of the search; None where nothing correlates at all."""
    grid_a = _searchable(a)
    candidates: list[tuple[float, Alignment]] = []
    for scale in _scales(a, b, z_scale_range):
        grid_b = _searchable(reoriented(b, mirrored=False, z_reversed=False, z_scale=float(scale)))
        fixed = spectra(grid_a.values, grid_a.valid, padded_rows(grid_a.z_mm.size, grid_b.z_mm.size))
        for mirrored, z_reversed in orientations:
            turned = reoriented(grid_b, mirrored=mirrored, z_reversed=z_reversed, z_scale=1.0)
            maps = correlate(fixed, turned)
            start = Alignment(
                theta_shift_rad=-turned.theta0_rad,
                z_shift_mm=float(grid_a.z_mm[0] - turned.z_mm[0]) - (turned.z_mm.size - 1) * SEARCH_DZ_MM,
                z_scale=float(scale),
                mirrored=mirrored,
                z_reversed=z_reversed,
            )
            candidates += _peaks(*maps, start, grid_a.column_mm)
    if not candidates:
        return None
    best_score, best = max(candidates, key=lambda candidate: candidate[0])
    z_middle = float(b.z_mm[[0, -1]].mean())
    others = [s for s, other in candidates if not _same_place(best, other, z_middle, a.radius_mm)]
    ratio = min(best_score / max(max(others, default=0.0), 1e-6), 100.0)
    stretched = _searchable(reoriented(b, mirrored=False, z_reversed=False, z_scale=best.z_scale))
    n_maps = len(orientations) * len(_scales(a, b, z_scale_range))
    return replace(
        best,
        ratio=ratio,
        chance=chance_of(best_score, grid_a, stretched, (best.mirrored, best.z_reversed), n_maps),
        confidence=abs(best.correlation) * (1 - 1 / ratio),
    )


def rims(evidence: Evidence) -> Evidence:
    """Return how steep ``evidence`` is, the root of it: high along the rims of cells, whether they are dark or lit."""
    blurry = blurred(evidence, RIM_MM).values
    along = np.gradient(blurry, evidence.z_mm, axis=0) if evidence.z_mm.size > 1 else np.zeros_like(blurry)
    around = (np.roll(blurry, -1, axis=1) - np.roll(blurry, 1, axis=1)) / np.float32(2 * evidence.column_mm)
    return replace(evidence, values=np.sqrt(np.hypot(along, around)).astype(np.float32))


def _scales(a: Evidence, b: Evidence, z_scale_range: tuple[float, float]) -> Coordinates:
    """Return z scales so close that between two of them no end of the overlap is off by more than a row."""
    low, high = z_scale_range
    length_mm = min(float(np.ptp(a.z_mm)), float(np.ptp(b.z_mm)))
    n = 1 + int(np.ceil((high - low) * length_mm / (4 * SEARCH_DZ_MM)))
    return np.linspace(low, high, n) if n > 1 else np.array([(low + high) / 2])


def _peaks(correlation: Image, overlap: Image, start: Alignment, column_mm: float) -> Iterator[tuple[float, Alignment]]:
    """Yield (score, alignment) of the two best, distinct places; sample (0, 0) of the maps is at ``start``."""
    scores = score(correlation, overlap * np.float32(SEARCH_DZ_MM * column_mm))
    n_z, n_theta = scores.shape
    for _ in range(2):
        row, column = np.unravel_index(int(np.argmax(scores)), scores.shape)
        if not scores[row, column] > 0:
            return
        yield (
            float(scores[row, column]),
            replace(
                start,
                theta_shift_rad=float(np.mod(start.theta_shift_rad + 2 * np.pi * column / n_theta, 2 * np.pi)),
                z_shift_mm=start.z_shift_mm + float(row) * SEARCH_DZ_MM,
                correlation=float(correlation[row, column]),
                overlap_mm2=float(overlap[row, column]) * SEARCH_DZ_MM * column_mm,
            ),
        )
        rows = np.abs(np.arange(n_z) - row) * SEARCH_DZ_MM < DISTINCT_MM
        off = np.abs(np.arange(n_theta) - column)
        columns = np.minimum(off, n_theta - off) * column_mm < DISTINCT_MM
        scores[np.ix_(rows, columns)] = 0


def _searchable(evidence: Evidence) -> Evidence:
    n = max(1, int(np.floor(float(np.ptp(evidence.z_mm)) / SEARCH_DZ_MM)) + 1)
    grid = on_grid(evidence, evidence.z_mm[0] + SEARCH_DZ_MM * np.arange(n), SEARCH_COLUMNS)
    fine, slow = (blurred(grid, sigma_mm).values for sigma_mm in SEARCH_BAND_MM)
    return replace(grid, values=np.where(grid.valid, fine - slow, np.float32(0)))


def _same_place(a: Alignment, b: Alignment, z_middle_mm: float, radius_mm: float) -> bool:
    if (a.mirrored, a.z_reversed) != (b.mirrored, b.z_reversed):
        return False
    off_rad = wrap_rad(a.theta_shift_rad - b.theta_shift_rad)
    off_mm = a.z_to_a(z_middle_mm) - b.z_to_a(z_middle_mm)
    return bool(abs(off_rad) * radius_mm < DISTINCT_MM and abs(off_mm) < DISTINCT_MM)
