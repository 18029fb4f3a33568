"""Landmarks: a place on side A and the same place on side B, as somebody pointed them out."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.fusion.geometry.alignment import Alignment

Role = Literal["correct", "check"]
"""Pairs that correct an alignment, and others that check it: what a pair has corrected it cannot check."""
USUAL_SIGMA_MM = 0.05
"""Standard error of a place that somebody points out, where nobody says better: the rim of a cell is as wide."""


@dataclass(frozen=True)
class Place:
    """A place on the wall of one side, in the frame of that side's own panorama: θ in [0, 2π), z in mm."""

    theta_rad: float
    z_mm: float


@dataclass(frozen=True)
class LandmarkPair:
    """One place of the wall on both sides, what it is for, what it is called, and how exactly it was pointed out.

    ``sigma_mm`` is the standard error of the distance of the two, around the bore as along it.
    """

    a: Place
    b: Place
    role: Role = "correct"
    name: str = ""
    sigma_mm: float = USUAL_SIGMA_MM


def of_role(pairs: Sequence[LandmarkPair], role: Role) -> tuple[LandmarkPair, ...]:
    """Return the pairs of one role, in their order."""
    return tuple(pair for pair in pairs if pair.role == role)


def residuals_mm(pairs: Sequence[LandmarkPair], alignment: Alignment, radius_mm: float) -> Coordinates:
    """Return by how much B's place of each pair, moved by ``alignment``, lies off A's: (around, along), (n, 2), mm.

    Around the bore the shorter way, on a cylinder of ``radius_mm``.
    """
    a, b = columns(pairs)
    turned = alignment.theta_to_a(b[:, 0]) - a[:, 0]
    around_mm = radius_mm * (np.mod(turned + np.pi, 2 * np.pi) - np.pi)
    return np.stack([around_mm, alignment.z_to_a(b[:, 1]) - a[:, 1]], axis=1)


def columns(pairs: Sequence[LandmarkPair]) -> tuple[Coordinates, Coordinates]:
    """Return θ (rad) and z (mm) of the places on A, float64 (n, 2), and of those on B."""
    both = np.array([(p.a.theta_rad, p.a.z_mm, p.b.theta_rad, p.b.z_mm) for p in pairs], np.float64).reshape(-1, 4)
    return both[:, :2], both[:, 2:]
