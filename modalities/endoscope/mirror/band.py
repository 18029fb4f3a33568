"""The band of wall that one frame shows, between the rims of the annulus, and the rows it is surveyed on."""

from dataclasses import dataclass

import numpy as np

from endoct.modalities.endoscope.manifest import EndoscopeAcquisition
from endoct.modalities.endoscope.mirror.optics import ConeOptics, assumed_cone, stated_optics
from endoct.modalities.endoscope.mirror.reference import Reference
from endoct.stitching.arrays import Coordinates
from endoct.stitching.errors import EndoctError

LEAST_ROWS, MOST_ROWS = 8, 96
RIM_PX = 2.0


@dataclass(frozen=True, eq=False)
class Band:
    """``optics`` between the rims; ``outward_mm``, float64 (n_rows,), ascending: rows from the band's middle.

    Outward means towards the outer rim: z where that rim looks ahead, −z where it looks behind.
    """

    optics: ConeOptics
    outward_mm: Coordinates

    @property
    def half_mm(self) -> float:
        """From the middle to the last row, mm."""
        return float(self.outward_mm[-1])

    @property
    def row_mm(self) -> float:
        """From row to row, mm."""
        return float(self.outward_mm[1] - self.outward_mm[0])

    @property
    def r_px(self) -> Coordinates:
        """Image radius of every row, float64 (n_rows,), in pixels of the files."""
        return self.optics.r_px(self.optics.rim_sign * self.outward_mm)

    def rescaled(self, ratio: float) -> "Band":
        """Return the band ``ratio`` times as long, by a cone that is assumed."""
        o = self.optics
        cone = assumed_cone(o.inner_px, o.outer_px, ratio * o.visible_length_mm, o.bore_radius_mm, o.rim_sign)
        return Band(cone, self.outward_mm * ratio)


def stated_band(acquisition: EndoscopeAcquisition, reference: Reference) -> tuple[Band, tuple[str, ...]]:
    """Return the band as the sidecar has its optics, and notes where it contradicts itself.

    Raises :class:`EndoctError` where the annulus is too narrow, or the sidecar gives no scale.
    """
    annulus = reference.annulus.scaled(reference.factor)
    optics, notes = stated_optics(acquisition, annulus.inner_px, annulus.outer_px)
    width_px, margin_px = annulus.outer_px - annulus.inner_px, RIM_PX * reference.factor
    half_mm = optics.visible_length_mm / 2 - margin_px * optics.mm_per_px
    if half_mm <= 0:
        raise EndoctError(
            "the annulus is too narrow to be unrolled",
            found=f"{width_px:.0f} px from its inner to its outer rim",
            expected=f"more than {2 * margin_px:.0f} px",
            remedy="check 'annulus' in the sidecar",
        )
    n_rows = int(np.clip(round(width_px / reference.factor), LEAST_ROWS, MOST_ROWS))
    return Band(optics, np.linspace(-half_mm, half_mm, n_rows)), notes
