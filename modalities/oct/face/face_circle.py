"""The capillary's outer face as a circle about its axis, seen by a catheter that lies off that axis.

Let the catheter be off by e in the direction β. A beam at the angle α then meets a circle of radius R at the distance
ρ(α) = −e cos(α − β) + √(R² − e² sin²(α − β)).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from endoct.base.arrays import Coordinates, Mask


@dataclass(frozen=True)
class Circle:
    """A circle about the capillary's axis as the beams of one slice meet it.

    Attributes: ``x_mm`` and ``y_mm``, the catheter's offset from the axis in the frame of the slice; ``axis_depth_mm``,
    the depth, from sample 0 and in the medium, at which the distance ρ from the catheter is 0; ``radius_mm``.
    """

    x_mm: float
    y_mm: float
    axis_depth_mm: float
    radius_mm: float

    @property
    def offset_mm(self) -> float:
        """Distance of the catheter from the axis, mm."""
        return float(np.hypot(self.x_mm, self.y_mm))

    @property
    def direction_rad(self) -> float:
        """Direction of the catheter's offset, rad."""
        return float(np.arctan2(self.y_mm, self.x_mm))

    def distance_mm(self, angle_rad: ArrayLike) -> Coordinates:
        """Return ρ along beams at ``angle_rad``, float64 of their shape, mm."""
        return circle_distance_mm(angle_rad, self.x_mm, self.y_mm, self.radius_mm)

    def depth_mm(self, angle_rad: ArrayLike) -> Coordinates:
        """Return the depth at which beams at ``angle_rad`` meet the circle, float64 of their shape, mm."""
        return np.asarray(self.axis_depth_mm + self.distance_mm(angle_rad))


@dataclass(frozen=True, eq=False)
class Circles:
    """Several circles, all of one radius: ``x_mm``, ``y_mm``, ``axis_depth_mm``, float64 (n,), see :class:`Circle`."""

    x_mm: Coordinates
    y_mm: Coordinates
    axis_depth_mm: Coordinates
    radius_mm: float

    def __len__(self) -> int:
        return self.x_mm.size

    @property
    def offset_mm(self) -> Coordinates:
        """Distance of the catheter from each circle's axis, float64 (n,), mm."""
        return np.hypot(self.x_mm, self.y_mm)

    def circle(self, index: int) -> Circle:
        """Return one of the circles."""
        x, y, depth = (float(values[index]) for values in (self.x_mm, self.y_mm, self.axis_depth_mm))
        return Circle(x, y, depth, self.radius_mm)


@dataclass(frozen=True, eq=False)
class Capillary(Circles):
    """The capillary's outer face: a circle of its outer radius in every slice, NaN where that is not known."""

    @classmethod
    def of(cls, circles: Sequence[Circle | None], radius_mm: float) -> "Capillary":
        """Return the capillary of one circle a slice; NaN where there is None."""
        nothing = (np.nan, np.nan, np.nan)
        rows = [nothing if one is None else (one.x_mm, one.y_mm, one.axis_depth_mm) for one in circles]
        x, y, depth = np.array(rows, dtype=np.float64).reshape(-1, 3).T.copy()
        return cls(x, y, depth, radius_mm)

    @property
    def known(self) -> Mask:
        """Whether there is a circle, bool (n_slices,)."""
        return np.isfinite(self.x_mm)

    @property
    def direction_rad(self) -> Coordinates:
        """Direction of the catheter's offset in the frame of each slice, float64 (n_slices,), rad."""
        return np.arctan2(self.y_mm, self.x_mm)

    def where(self, good: Mask) -> "Capillary":
        """Return the same circles, NaN in slices that are not ``good``, bool (n_slices,)."""
        x, y, depth = (np.where(good, values, np.nan) for values in (self.x_mm, self.y_mm, self.axis_depth_mm))
        return Capillary(x, y, depth, self.radius_mm)

    def reordered(self, order: NDArray[np.intp]) -> "Capillary":
        """Return the same circles with slice ``order[i]`` in place i."""
        return Capillary(self.x_mm[order], self.y_mm[order], self.axis_depth_mm[order], self.radius_mm)


def circle_distance_mm(
    angle_rad: ArrayLike, offset_x_mm: ArrayLike, offset_y_mm: ArrayLike, radius_mm: float
) -> Coordinates:
    """Return the length ρ(α) of a beam from a catheter at (x, y) to a circle about the axis, float64, mm.

    Shapes broadcast. The catheter must lie inside the circle.
    """
    angle = np.asarray(angle_rad, dtype=np.float64)
    x, y = np.asarray(offset_x_mm, np.float64), np.asarray(offset_y_mm, np.float64)
    cos, sin = np.cos(angle), np.sin(angle)
    along = x * cos + y * sin
    across = x * sin - y * cos
    return np.asarray(np.sqrt(np.maximum(radius_mm**2 - across**2, 0.0)) - along)
