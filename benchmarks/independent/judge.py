"""A judge of comparisons that shares nothing with endoct's scoring: sample by sample against the true bore.

Where a panorama lies in the bore is known in two ways. The OCT's follows from what its A-scans and slices are. The
endoscope's depends on which radius in the image it calls the middle of its band; so its place is measured: the
texture of its plain wall is laid on that of the true wall by least squares.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from benchmarks.independent.bore import Bore, Floats
from benchmarks.independent.truth import Place

Bools = NDArray[np.bool_]
LEAST_FIT = 0.25


@dataclass(frozen=True, eq=False)
class Wall:
    """What one side said of the wall: arrays (z, θ), on rows ``z_mm`` and columns ``theta_rad`` of its own.

    ``depth_mm`` is None for a side without depth.
    """

    intensity: NDArray[np.float32]
    cells: Bools
    valid: Bools
    z_mm: Floats
    theta_rad: Floats
    depth_mm: Floats | None = None


def jaccard(one: Bools, other: Bools, where: Bools) -> float:
    """Return the Jaccard index over ``where``; NaN where neither has anything."""
    union = (one | other) & where
    return float((one & other & where).sum() / union.sum()) if union.any() else float("nan")


def true_cells(bore: Bore, place: Place, wall: Wall) -> Bools:
    """Return the true cells on a side's own samples."""
    return bore.is_cell(*_on_bore(place, wall))


def against_truth(bore: Bore, place: Place, wall: Wall) -> float:
    """Return a side's Jaccard index against the truth, on its own valid samples."""
    return jaccard(wall.cells, true_cells(bore, place, wall), wall.valid)


def wrong_share(bore: Bore, place: Place, wall: Wall) -> float:
    """Return the share of a side's valid samples that it calls cell or wall wrongly: also of a bore without cells."""
    wrong = wall.cells != true_cells(bore, place, wall)
    return float(wrong[wall.valid].mean()) if wall.valid.any() else float("nan")


def depth_errors(bore: Bore, place: Place, wall: Wall) -> tuple[float, float]:
    """Return (median depth of plain wall in mm, median of depth over true depth in cells 0.15 to 0.6 mm deep)."""
    if wall.depth_mm is None:
        return float("nan"), float("nan")
    theta, z = _on_bore(place, wall)
    known = wall.valid & np.isfinite(wall.depth_mm)
    level, relief = bore.at(bore.level, theta, z), bore.at(bore.relief_mm, theta, z)
    plain, inside = known & (level > 1.2), known & (level < 0.8) & (relief > 0.15) & (relief < 0.6)
    flat = float(np.median(wall.depth_mm[plain])) if plain.any() else float("nan")
    return flat, float(np.median(wall.depth_mm[inside] / relief[inside])) if inside.any() else float("nan")


def pair_jaccard(a: Wall, b: Wall, b_in_a: Place) -> float:
    """Return the Jaccard index of two sides on a grid of 10 µm in A's frame, each by its nearest sample."""
    step = 0.01
    z = np.arange(a.z_mm[0], a.z_mm[-1], step)[:, None]
    theta = np.linspace(0, 2 * np.pi, 786, endpoint=False)[None, :]
    of_a, seen_a = _nearest(a, theta, z)
    of_b, seen_b = _nearest(b, *b_in_a.from_bore(theta, z))
    return jaccard(of_a, of_b, seen_a & seen_b)


def loss_of_alignment(bore: Bore, a: Wall, b: Wall, a_place: Place, b_place: Place, stated: Place) -> float:
    """Return 1 − J of the true cells with themselves, B's laid on A's as stated instead of as is true."""
    step = 0.01
    z = np.arange(a.z_mm[0], a.z_mm[-1], step)[:, None]
    theta = np.linspace(0, 2 * np.pi, 786, endpoint=False)[None, :]
    on_b = stated.from_bore(theta, z)
    seen = _nearest(a, theta, z)[1] & _nearest(b, *on_b)[1]
    return 1 - jaccard(bore.is_cell(*a_place.to_bore(theta, z)), bore.is_cell(*b_place.to_bore(*on_b)), seen)


@dataclass(frozen=True)
class Misplaced:
    """The error of an alignment: stated − true, and in standard errors where a covariance was stated."""

    theta_rad: float
    z_mm: float
    scale: float
    right_way: bool
    theta_sigmas: float = float("nan")
    z_sigmas: float = float("nan")
    scale_sigmas: float = float("nan")


def misplaced(stated: Place, true: Place, b: Wall, covariance: Floats | None) -> Misplaced:
    """Return the error of where B was laid in A; z at the middle of B, where scale and shift do not mix."""
    middle = float(b.z_mm.mean()) * (-1 if stated.reversed else 1)
    of_z = stated.z_mm + stated.scale * middle - (true.z_mm + true.scale * middle)
    theta = float((stated.theta_rad - true.theta_rad + np.pi) % (2 * np.pi) - np.pi)
    scale = stated.scale - true.scale
    right_way = stated.mirrored == true.mirrored and stated.reversed == true.reversed
    if covariance is None:
        return Misplaced(theta, of_z, scale, right_way)
    along = np.array([0.0, 1.0, middle])
    return Misplaced(
        theta,
        of_z,
        scale,
        right_way,
        theta / float(np.sqrt(covariance[0, 0])),
        of_z / float(np.sqrt(along @ covariance @ along)),
        scale / float(np.sqrt(covariance[2, 2])),
    )


