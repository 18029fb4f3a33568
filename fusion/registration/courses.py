"""The course of shift and roll along the bore that explains both sides best, on a grid, by dynamic programming.

Every row of B is compared with A's rows around its rigid place, turned both ways. Changes from row to row cost by their
size, and a jump, as of a lost slice, costs the same however far it goes.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from endoct.base.arrays import Coordinates
from endoct.fusion.evidence.evidence import Evidence
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.registration.rigidity import N_THETA, STEP_MM, in_one_frame

REACH_MM, REACH_RAD = 0.8, 0.22
"""How far a bend may move the wall from its rigid place."""
INDEPENDENT_MM2 = 0.04
"""Area of wall whose samples err as one."""
CHANGE_COST, JUMP_COST = 3.0, 14.0
"""What a change by a row or by a column costs, and what a jump does, in log-likelihood."""
LEAST_SEEN = 0.7
"""A place must show this share of what the rigid one shows of a row."""
NOT_SEEN = 3.0
"""How much worse than usual a place counts that shows less."""
JUMP_MM, JUMP_RAD, WITHIN_MM = 0.12, 0.06, 0.2
"""A course jumps where it changes by so much within a slice."""
LEAST_STRETCH_MM = 0.6
"""Jumps lie farther than this from each other and from either end."""


@dataclass(frozen=True, eq=False)
class Course:
    """At ``z_mm`` (n,) of A's frame, ascending, by how much B lies farther along and is turned; float64 (n,)."""

    z_mm: Coordinates
    shift_mm: Coordinates
    roll_rad: Coordinates


def cheapest_course(a: Evidence, b: Evidence, alignment: Alignment) -> Course | None:
    """Return the course of ``b`` against ``a`` from where a rigid ``alignment`` puts it; None where neither varies."""
    one, two = in_one_frame(a, b, alignment, REACH_MM)
    margin, columns = round(REACH_MM / STEP_MM), round(REACH_RAD / (2 * np.pi) * N_THETA)
    both = one.valid & two.valid
    rows = np.arange(margin, one.z_mm.size - margin)
    if rows.size < 2 or not both.any():
        return None
    x, y = (side.values - side.values[both].mean(dtype=np.float64) for side in (one, two))
    of_y = float(y[both] @ y[both])
    y = y * (float(x[both] @ y[both]) / of_y if of_y > 0 else 0.0)
    usual = float(np.mean((x[both] - y[both]) ** 2))
    if not usual > 0:
        return None
    spectra_x, spectra_y = (_spectra(values, side) for values, side in ((x, one), (y, two)))
    k, column = np.arange(N_THETA // 2 + 1)[:, None], np.arange(-columns, columns + 1)
    weight = np.where((k == 0) | (k == N_THETA // 2), 1, 2) / N_THETA
    back = weight * np.exp(2j * np.pi * k * column / N_THETA)
    seen = both[rows].sum(axis=1)[:, np.newaxis]
    cost = np.empty((rows.size, 2 * margin + 1, column.size))
    there = np.conj(spectra_y[:, rows])
    for shift in range(2 * margin + 1):
        here = spectra_x[:, rows + shift - margin]
        squares = ((here[2] * there[0] - 2 * here[1] * there[1] + here[0] * there[2]) @ back).real
        count = ((here[0] * there[0]) @ back).real
        excess = np.where(count > LEAST_SEEN * seen, squares / np.maximum(count, 1) - usual, NOT_SEEN * usual)
        cost[:, shift] = excess * seen
    cost *= STEP_MM * one.column_mm / INDEPENDENT_MM2 / (2 * usual)
    shifts, turns = _cheapest(cost)
    shift_mm, roll_rad = STEP_MM * (shifts - margin), 2 * np.pi / N_THETA * (turns - columns)
    return Course(two.z_mm[rows], np.asarray(shift_mm, np.float64), np.asarray(roll_rad, np.float64))


def jumps_of(course: Course) -> tuple[float, ...]:
    """Return where ``course`` jumps, mm, ascending; of several close together the largest."""
    span = round(WITHIN_MM / STEP_MM)
    z_mm, shift_mm, roll_rad = course.z_mm, course.shift_mm, course.roll_rad
    at_mm = (z_mm[span:] + z_mm[:-span]) / 2
    size = np.maximum(
        np.abs(shift_mm[span:] - shift_mm[:-span]) / JUMP_MM, np.abs(roll_rad[span:] - roll_rad[:-span]) / JUMP_RAD
    )
    jumps = list[float]()
    while size.size and size.max() >= 1:
        largest = np.flatnonzero(size == size.max())
        place_mm = float(at_mm[largest[largest.size // 2]])
        if min(place_mm - z_mm[0], z_mm[-1] - place_mm) > LEAST_STRETCH_MM:
            jumps.append(place_mm)
        size = np.where(np.abs(at_mm - place_mm) < LEAST_STRETCH_MM, 0, size)
    return tuple(sorted(jumps))


def _spectra(values: Coordinates, side: Evidence) -> NDArray[np.complex128]:
    """Return the spectra along θ of what is observed, of its values and of their squares, (3, n_z, n)."""
    known = np.where(side.valid, values, 0)
    return np.asarray(fft.rfft(np.stack([side.valid.astype(np.float64), known, known**2]), axis=2))


def _cheapest(cost: Coordinates) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return which shift and which turn of ``cost`` (n, n_shift, n_turn) each row takes on the cheapest course."""
    n, n_shift, n_turn = cost.shape
    by_shift, by_turn = (CHANGE_COST * np.abs(np.subtract.outer(*[np.arange(m)] * 2)) for m in (n_shift, n_turn))
    flat = np.arange(n_shift * n_turn).reshape(n_shift, n_turn)
    total, came_from = cost[0], np.empty(cost.shape, np.intp)
    for row in range(1, n):
        along = total[np.newaxis] + by_shift[:, :, np.newaxis]
        shift_from, best = along.argmin(axis=1), along.min(axis=1)
        around = best[:, np.newaxis] + by_turn
        turn_from, best = around.argmin(axis=2), around.min(axis=2)
        came_from[row] = flat[np.take_along_axis(shift_from, turn_from, axis=1), turn_from]
        cheapest = int(total.argmin())
        jumped = total.flat[cheapest] + JUMP_COST < best
        came_from[row][jumped] = cheapest
        total = np.where(jumped, total.flat[cheapest] + JUMP_COST, best) + cost[row]
    course = np.empty(n, np.intp)
    course[-1] = total.argmin()
    for row in range(n - 1, 0, -1):
        course[row - 1] = came_from[row].flat[course[row]]
    return course // n_turn, course % n_turn
