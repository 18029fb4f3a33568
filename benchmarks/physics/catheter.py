"""Where the catheter was and how it turned, from the pixels of one B-scan.

Written from the geometry alone: a beam leaves the catheter, bends at the capillary's inner and outer face by
Snell's law and goes on to the wall. Nothing of the unroller or of the renderer is used. Points and directions
across the bore are complex numbers x + iy in mm. ``truth`` is the "oct" part of ``truth/recording.json``;
``rig`` is what an operator could know of the instrument.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, map_coordinates, maximum_filter1d, median_filter, uniform_filter1d
from scipy.optimize import least_squares, minimize
from scipy.stats import trim_mean

from endoct.base.arrays import Coordinates

Points = NDArray[np.complex128]
FACE_WINDOW_PX = 5
STEP_DB, NOISE_DB = 8.0, 6.0  # the wall over what is before it, and its speckle, over ten rows
BEAM_MM = 0.025  # A-scans closer than this on the wall show the same speckle
USUAL_RAD = np.array([0.012, 0.01, *np.repeat(0.04 / np.arange(1, 5), 2)])  # shift, stretch, harmonics: rms expected
BLOCKS = 256  # of A-scans, a turn
STEEPEST, BEND = 6, 3.0  # steps of angle the error may change by from block to block; what that costs, in σ of noise


@dataclass(frozen=True)
class Rig:
    """Radii of the capillary's faces and of the bore in mm, the glass' index, and the depth axis in mm of air."""

    inner_mm: float
    outer_mm: float
    index: float
    bore_radius_mm: float
    first_sample_mm: float
    axial_pixel_mm: float
    db_per_count: float

    @classmethod
    def of(cls, recording: Mapping[str, Any], sample: Mapping[str, Any]) -> "Rig":
        """Return the rig of ``truth/recording.json`` and ``truth/sample.json``."""
        truth, oct_ = recording["oct"], sample["oct"]
        outer = oct_["capillary_outer_diameter_mm"] / 2
        return cls(
            inner_mm=outer - truth["glass_mm"],
            outer_mm=outer,
            index=truth["glass_index"],
            bore_radius_mm=recording["bore_radius_mm"],
            first_sample_mm=truth["first_sample_mm"],
            axial_pixel_mm=oct_["axial_pixel_mm"],
            db_per_count=oct_["db_per_count"],
        )

    def row(self, path_mm: Coordinates) -> Coordinates:
        """Return the depth row, fractional, of an optical path from the catheter."""
        return np.asarray((path_mm - self.first_sample_mm) / self.axial_pixel_mm)


def turn_rad(truth: Mapping[str, Any], slice_index: int, n_ascans: int) -> Coordinates:
    """Return how far each A-scan of a slice is turned from the first, as ``theta_formula`` says."""
    k = np.arange(n_ascans, dtype=np.float64)
    lost = np.zeros(n_ascans)
    for block in truth["lost_ascans"]:
        if block["slice_index"] == slice_index:
            lost[k >= block["ascan"]] += block["count"]
    return 2 * np.pi * (k + lost) / n_ascans * float(truth["turn_length"][slice_index])


def rotation_error_rad(truth: Mapping[str, Any], slice_index: int, turn: Coordinates) -> Coordinates:
    """Return what ``theta_formula`` adds to an even turn of one slice: start angle and rotation error."""
    error = np.full_like(turn, truth["start_angle_rad"][slice_index])
    cosines, sines = truth["rotation_error_cos_rad"][slice_index], truth["rotation_error_sin_rad"][slice_index]
    for h, (cosine, sine) in enumerate(zip(cosines, sines, strict=True), 1):
        error += cosine * np.cos(h * turn) + sine * np.sin(h * turn)
    return error


def beam_rad(truth: Mapping[str, Any], slice_index: int, n_ascans: int) -> Coordinates:
    """Return the direction in the bore frame in which each beam of a slice leaves the catheter."""
    turn = turn_rad(truth, slice_index, n_ascans)
    turned = turn + rotation_error_rad(truth, slice_index, turn)
    return np.asarray(truth["theta_origin_rad"] + truth["theta_sense"] * turned)


def _to_circle(start: Points, along: Points, radius: float) -> Coordinates:
    """Return the way from ``start`` in the unit direction ``along`` to a circle about 0 from within."""
    before = (start * along.conj()).real
    return np.asarray(np.sqrt(radius**2 - np.abs(start) ** 2 + before**2) - before)


def through_glass(rig: Rig, catheter: complex, alpha: Coordinates) -> tuple[Coordinates, Coordinates, Points, Points]:
    """Return the optical paths to both faces, and where and in which direction beams leave the glass."""
    start, beam = np.full(alpha.shape, catheter, complex), np.exp(1j * alpha)
    inner = _to_circle(start, beam, rig.inner_mm)
    entry = start + inner * beam
    normal = entry / rig.inner_mm
    inside = normal * np.exp(1j * np.arcsin((beam * normal.conj()).imag / rig.index))
    glass = _to_circle(entry, inside, rig.outer_mm)
    leaving = entry + glass * inside
    normal = leaving / rig.outer_mm
    beyond = normal * np.exp(1j * np.arcsin((inside * normal.conj()).imag * rig.index))
    return inner, inner + rig.index * glass, leaving, beyond


def find_catheter(bscan: NDArray[np.uint8], rig: Rig, alpha: Coordinates) -> tuple[complex, float, float]:
    """Return the catheter's place off the capillary's axis, and how far all rows lie deeper than they should, in mm.

    ``alpha``: direction of every A-scan's beam. The place that draws both faces along the brightest rows is looked
    for on a grid; then the outer face is traced to a fraction of a row around it, and the place refined by least
    squares together with one common shift of depth. The third value is the rms of what is left.
    """
    some = np.arange(0, alpha.size, max(1, alpha.size // 250))
    step = 0.02
    offsets = step * np.arange(-20, 21)
    candidates = [x + 1j * y for x in offsets for y in offsets if abs(x + 1j * y) < rig.inner_mm - 0.2]
    counts = bscan.astype(np.float32)
    blurred = uniform_filter1d(counts, 7, axis=0)

    def brightness(catheter: complex) -> float:
        inner, outer, _, _ = through_glass(rig, catheter, alpha[some])
        rows = np.clip(np.rint(rig.row(np.stack([inner, outer]))).astype(int), 0, bscan.shape[0] - 1)
        return float(blurred[rows, some].mean())

    found = max(candidates, key=brightness)
    refined = np.array([found.real, found.imag, 0.0])
    window = np.arange(-FACE_WINDOW_PX, FACE_WINDOW_PX + 1)
    rms = np.inf
    for reach in (12, 6, 3):
        _, outer, _, _ = through_glass(rig, complex(*refined[:2]), alpha)
        expected = rig.row(outer + refined[2])
        near = np.rint(expected).astype(int)[:, None] + np.arange(-reach, reach + 1)
        ascans = np.arange(alpha.size)[:, None]
        profile = counts[np.clip(near, 0, bscan.shape[0] - 1), ascans]
        peak = near[ascans[:, 0], profile.argmax(axis=1)]
        rows = np.clip(peak[:, None] + window, 0, bscan.shape[0] - 1)
        level_db = counts[rows, ascans] * rig.db_per_count
        weight = 10 ** ((level_db - level_db.max(axis=1, keepdims=True)) / 10)
        traced = (weight * rows).sum(axis=1) / weight.sum(axis=1)
        bright = level_db.max(axis=1) > np.quantile(counts, 0.9) * rig.db_per_count

        def misfit(values: Coordinates, of: Coordinates = traced, use: NDArray[np.bool_] = bright) -> Coordinates:
            _, outer, _, _ = through_glass(rig, complex(*values[:2]), alpha[use])
            return rig.row(outer + values[2]) - of[use]

        fit = least_squares(misfit, refined, loss="soft_l1", f_scale=0.5)
        refined = fit.x
        rms = float(np.sqrt(np.median(misfit(refined) ** 2)))
    return complex(*refined[:2]), float(refined[2]), rms * rig.axial_pixel_mm


def catheter_in_bore(
    truth: Mapping[str, Any], slice_index: int, z_mm: float, length_mm: float
) -> tuple[complex, complex]:
    """Return where, off the bore's axis at ``z_mm``, the capillary's axis and the catheter are."""
    lean = -truth["capillary_tilt_rad"] * (z_mm - length_mm / 2)
    axis = lean * np.exp(1j * truth["capillary_tilt_direction_rad"])
    offset = truth["offset_mm"][slice_index] * np.exp(1j * truth["offset_direction_rad"][slice_index])
    return complex(axis), complex(axis + offset)


def wall_row(
    rig: Rig, relief_mm: NDArray[np.float32], axis: complex, catheter: complex, alpha: Coordinates
) -> Coordinates:
    """Return the depth row at which beams meet the wall; ``relief_mm`` (θ,) is the truth's at the slice's z."""
    _, path, leaving, beyond = through_glass(rig, catheter - axis, alpha)
    way = np.arange(0.0, 2.2, 0.008)
    points = (leaving + axis)[:, None] + beyond[:, None] * way
    theta = np.mod(np.angle(points), 2 * np.pi) / (2 * np.pi) * relief_mm.size
    low = np.floor(theta).astype(int)
    part = theta - low
    relief = (1 - part) * relief_mm[low % relief_mm.size] + part * relief_mm[(low + 1) % relief_mm.size]
    excess = np.abs(points) - rig.bore_radius_mm - relief
    hit = np.argmax(excess >= 0, axis=1)
    ascan = np.arange(alpha.size)
    here, last = excess[ascan, hit], excess[ascan, np.maximum(hit - 1, 0)]
    met = (hit > 0) & (here >= 0)
    distance = way[hit] - np.where(met, here / np.where(met, here - last, 1), 0) * way[1]
    return np.where(met, rig.row(path + distance), np.nan)


def without_lines(bscan: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return the counts less what all A-scans have in common in a row beyond its neighbours: the detector's lines."""
    common = np.median(bscan, axis=1)
    excess = common - median_filter(common, 41, mode="nearest")
    return np.asarray(bscan - excess[:, None], dtype=np.float32)