def measured_place(bore: Bore, wall: Wall, guess: Place) -> tuple[Place, float]:
    """Return where a side's picture of plain wall fits the true texture best, near ``guess``, and how they correlate.

    A coarse search (±0.15 mm, ±0.05 rad, ±4 %), then Gauss–Newton over θ, z and scale. Samples near a cell do not
    count. Where the picture fits nowhere, the guess stands.
    """
    theta, z = _on_bore(guess, wall)
    plain = wall.valid & (bore.at(_far_from_cells(bore), theta, z) > 0.5)
    picture = _texture(wall.intensity, plain, wall, bore.radius_mm)
    truth = bore.albedo - ndimage.uniform_filter(bore.albedo, 60, mode=("nearest", "wrap"))
    rows, columns = np.nonzero(plain)
    pick = np.random.default_rng(0).permutation(rows.size)[:60000]
    rows, columns = rows[pick], columns[pick]
    value = picture[rows, columns]
    middle = float(wall.z_mm.mean())

    def fit(place: Place, some: slice = slice(None)) -> float:
        seen = bore.at(truth, *place.to_bore(wall.theta_rad[columns[some]], wall.z_mm[rows[some]]))
        return float(np.corrcoef(seen, value[some])[0, 1])

    tries = (
        _moved(guess, d_theta, d_z, d_scale, middle)
        for d_scale in np.arange(-0.04, 0.0401, 0.01)
        for d_theta in np.arange(-0.05, 0.0501, 0.0125)
        for d_z in np.arange(-0.15, 0.1501, 0.015)
    )
    place = max(tries, key=lambda one: fit(one, slice(4000)))
    for _ in range(12):
        place = _newton(bore, truth, place, wall, rows, columns, value, middle)
    return (place, fit(place)) if fit(place) > LEAST_FIT else (guess, fit(guess))


def _moved(place: Place, theta_rad: float, z_mm: float, scale: float, middle_mm: float) -> Place:
    """Return a place moved by that much in the bore's frame at ``middle_mm``, and stretched about it."""
    shift = z_mm - (-1 if place.reversed else 1) * scale * middle_mm
    return replace(
        place,
        theta_rad=float(place.theta_rad + theta_rad),
        z_mm=float(place.z_mm + shift),
        scale=float(place.scale + scale),
    )


def _newton(
    bore: Bore,
    truth: NDArray[np.float32],
    place: Place,
    wall: Wall,
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    value: Floats,
    middle_mm: float,
) -> Place:
    theta, z = place.to_bore(wall.theta_rad[columns], wall.z_mm[rows])
    seen = bore.at(truth, theta, z).astype(np.float64)
    by_theta = (bore.at(truth, theta + 0.006, z) - bore.at(truth, theta - 0.006, z)) / 0.012
    by_z = (bore.at(truth, theta, z + 0.008) - bore.at(truth, theta, z - 0.008)) / 0.016
    along = (-1 if place.reversed else 1) * (wall.z_mm[rows] - middle_mm)
    gain = float((seen * value).sum() / (seen**2).sum())
    design = np.stack([gain * by_theta, gain * by_z, gain * by_z * along, seen], axis=1)
    step = np.linalg.lstsq(design, value - gain * seen, rcond=None)[0]
    return _moved(place, float(step[0]), float(step[1]), float(step[2]), middle_mm)


def _texture(intensity: NDArray[np.float32], plain: Bools, wall: Wall, radius_mm: float) -> Floats:
    """Return what is finer than 0.36 mm in the picture, relative to its surroundings."""
    height = 0.36 / float(np.median(np.diff(wall.z_mm)))
    width = 0.36 / (radius_mm * 2 * np.pi / wall.theta_rad.size)
    size = max(1, round(height)), max(1, round(width))
    known = plain.astype(np.float64)
    share = ndimage.uniform_filter(known, size, mode=("nearest", "wrap"))
    mean = ndimage.uniform_filter(np.where(plain, intensity, 0).astype(np.float64), size, mode=("nearest", "wrap"))
    return np.where(plain, intensity / np.maximum(mean / np.maximum(share, 1e-6), 1e-6) - 1, 0)


def _far_from_cells(bore: Bore) -> NDArray[np.float32]:
    near = ndimage.maximum_filter((bore.level < 1)[::4, ::4], 9, mode=("nearest", "wrap"))
    coarse = np.repeat(np.repeat(~near, 4, axis=0), 4, axis=1)[: bore.level.shape[0], : bore.level.shape[1]]
    return coarse.astype(np.float32)


def _on_bore(place: Place, wall: Wall) -> tuple[Floats, Floats]:
    theta, z = place.to_bore(wall.theta_rad[None, :], wall.z_mm[:, None])
    both = np.broadcast_arrays(theta, z)
    return both[0], both[1]


def _nearest(wall: Wall, theta_rad: Floats, z_mm: Floats) -> tuple[Bools, Bools]:
    """Return a side's cells and what it observed at places in its frame, by its nearest sample."""
    n = wall.theta_rad.size
    columns = np.rint((theta_rad - wall.theta_rad[0]) * n / (2 * np.pi)).astype(np.intp) % n
    row = np.interp(z_mm, wall.z_mm, np.arange(wall.z_mm.size), left=-1, right=-1)
    rows = np.rint(row).astype(np.intp)
    inside = rows >= 0
    rows = np.maximum(rows, 0)
    return wall.cells[rows, columns] & inside, wall.valid[rows, columns] & inside


def coverage(sigmas: Mapping[str, Floats], within: float = 2.0) -> dict[str, tuple[float, float, int]]:
    """Return for each name the share within ``within`` standard errors, the root mean square, and the count."""
    known = {name: np.asarray(values)[np.isfinite(values)] for name, values in sigmas.items()}
    return {
        name: (float((np.abs(v) <= within).mean()), float(np.sqrt((v**2).mean())), v.size)
        for name, v in known.items()
        if v.size
    }
