"""The pose of a bore in the patient, the way from a panorama to the CT and back, and the pose in clinical words.

The words say how far the bore misses its plan, where, and how well that is known. Intervals hold the truth in 95 % of
cases at least.

The interval of a length in the plane is the least and the largest length within the ellipse that holds 95 % of a
bivariate normal. So it begins at 0 where the two may be the same. It holds the truth in 95 to 98.6 % of cases.
"""

from dataclasses import dataclass

import numpy as np
import torch
from scipy import stats

from endoct.base.arrays import Coordinates
from endoct.fusion.pose.fit import PoseFit
from endoct.fusion.pose.observation import Observation
from endoct.fusion.pose.wall import (
    DEPTH,
    OF_SIDE,
    RADIUS,
    SCALE,
    SHARED,
    TURN,
    Sense,
    along_axis,
    directions,
    twist_along,
)
from endoct.modalities.ct.trajectory import Trajectory

NEWTON_ROUNDS = 12
LEVEL = 0.95
BEYOND_MM = 5.0
"""Distance from the end of the bore to the target of the surgery: the cochlea lies behind the facial recess."""
WITHIN = float(stats.norm.ppf((1 + LEVEL) / 2))
AROUND = 720


@dataclass(frozen=True, eq=False)
class BorePose:
    """Where a bore lies, found by one side or two against a CT around ``plan``.

    In the bore frame z runs along the bore, from 0 where it comes nearest to the plan's entry. θ is as in the plan's
    frame but for the tilt. ``fit`` holds the parameters and their covariance.
    """

    plan: Trajectory
    fit: PoseFit

    @property
    def names(self) -> tuple[str, ...]:
        """The names of its sides."""
        return tuple(side.name for side in self.fit.sides)

    @property
    def bore_to_plan(self) -> Coordinates:
        """The transform (4, 4) of the bore frame to that of the plan."""
        axes = directions(torch.as_tensor(self.fit.parameters[2:SHARED])).numpy()
        pivot = np.array([*self.fit.parameters[:2], self.plan.length_mm / 2])
        transform = np.eye(4)
        transform[:3, :3] = axes
        transform[:3, 3] = pivot - self.plan.length_mm / 2 * axes[:, 2]
        return transform

    @property
    def bore_to_lps(self) -> Coordinates:
        """The transform (4, 4) of the bore frame to the patient, LPS."""
        return np.asarray(self.plan.to_lps @ self.bore_to_plan)

    def axis_lps(self, z_mm: Coordinates) -> Coordinates:
        """Return points of the bore's axis at depths (n,), (n, 3) LPS."""
        to_lps = self.bore_to_lps
        return np.asarray(to_lps[:3, 3] + np.asarray(z_mm)[..., None] * to_lps[:3, 2])

    def axis_covariance(self, z_mm: float) -> Coordinates:
        """Return the covariance (2, 2) in mm² of the axis at a depth, across it, along the bore frame's x and y."""
        from_pivot = z_mm - self.plan.length_mm / 2
        # a rotation about y moves the axis along x, one about x against y
        moves = np.array([[1, 0, 0, from_pivot], [0, 1, -from_pivot, 0]], dtype=np.float64)
        return np.asarray(moves @ self.fit.covariance[:SHARED, :SHARED] @ moves.T)

    def depth_deviation_mm(self, name: str, z_mm: float) -> float:
        """Return the standard deviation of where a row of a side lies along the bore."""
        number, side, sense = self._of(name)
        own = torch.tensor(self.fit.of_side(number), requires_grad=True)
        place = torch.as_tensor([z_mm], dtype=torch.float64)
        (by,) = torch.autograd.grad(along_axis(side, sense, own, place)[0], own)
        first = SHARED + OF_SIDE * number
        of_side = self.fit.covariance[first : first + OF_SIDE, first : first + OF_SIDE]
        return float(np.sqrt(by.numpy() @ of_side @ by.numpy()))

    def depth_of(self, name: str, z_mm: Coordinates) -> Coordinates:
        """Return the depth along the bore, mm, of rows of a side's panorama at ``z_mm`` (…)."""
        number, side, sense = self._of(name)
        depth = along_axis(side, sense, torch.as_tensor(self.fit.of_side(number)), torch.as_tensor(z_mm))
        return np.asarray(depth.numpy(), dtype=np.float64)

    def to_lps(self, name: str, theta_rad: Coordinates, z_mm: Coordinates, behind_mm: Coordinates) -> Coordinates:
        """Return where places of a side's panorama lie in the patient, LPS, mm: three that broadcast to (…, 3)."""
        number, side, sense = self._of(name)
        own = self.fit.of_side(number)
        angle = sense.turning * np.asarray(theta_rad) + own[TURN] + self._twist(number, z_mm)
        radius = side.radius_mm + own[RADIUS] + np.asarray(behind_mm)
        places = np.broadcast_arrays(radius * np.cos(angle), radius * np.sin(angle), self.depth_of(name, z_mm))
        local = np.stack(places, axis=-1)
        to_lps = self.bore_to_lps
        return np.asarray(local @ to_lps[:3, :3].T + to_lps[:3, 3])

    def from_lps(self, name: str, places_mm: Coordinates) -> tuple[Coordinates, Coordinates, Coordinates]:
        """Return θ in [0, 2π), z, and the distance behind the wall of places (n, 3) in the patient, on a side."""
        number, side, sense = self._of(name)
        own, to_lps = self.fit.of_side(number), self.bore_to_lps
        local = (np.asarray(places_mm, dtype=np.float64) - to_lps[:3, 3]) @ to_lps[:3, :3]
        scale = sense.inward * (1 + own[SCALE])
        z_mm = side.middle_mm + (local[:, 2] - own[DEPTH]) / scale
        for _ in range(NEWTON_ROUNDS):
            z_mm = z_mm + (local[:, 2] - self.depth_of(name, z_mm)) / scale
        angle = np.arctan2(local[:, 1], local[:, 0]) - own[TURN] - self._twist(number, z_mm)
        behind = np.hypot(local[:, 0], local[:, 1]) - side.radius_mm - own[RADIUS]
        return np.asarray(sense.turning * angle % (2 * np.pi)), z_mm, np.asarray(behind)

    def _twist(self, number: int, z_mm: Coordinates) -> Coordinates:
        twist = twist_along(self.fit.sides[number], torch.as_tensor(self.fit.of_side(number)), torch.as_tensor(z_mm))
        return np.asarray(twist.numpy(), dtype=np.float64)

    def _of(self, name: str) -> tuple[int, Observation, Sense]:
        number = self.names.index(name)
        return number, self.fit.sides[number], self.fit.senses[number]