def step_up(bscan: NDArray[np.float32], size: int = 20) -> NDArray[np.float32]:
    """Return how much brighter, in counts, the ``size`` rows from each row on are than those before it."""
    total = np.concatenate([np.zeros((1, bscan.shape[1])), np.cumsum(bscan, axis=0, dtype=np.float64)])
    rows = np.arange(bscan.shape[0])
    ahead = np.minimum(rows + size, bscan.shape[0])
    behind = np.maximum(rows - size, 0)
    step = (total[ahead] - total[rows]) / size - (total[rows] - total[behind]) / size
    return np.asarray(step, dtype=np.float32)


def shift_of_depth_px(rig: Rig, bscan: NDArray[np.uint8], rows: Coordinates) -> float:
    """Return how many rows deeper than ``rows`` (NaN: unknown) the wall begins, at half the height of its step.

    Intensities are averaged, not their logarithms: a step that is blurred evenly keeps its middle there.
    """
    known = np.flatnonzero(np.isfinite(rows) & (rows > 25) & (rows < bscan.shape[0] - 25))
    about = np.arange(-18, 15.01, 0.25)
    places = rows[known][:, None] + about
    level = map_coordinates(without_lines(bscan), [places.T, np.broadcast_to(known, places.T.shape)], order=1)
    profile = trim_mean(10 ** (level * rig.db_per_count / 10), 0.02, axis=1)
    before, after = profile[about < -8].mean(), profile[(about > 3) & (about < 8)].mean()
    first = int(np.argmax(profile > (before + after) / 2))
    rise = (before + after) / 2 - profile[first - 1]
    return float(about[first - 1] + 0.25 * rise / (profile[first] - profile[first - 1]))


