"""The pose of a bore in the patient, and the way from a recording's panorama to the CT and back."""

from dataclasses import dataclass

import numpy as np
import torch

from endoct.base.arrays import Coordinates
from endoct.fusion.pose.fit import Fit
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


@dataclass(frozen=True, eq=False)
class BorePose:
    """Where a bore lies, found by one side or two against a CT around ``plan``.

    The bore frame here: z along the bore, 0 where it comes nearest to the plan's entry, θ as in the plan's frame but
    for the tilt. ``fit`` holds the parameters and their covariance.
    """

    plan: Trajectory
    fit: Fit

    @property
    def names(self) -> tuple[str, ...]:
        """Of its sides."""
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
