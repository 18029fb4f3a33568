"""Where the wall of a bore lies for the parameters of its pose, and how each of them moves it.

Parameters are float64. All sides share these:

- x and y of the bore's axis at the middle of the plan's length, mm;
- its tilt against the plan, as a rotation vector about x and y, rad.

Each side has these of its own:

- the depth of its middle row along the axis, from the plan's entry, mm;
- its turn about the axis, rad;
- the relative change of its scale along z;
- the change of the radius, mm;
- how far the edges of its cells lie outward of those in the CT, mm;
- how much farther those do that run across the bore, at the near and the far end of cells, mm;
- ``TWISTS`` coefficients of a slow error of θ along z, rad;
- ``STRETCHES`` coefficients of a slow error of z, mm.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from kornia.geometry.liegroup import So3

from endoct.fusion.pose.observation import Observation

SHARED = 4
TWISTS, STRETCHES = 6, 5
DEPTH, TURN, SCALE, RADIUS, EDGE, RIMS, FIRST_TWIST = 0, 1, 2, 3, 4, 5, 6
FIRST_STRETCH = FIRST_TWIST + TWISTS
OF_SIDE = FIRST_STRETCH + STRETCHES
FREE = 100.0
"""Standard deviation of a parameter that is not known beforehand."""
SCALE_PRIOR, RADIUS_PRIOR_MM, EDGE_PRIOR_MM, TWIST_PRIOR_RAD = 0.015, 0.02, 0.1, float(np.radians(2.0))


@dataclass(frozen=True)
class Sense:
    """How a side runs: ``turning`` −1 where its θ runs against the bore's, ``inward`` −1 where its z does."""

    turning: int = 1
    inward: int = 1


def prior_deviations(sides: tuple[Observation, ...]) -> torch.Tensor:
    """Return the standard deviation of every parameter before any data, (n,)."""
    deviations = [FREE] * SHARED
    for side in sides:
        deviations += [FREE, FREE, SCALE_PRIOR, RADIUS_PRIOR_MM, EDGE_PRIOR_MM, side.rims_mm]
        deviations += [TWIST_PRIOR_RAD / k for k in range(1, TWISTS + 1)]
        deviations += [side.stretch_mm / k for k in range(1, STRETCHES + 1)]
    return torch.tensor(deviations, dtype=torch.float64)


def directions(tilt_rad: torch.Tensor) -> torch.Tensor:
    """Return x, y and z of the bore as columns (3, 3) in the plan's frame for a rotation vector (2,)."""
    axes: torch.Tensor = So3.exp(_rotation_vector(tilt_rad)).matrix()[0]
    return axes


def _directions_by_tilt(tilt_rad: torch.Tensor, axes: torch.Tensor) -> torch.Tensor:
    """Return the derivative (3, 3, 2) of the ``axes``, :func:`directions`, by the rotation vector (2,)."""
    turning = So3.hat(So3.left_jacobian(_rotation_vector(tilt_rad))[0].T)[:2]
    return (turning @ axes).permute(1, 2, 0)


def _rotation_vector(tilt_rad: torch.Tensor) -> torch.Tensor:
    return torch.cat([tilt_rad, tilt_rad.new_zeros(1)])[None]


def along_axis(side: Observation, sense: Sense, of_side: torch.Tensor, z_mm: torch.Tensor) -> torch.Tensor:
    """Return where rows at ``z_mm`` of a side lie along the axis, mm from the plan's entry."""
    from_middle = sense.inward * (z_mm - side.middle_mm)
    return (
        of_side[DEPTH]
        + (1 + of_side[SCALE]) * from_middle
        + _waves(side, z_mm, range(2, STRETCHES + 2)) @ of_side[FIRST_STRETCH:]
    )


def twist_along(side: Observation, of_side: torch.Tensor, z_mm: torch.Tensor) -> torch.Tensor:
    """Return how far θ of rows at ``z_mm`` of a side is to be turned further, rad."""
    return _waves(side, z_mm, range(1, TWISTS + 1)) @ of_side[FIRST_TWIST:FIRST_STRETCH]


def wall_places(
    side: Observation,
    sense: Sense,
    pivot_mm: float,
    parameters: torch.Tensor,
    behind_mm: float,
    samples: tuple[np.ndarray[Any, Any], ...] | None = None,
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the places of a side's samples ``behind_mm`` the wall and their derivatives.

    ``parameters`` (SHARED + OF_SIDE,) are those shared, then the side's. ``pivot_mm`` is half the plan's length.
    ``samples`` are rows and columns that are broadcast together, all of them (n_z, n_theta) by default.
    Returns float64 (…, 3) in the plan's bore frame, and (…, 3, SHARED + OF_SIDE).
    """
    shared, of_side = parameters[:SHARED], parameters[SHARED:]
    n_z, n_theta = side.layers[0].air.shape
    rows, columns = samples or np.ogrid[:n_z, :n_theta]
    z = parameters.new_tensor(side.z_mm[rows])
    theta = parameters.new_tensor(2 * np.pi / n_theta * columns)
    twists = _waves(side, z, range(1, TWISTS + 1))
    angle = (sense.turning * theta + of_side[TURN] + twist_along(side, of_side, z))[..., None]
    radius = side.radius_mm + of_side[RADIUS] + behind_mm
    from_pivot = (along_axis(side, sense, of_side, z) - pivot_mm)[..., None].expand(angle.shape)
    local = torch.cat([radius * torch.cos(angle), radius * torch.sin(angle), from_pivot], dim=-1)
    axes = directions(shared[2:])
    across = torch.cat([torch.cos(angle), torch.sin(angle)], dim=-1) @ axes[:, :2].T
    around = torch.cat([-torch.sin(angle), torch.cos(angle)], dim=-1) @ axes[:, :2].T * radius
    pivot = torch.stack([shared[0], shared[1], shared.new_tensor(pivot_mm)])
    places = pivot + local @ axes.T

    moved = places.new_zeros(*places.shape, SHARED + OF_SIDE)
    moved[..., 0, 0] = 1
    moved[..., 1, 1] = 1
    moved[..., 2:4] = torch.einsum("...j,ijk->...ik", local, _directions_by_tilt(shared[2:], axes))
    own = moved[..., SHARED:]
    own[..., DEPTH] = axes[:, 2]
    own[..., TURN] = around
    own[..., SCALE] = (sense.inward * (z - side.middle_mm))[..., None] * axes[:, 2]
    own[..., RADIUS] = across
    own[..., FIRST_TWIST:FIRST_STRETCH] = around[..., None] * twists[..., None, :]
    stretches = _waves(side, z, range(2, STRETCHES + 2))
    own[..., FIRST_STRETCH:] = axes[:, 2][:, None] * stretches[..., None, :]
    return places, moved


def _waves(side: Observation, z_mm: torch.Tensor, orders: range) -> torch.Tensor:
    """Return cosines over the length of a side, (…, len(orders)), of which any slow course is made."""
    share = (z_mm - side.middle_mm) / max(side.length_mm, 1e-9) + 0.5
    return torch.stack([torch.cos(np.pi * order * share) for order in orders], dim=-1)
