"""What a plug-in makes of one frame."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from endoct.base.arrays import Coordinates, Image, Mask, readonly
from endoct.base.errors import EndoctError

DEPTHS = ("depth_mm", "parallax_depth_mm", "parallax_error_mm")
IMAGES = {"intensity": np.float32, "valid": np.bool_, "weight": np.float32, **dict.fromkeys(DEPTHS, np.float32)}
"""Images of strips and panoramas have these types."""


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
        for name in ("z_mm", "theta_rad"):
            object.__setattr__(self, name, readonly(getattr(self, name), np.float64))
        settle_images(self, "strip", (self.z_mm.size, self.theta_rad.size), "rows, θ")

    def __repr__(self) -> str:
        return (
            f"<Strip {self.z_mm.size} × {self.theta_rad.size} (z, θ): z {self.z_mm[0]:.2f} to {self.z_mm[-1]:.2f} mm, "
            f"{self.valid.mean():.1%} valid>"
        )


def settle_images(of: object, kind: str, shape: tuple[int, int], axes: str) -> None:
    """Make the images of a frozen dataclass read-only arrays of their types; None stays.

    Raises :class:`EndoctError` where one has not ``shape``, whose ``axes`` a message names, as those of a ``kind``.
    """
    for name, dtype in IMAGES.items():
        if (values := getattr(of, name, None)) is not None:
            image = readonly(values, dtype)
            if image.shape != shape:
                problem = f"{name} of a {kind} has the wrong shape"
                raise EndoctError(problem, found=f"{image.shape}", expected=f"{shape} ({axes})")
            object.__setattr__(of, name, image)
