"""A twist of one side along z, estimated against the other side.

Both are brought to B's rows. Every row of B is turned to where it correlates best with A's, but no farther from its
neighbours than a catheter may twist.

This fits one side to the other, cells and noise alike, and so raises any score of the two. Whoever corrects by it must
say so, and give both figures.
"""

from dataclasses import dataclass, replace

import numpy as np

from endoct.base.arrays import Coordinates, Mask
from endoct.fusion.evidence.evidence import clipped
from endoct.fusion.evidence.side import Side
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.geometry.placement import Placement
from endoct.stitching.panorama import Panorama

FARTHEST_RAD = 0.15
STEP_RAD = 0.002
TWIST_RAD = 0.0175
"""Typical change over a millimetre, 1°; it grows with the root of the distance."""
TRUST = 20.0
"""A correlation of 1 stands for odds with this logarithm."""


@dataclass(frozen=True, eq=False)
class Twist:
    """How far every row of B, at ``z_mm``, is turned from where the alignment has it, rad in B's own θ; float64 (n_z,).

    ``known``, bool (n_z,), is where both sides show enough contrast.
    """

    z_mm: Coordinates
    twist_rad: Coordinates
    known: Mask


def find_twist(a: Side, b: Side, alignment: Alignment) -> Twist:
    """Return the twist of B's rows against A. Its mean over known rows is 0, since that is the alignment's."""
    of_a, of_b = clipped(a.evidence), clipped(b.evidence)
    grid, z_mm = b.grid, b.grid.z_mm
    placement = Placement.averaging(a.grid, alignment.inverse(), grid)
    there, observed = placement.image(of_a.values, of_a.valid)
    both = observed & of_b.valid
    count = np.maximum(both.sum(axis=1, keepdims=True), 1)
    one, two = (
        np.where(both, v - np.sum(np.where(both, v, 0), axis=1, keepdims=True) / count, 0) for v in (there, of_b.values)
    )
    n = one.shape[1]
    spectrum = np.fft.rfft(two, axis=1) * np.conj(np.fft.rfft(one, axis=1))
    alike = np.fft.irfft(spectrum, n=n, axis=1) * (1.0 if alignment.correlation >= 0 else -1.0)
    shift_rad = np.arange(-FARTHEST_RAD, FARTHEST_RAD + STEP_RAD / 2, STEP_RAD)
    column = np.mod(shift_rad / grid.dtheta_rad, n)
    low, part = np.floor(column).astype(int), column - np.floor(column)
    near = (1 - part) * alike[:, low % n] + part * alike[:, (low + 1) % n]
    # rows of little contrast, against what rows have in common, count little
    scale = np.sqrt(np.sum(one**2, axis=1) * np.sum(two**2, axis=1))
    known = (scale > 0.1 * np.max(scale, initial=0.0)) & (2 * both.sum(axis=1) > n)
    weight = np.where(known, 1 / np.maximum(np.median(scale[known]) if known.any() else 1.0, 1e-12), 0)
    twist = _best_course(TRUST * near * weight[:, None], shift_rad, z_mm)
    if known.any():
        twist = twist - twist[known].mean()
    return Twist(z_mm, twist, known)


def untwisted(panorama: Panorama, twist: Twist) -> Panorama:
    """Return ``panorama`` with its rows turned back, each by the nearest whole sample."""
    n = panorama.grid.n_theta
    turn = np.round(twist.twist_rad / panorama.grid.dtheta_rad).astype(int)
    column = (np.arange(n)[None, :] + turn[:, None]) % n
    row = np.arange(panorama.grid.n_z)[:, None]
    depth = None if panorama.depth_mm is None else panorama.depth_mm[row, column]
    return replace(
        panorama,
        intensity=panorama.intensity[row, column],
        depth_mm=depth,
        valid=panorama.valid[row, column],
        weight=panorama.weight[row, column],
    )


def _best_course(evidence: Coordinates, shift_rad: Coordinates, z_mm: Coordinates) -> Coordinates:
    """Return the shift of every row: the course with the most evidence, less the cost of its changes."""
    n_rows = evidence.shape[0]
    apart = (shift_rad[:, None] - shift_rad[None, :]) ** 2
    gathered = np.empty_like(evidence)
    gathered[0] = evidence[0]
    came_from = np.zeros(evidence.shape, int)
    for row in range(1, n_rows):
        usual = TWIST_RAD**2 * max(float(z_mm[row] - z_mm[row - 1]), 1e-3)
        options = gathered[row - 1][None, :] - apart / (2 * usual)
        came_from[row] = np.argmax(options, axis=1)
        gathered[row] = evidence[row] + np.max(options, axis=1)
    course = np.empty(n_rows, int)
    course[-1] = int(np.argmax(gathered[-1]))
    for row in range(n_rows - 1, 0, -1):
        course[row - 1] = came_from[row, course[row]]
    return np.asarray(shift_rad[course])
