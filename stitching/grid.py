"""The cylinder surface grid, the only converter between array index and place on the bore wall.

::

    column      0        1        2             n−1      0 again
    centre      θ0      θ0+Δθ    θ0+2Δθ          …       θ is a circle: column n is column 0
    edges    |    .   |    .   |    .   |   …  |   .   |

Integer index = pixel centre. Rows are z (mm, inward), columns are θ (rad). Columns are even; rows need not be.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.base.files.files import check_array_size


@dataclass(frozen=True)
class SurfaceGrid:
    """A grid over the full circle of a bore wall.

    Attributes: ``n_z`` rows and ``n_theta`` columns; ``z0_mm`` and ``theta0_rad`` the centre of row 0 and
    column 0; ``dz_mm`` > 0 and ``dtheta_rad`` the steps; ``radius_mm`` the nominal bore radius; ``rows_mm`` the centres
    of rows that do not lie at even steps, of which ``dz_mm`` is then the typical one, else None.

    Raises :class:`EndoctError` where a step is not positive, the columns do not close the circle, or rows do not
    ascend. Raises it also where a panorama on the grid would take more memory than one array may.

    >>> grid = SurfaceGrid.full_circle(150, 360, z0_mm=0.0, dz_mm=0.2, radius_mm=1.25)
    >>> grid
    <SurfaceGrid 150 × 360 (z, θ): z 0.00 to 29.80 mm every 0.2 mm, bore ⌀ 2.5 mm>
    >>> float(grid.row_of(3.0)), float(grid.column_of(np.pi))
    (15.0, 180.0)
    >>> f"{grid.dtheta_mm:.4f} mm"
    '0.0218 mm'
    """

    n_z: int
    n_theta: int
    z0_mm: float
    dz_mm: float
    theta0_rad: float
    dtheta_rad: float
    radius_mm: float
    rows_mm: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        if self.n_z < 1 or self.n_theta < 1:
            raise EndoctError(
                "a surface grid needs rows and columns", found=f"{self.n_z} × {self.n_theta}", expected="at least 1 × 1"
            )
        check_array_size(self.shape, np.dtype(np.float32).itemsize, "a panorama of that length and those steps")
        for name in ("dz_mm", "dtheta_rad", "radius_mm"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise EndoctError(f"{name} of a surface grid must be positive", found=f"{value}")
        if abs(self.n_theta * self.dtheta_rad - 2 * np.pi) > 1e-9 * self.n_theta:
            raise EndoctError(
                "the columns of a surface grid must close the circle",
                found=f"{self.n_theta} × {self.dtheta_rad} rad",
                expected="2π rad in all",
            )
        if self.rows_mm is not None:
            rows = np.asarray(self.rows_mm)
            if rows.shape != (self.n_z,) or not np.isfinite(rows).all() or not np.all(np.diff(rows) > 0):
                raise EndoctError("the rows of a panorama must have one ascending z each")

    def __repr__(self) -> str:
        return (
            f"<SurfaceGrid {self.n_z} × {self.n_theta} (z, θ): z {self.z0_mm:.2f} to {self.z_mm[-1]:.2f} mm "
            f"every {self.dz_mm:.4g} mm, bore ⌀ {2 * self.radius_mm:.3g} mm>"
        )

    @classmethod
    def full_circle(
        cls, n_z: int, n_theta: int, *, z0_mm: float, dz_mm: float, radius_mm: float, theta0_rad: float = 0.0
    ) -> "SurfaceGrid":
        """Return the grid whose ``n_theta`` columns share the circle evenly."""
        return cls(n_z, n_theta, z0_mm, dz_mm, theta0_rad, 2 * np.pi / n_theta, radius_mm)

    def with_rows(self, z_mm: ArrayLike) -> "SurfaceGrid":
        """Return the grid with its rows at ``z_mm``, (n_z,), ascending, which need not be even."""
        even = replace(self, rows_mm=None)
        rows = np.asarray(z_mm, dtype=np.float64)
        return even if np.array_equal(rows, even.z_mm) else replace(self, rows_mm=tuple(rows.tolist()))

    @property
    def shape(self) -> tuple[int, int]:
        """(n_z, n_theta)."""
        return self.n_z, self.n_theta

    @property
    def z_mm(self) -> Coordinates:
        """Centre of every row, float64 (n_z,), mm, ascending."""
        if self.rows_mm is not None:
            return np.array(self.rows_mm, dtype=np.float64)
        return self.z0_mm + self.dz_mm * np.arange(self.n_z, dtype=np.float64)

    @property
    def theta_rad(self) -> Coordinates:
        """Centre of every column, float64 (n_theta,), rad, ascending from ``theta0_rad``."""
        return self.theta0_rad + self.dtheta_rad * np.arange(self.n_theta, dtype=np.float64)

    @property
    def dtheta_mm(self) -> float:
        """Arc length of one column on the nominal wall, mm."""
        return self.dtheta_rad * self.radius_mm

    def row_of(self, z_mm: ArrayLike) -> Coordinates:
        """Return the fractional row index of ``z_mm`` (any shape), not limited to the grid."""
        places = np.asarray(z_mm, dtype=np.float64)
        if self.rows_mm is None:
            return (places - self.z0_mm) / self.dz_mm
        beyond = places - np.clip(places, self.rows_mm[0], self.rows_mm[-1])
        return np.asarray(np.interp(places, self.rows_mm, np.arange(self.n_z)) + beyond / self.dz_mm)

    def column_of(self, theta_rad: ArrayLike) -> Coordinates:
        """Return the fractional column index of ``theta_rad`` (any shape), in [0, n_theta)."""
        columns = (np.asarray(theta_rad, dtype=np.float64) - self.theta0_rad) / self.dtheta_rad
        wrapped = np.mod(columns, self.n_theta)
        # a hair below 0 rounds up to n_theta itself, which is column 0
        return np.where(wrapped >= self.n_theta, 0.0, wrapped)


def grid_attributes(grid: SurfaceGrid) -> dict[str, float]:
    """Return the attributes of a store from which :func:`~endoct.stitching.store.stored_grid` makes ``grid`` again."""
    return {"radius_mm": grid.radius_mm, "z0_mm": grid.z0_mm, "dz_mm": grid.dz_mm, "theta0_rad": grid.theta0_rad}
