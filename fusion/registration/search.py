"""The exhaustive search: every turn, every shift, a range of z scales, every orientation left open."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from endoct.fusion.evidence.evidence import Evidence, blurred, on_grid, reoriented
from endoct.fusion.geometry.alignment import Alignment, Orientation
from endoct.fusion.registration.chance import chance_of, score
from endoct.fusion.registration.correlation import correlate, padded_rows, spectra
from endoct.stitching.arrays import Coordinates, Image
from endoct.stitching.circle import wrap_rad

SEARCH_DZ_MM = 0.08
SEARCH_COLUMNS = 128
SEARCH_BAND_MM = (0.06, 0.3)
"""The structure that is searched for, as sigmas of two Gaussians: what is smaller is noise; what is larger has too few
independent pieces on one bore's wall to tell places apart."""
DISTINCT_MM = 0.75
"""Two places nearer than this are one peak."""


def search(
    a: Evidence, b: Evidence, orientations: tuple[Orientation, ...], z_scale_range: tuple[float, float]
) -> Alignment | None:
    """Return the best place on the search grid, or None where nothing correlates at all."""
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


def _same_place(one: Alignment, other: Alignment, z_middle_mm: float, radius_mm: float) -> bool:
    if (one.mirrored, one.z_reversed) != (other.mirrored, other.z_reversed):
        return False
    off_rad = wrap_rad(one.theta_shift_rad - other.theta_shift_rad)
    off_mm = one.z_to_a(z_middle_mm) - other.z_to_a(z_middle_mm)
    return bool(abs(off_rad) * radius_mm < DISTINCT_MM and abs(off_mm) < DISTINCT_MM)