def tells_angle(row_of_angle: Coordinates, alpha: Coordinates) -> NDArray[np.bool_]:
    """Say for which beams the true wall is anything but smooth within 0.05 rad, so that it tells their angle.

    ``row_of_angle``: the rows at which beams at 2πj/n meet it.
    """
    n = row_of_angle.size
    rows = np.nan_to_num(row_of_angle, nan=float(np.nanmax(row_of_angle)) + 50)
    steep = np.abs(np.roll(rows, -round(n / 600)) - np.roll(rows, round(n / 600))) > 8
    near = maximum_filter1d(steep, 2 * round(0.05 / (2 * np.pi) * n) + 1, mode="wrap")
    return np.asarray(near[np.rint(alpha / (2 * np.pi) * n).astype(int) % n])


def find_turning(
    rig: Rig, bscan: NDArray[np.uint8], row_of_angle: Coordinates, even_rad: Coordinates, reach_rad: float = 0.16
) -> Coordinates:
    """Return by how much every beam was ahead of an even turn, from where the wall steps up.

    ``row_of_angle``: the rows at which beams at 2πj/n meet the true wall; ``even_rad`` (A-scan,): direction of each
    beam in an even turn. A course of the error over the turn is sought along which the brightness steps up most:
    first any that is not too steep (dynamic programming over blocks of A-scans), then, from there, the best made of
    a shift, a stretch and four harmonics of the turn.
    """
    n, n_ascans = row_of_angle.size, even_rad.size
    step = step_up(without_lines(bscan))
    # blur moves every step by the same few rows
    plain = row_of_angle[np.rint(even_rad / (2 * np.pi) * n).astype(int) % n]
    known = np.flatnonzero(np.isfinite(plain) & (plain > 10) & (plain < bscan.shape[0] - 12))
    rise = [step[np.rint(plain[known]).astype(int) + deeper, known].mean() for deeper in range(-5, 6)]
    row_of_angle = row_of_angle + int(np.argmax(rise)) - 5
    shifts = np.arange(-reach_rad, reach_rad + 1e-9, 2 * np.pi / n)
    score = np.empty((n_ascans, shifts.size), np.float32)
    ascans = np.arange(n_ascans)
    for i, shift in enumerate(shifts):
        rows = row_of_angle[np.rint((even_rad + shift) / (2 * np.pi) * n).astype(int) % n]
        seen = np.isfinite(rows) & (rows < bscan.shape[0] - 12)
        score[:, i] = np.where(seen, step[np.where(seen, np.rint(rows), 0).astype(int), ascans], 0)
    # the logarithm of the likelihood of a step of the usual height in noise, with as many A-scans as are independent
    score *= rig.db_per_count * STEP_DB / NOISE_DB**2
    score *= min(1.0, 2 * np.pi * rig.bore_radius_mm / n_ascans / BEAM_MM)
    edges = np.linspace(0, n_ascans, BLOCKS + 1).astype(int)
    course = shifts[_best_course(np.add.reduceat(score, edges[:-1], axis=0))]

    turn = 2 * np.pi * ascans / n_ascans
    waves = [f(h * turn) for h in range(1, 5) for f in (np.cos, np.sin)]
    basis = np.stack([np.ones(n_ascans), turn / np.pi - 1, *waves])
    middle = np.minimum((edges[:-1] + edges[1:]) // 2, n_ascans - 1)
    smooth = gaussian_filter1d(score, 0.0025 / (shifts[1] - shifts[0]), axis=1)
    slope = np.gradient(smooth, shifts, axis=1)

    def loss(values: Coordinates) -> tuple[float, Coordinates]:
        place = [ascans, (values @ basis - shifts[0]) / (shifts[1] - shifts[0])]
        steep = map_coordinates(slope, place, order=1)
        unlikely = float(((values / USUAL_RAD) ** 2).sum()) / 2
        return unlikely - float(map_coordinates(smooth, place, order=1).sum()), values / USUAL_RAD**2 - basis @ steep

    start = np.linalg.lstsq(
        np.concatenate([basis[:, middle].T, 0.05 * np.diag(1 / USUAL_RAD)]), np.r_[course, np.zeros(10)], rcond=None
    )[0]
    return np.asarray(minimize(loss, start, jac=True, method="BFGS").x @ basis)


def _best_course(gain: NDArray[np.float32]) -> NDArray[np.intp]:
    """Return the index into the second axis, for each of the first, of the course that gains most and bends little."""
    n_shifts = gain.shape[1]
    moves = np.arange(-STEEPEST, STEEPEST + 1)
    cost = BEND * (moves / STEEPEST) ** 2
    total, came = gain[0].astype(np.float64), np.zeros(gain.shape, int)
    for block in range(1, len(gain)):
        padded = np.pad(total, STEEPEST, constant_values=-np.inf)
        reached = np.stack([padded[STEEPEST + move : STEEPEST + move + n_shifts] for move in moves]) - cost[:, None]
        came[block] = moves[reached.argmax(axis=0)]
        total = reached.max(axis=0) + gain[block]
    course = np.empty(len(gain), int)
    course[-1] = int(total.argmax())
    for block in range(len(gain) - 1, 0, -1):
        course[block - 1] = course[block] + came[block, course[block]]
    return course