@dataclass(frozen=True)
class Estimate:
    """A number and its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Offset:
    """How far the bore's axis lies off the plan at a ``depth_mm`` from the entry.

    ``across_mm`` is along x and y of the plan's bore frame, with ``covariance_mm2``; ``distance_mm`` is their length.
    """

    depth_mm: float
    across_mm: tuple[float, float]
    covariance_mm2: tuple[tuple[float, float], tuple[float, float]]
    distance_mm: Estimate


@dataclass(frozen=True)
class Difference:
    """How the axes of two sides, each found alone, differ: the first less the second."""

    of: tuple[str, str]
    at_entry: Offset
    at_target: Offset
    angle_deg: Estimate


def estimate(value: float, deviation: float) -> Estimate:
    """Return ``value`` with the interval of a normal error."""
    return Estimate(value, value - WITHIN * deviation, value + WITHIN * deviation)


def length_of(across: Coordinates, covariance: Coordinates) -> Estimate:
    """Return the length of a vector (2,) in the plane with its interval."""
    angle = 2 * np.pi / AROUND * np.arange(AROUND)
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


def difference(a: BorePose, b: BorePose) -> Difference:
    """Return the paired difference of two sides' own axes, as if their errors were independent."""
    (name, others), length = (*a.names, *b.names), a.plan.length_mm
    tilt = a.fit.parameters[2:SHARED] - b.fit.parameters[2:SHARED]
    of_tilt = a.fit.covariance[2:SHARED, 2:SHARED] + b.fit.covariance[2:SHARED, 2:SHARED]
    return Difference(
        of=(name, others),
        at_entry=_difference_at(a, b, 0.0),
        at_target=_difference_at(a, b, length),
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


def _difference_at(a: BorePose, b: BorePose, depth_mm: float) -> Offset:
    first, second = offset_at(a, depth_mm), offset_at(b, depth_mm)
    across = np.subtract(first.across_mm, second.across_mm)
    return _offset(depth_mm, across, np.add(first.covariance_mm2, second.covariance_mm2))


def _offset(depth_mm: float, across: Coordinates, covariance: Coordinates) -> Offset:
    (xx, xy), (yx, yy) = covariance.tolist()
    return Offset(depth_mm, (float(across[0]), float(across[1])), ((xx, xy), (yx, yy)), length_of(across, covariance))


def _in_degrees(angle_rad: Estimate) -> Estimate:
    return Estimate(*(float(np.degrees(value)) for value in (angle_rad.value, angle_rad.low, angle_rad.high)))
