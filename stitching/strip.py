"""What a plug-in makes of one frame."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from endoct.base.arrays import Coordinates, Image, Mask, readonly
from endoct.base.errors import EndoctError


@dataclass(frozen=True, eq=False)
class Strip:
    """One unrolled frame, on rows and columns of its recording's panorama grid.

    Attributes
    ----------
    z_mm: float64 (n_rows,), ascending; each must be a row of the panorama (see :class:`Calibration`).
    theta_rad: float64 (n_theta,), the columns of the panorama.
    intensity: float32 (n_rows, n_theta), in the unit of the recording.
    depth_mm: float32 (n_rows, n_theta), wall radius minus bore radius, or None where the modality has none.
    valid: bool (n_rows, n_theta); False where nothing was observed. Intensity and depth there mean nothing.
    weight: float32 (n_rows, n_theta), ≥ 0, how much a sample counts where strips overlap.
    diagnostics: figures of this frame, known only once it is unrolled; the same names in every frame of a recording.

    Arrays are read-only. Raises :class:`EndoctError` where shapes disagree.
    """

    z_mm: Coordinates
    theta_rad: Coordinates
    intensity: Image
    depth_mm: Image | None
    valid: Mask
    weight: Image
    diagnostics: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        set_array = object.__setattr__
        set_array(self, "z_mm", readonly(self.z_mm, np.float64))
        set_array(self, "theta_rad", readonly(self.theta_rad, np.float64))
        set_array(self, "intensity", readonly(self.intensity, np.float32))
        set_array(self, "valid", readonly(self.valid, np.bool_))
        set_array(self, "weight", readonly(self.weight, np.float32))
        if self.depth_mm is not None:
            set_array(self, "depth_mm", readonly(self.depth_mm, np.float32))
        shape = self.z_mm.size, self.theta_rad.size
        for name in ("intensity", "depth_mm", "valid", "weight"):
            array = getattr(self, name)
            if array is not None and array.shape != shape:
                raise EndoctError(
                    f"{name} of a strip has the wrong shape",
                    found=f"{array.shape}",
                    expected=f"{shape} (rows, θ)",
                )

    def __repr__(self) -> str:
        return (
            f"<Strip {self.z_mm.size} × {self.theta_rad.size} (z, θ): z {self.z_mm[0]:.2f} to {self.z_mm[-1]:.2f} mm, "
            f"{self.valid.mean():.1%} valid>"
        )
