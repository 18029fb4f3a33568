"""A pose in clinical words: how far the bore misses its plan, where, and how well that is known.

Intervals hold the truth in 95 % of cases at least. That of a length in the plane is the least and the largest length
within the ellipse that holds 95 % of a bivariate normal, so that it begins at 0 where the two may be the same; it holds
the truth in 95 to 98.6 % of cases.
"""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from endoct.base.arrays import Coordinates
from endoct.fusion.pose.pose import BorePose
from endoct.fusion.pose.wall import OF_SIDE, SHARED, TURN

LEVEL = 0.95
BEYOND_MM = 5.0
"""From the end of the bore to the target of the surgery: the cochlea lies behind the facial recess."""
WITHIN = float(stats.norm.ppf((1 + LEVEL) / 2))
_AROUND = 720


@dataclass(frozen=True)
class Estimate:
    """A number and its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Offset:
    """How far the bore's axis lies off the plan at a ``depth_mm`` from the entry.

    ``across_mm``: along x and y of the plan's bore frame; ``covariance_mm2`` of these; ``distance_mm``: their length.
    """

    depth_mm: float
    across_mm: tuple[float, float]
    covariance_mm2: tuple[tuple[float, float], tuple[float, float]]
    distance_mm: Estimate


@dataclass(frozen=True)
class Difference:
    """By how much the axes of two sides, each found alone, differ: the first less the second."""

    of: tuple[str, str]
    at_entry: Offset
    at_target: Offset
    angle_deg: Estimate


def estimate(value: float, deviation: float) -> Estimate:
    """Return a number with the interval of a normal error."""
    return Estimate(value, value - WITHIN * deviation, value + WITHIN * deviation)


def length_of(across: Coordinates, covariance: Coordinates) -> Estimate:
    """Return the length of a vector (2,) in the plane with its interval."""
    angle = 2 * np.pi / _AROUND * np.arange(_AROUND)
    circle = np.sqrt(stats.chi2.ppf(LEVEL, 2)) * np.stack([np.cos(angle), np.sin(angle)])
    values, axes = np.linalg.eigh(covariance)
    border = across[:, None] + axes @ (np.sqrt(np.maximum(values, 0))[:, None] * circle)
    lengths = np.hypot(*border)
    inside = across @ np.linalg.pinv(covariance) @ across <= stats.chi2.ppf(LEVEL, 2) and values.min() > 0
    return Estimate(float(np.hypot(*across)), 0.0 if inside else float(lengths.min()), float(lengths.max()))


def offset_at(pose: BorePose, depth_mm: float) -> Offset:
    """Return how far the axis lies off the plan at a depth from the entry."""
    to_plan = pose.bore_to_plan
    across = (to_plan[:3, 3] + depth_mm * to_plan[:3, 2])[:2]
    return _offset(depth_mm, across, pose.axis_covariance(depth_mm))


def angle_of(pose: BorePose) -> Estimate:
    """Return the angle between the axis and the plan, degrees."""
    return _in_degrees(length_of(pose.fit.parameters[2:SHARED], pose.fit.covariance[2:SHARED, 2:SHARED]))


def ends_of(pose: BorePose, name: str) -> tuple[Estimate, Estimate]:
    """Return the depth along the bore, mm from its entry, of the first and the last row of a side."""
    z_mm = pose.fit.sides[pose.names.index(name)].z_mm[[0, -1]]
    first, last = (
        estimate(float(depth), pose.depth_deviation_mm(name, float(z)))
        for depth, z in zip(pose.depth_of(name, z_mm), z_mm, strict=True)
    )
    return first, last


def roll_of(pose: BorePose, name: str) -> Estimate:
    """Return the angle of θ = 0 of a side's panorama about the bore's axis, degrees in [0, 360), from the frame's x."""
    number = pose.names.index(name)
    turn = SHARED + OF_SIDE * number + TURN
    value = float(np.degrees(pose.fit.parameters[turn])) % 360
    return estimate(value, float(np.degrees(np.sqrt(pose.fit.covariance[turn, turn]))))


def difference(one: BorePose, other: BorePose) -> Difference:
    """Return the paired difference of two sides' own axes, their errors taken for independent."""
    (name, others), length = (*one.names, *other.names), one.plan.length_mm
    tilt = one.fit.parameters[2:SHARED] - other.fit.parameters[2:SHARED]
    of_tilt = one.fit.covariance[2:SHARED, 2:SHARED] + other.fit.covariance[2:SHARED, 2:SHARED]
    return Difference(
        of=(name, others),
        at_entry=_difference_at(one, other, 0.0),
        at_target=_difference_at(one, other, length),
        angle_deg=_in_degrees(length_of(tilt, of_tilt)),
    )


def sampled_axes(pose: BorePose, count: int, generator: np.random.Generator) -> tuple[Coordinates, Coordinates]:
    """Return ``count`` axes as likely as the covariance says: entries (count, 3) and directions (count, 3), LPS."""
    shared = pose.fit.parameters[:SHARED]
    x, y, about_x, about_y = generator.multivariate_normal(shared, pose.fit.covariance[:SHARED, :SHARED], count).T
    angle = np.hypot(about_x, about_y)
    share = np.sinc(angle / np.pi)  # sin(angle) / angle
    directions = np.stack([about_y * share, -about_x * share, np.cos(angle)], axis=-1)
    half = pose.plan.length_mm / 2
    entries = np.stack([x, y, np.full_like(x, half)], axis=-1) - half * directions
    to_lps = pose.plan.to_lps
    return entries @ to_lps[:3, :3].T + to_lps[:3, 3], directions @ to_lps[:3, :3].T


def _difference_at(one: BorePose, other: BorePose, depth_mm: float) -> Offset:
    first, second = offset_at(one, depth_mm), offset_at(other, depth_mm)
    across = np.subtract(first.across_mm, second.across_mm)
    return _offset(depth_mm, across, np.add(first.covariance_mm2, second.covariance_mm2))


def _offset(depth_mm: float, across: Coordinates, covariance: Coordinates) -> Offset:
    (xx, xy), (yx, yy) = covariance.tolist()
    return Offset(depth_mm, (float(across[0]), float(across[1])), ((xx, xy), (yx, yy)), length_of(across, covariance))


def _in_degrees(angle_rad: Estimate) -> Estimate:
    return Estimate(*(float(np.degrees(value)) for value in (angle_rad.value, angle_rad.low, angle_rad.high)))
