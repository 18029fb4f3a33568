"""Cells drawn by hand."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from endoct.base.arrays import Mask
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama

MASK_MODALITY = "mask"


@dataclass(frozen=True, eq=False)
class DrawnMask:
    """The cells that one rater drew in one session.

    Attributes
    ----------
    grid: rows and columns of the drawing, the full circle of θ.
    mask: bool (n_z, n_theta), cells.
    rater, session: who drew it, and when; texts.
    drawn_on: the panorama on whose samples it was drawn; None where the drawing has rows of its own.
    file: name of the file it was read from.
    """

    grid: SurfaceGrid
    mask: Mask
    rater: str
    session: str
    drawn_on: Panorama | None = None
    file: str = ""

    def lies_on(self, panorama: Panorama) -> bool:
        """Whether it was drawn on samples that lie where those of ``panorama`` do, and so needs no alignment."""
        return self.drawn_on is not None and self.grid == panorama.grid

    @cached_property
    def panorama(self) -> Panorama:
        """The drawing as a panorama of the modality "mask": intensity 0 or 1, everything valid."""
        return Panorama(
            grid=self.grid,
            intensity=self.mask.astype(np.float32),
            depth_mm=None,
            valid=np.ones(self.mask.shape, np.bool_),
            weight=np.ones(self.mask.shape, np.float32),
            modality=MASK_MODALITY,
            # a mask drawn on the other side's panorama has its frame; of any other, nobody said
            handedness_known=self.drawn_on is not None,
            travel_known=self.drawn_on is not None,
            provenance={
                "drawn_on_other_side": self.drawn_on is not None,
                "mask": self.file,
                "rater": self.rater,
                "session": self.session,
            },
        )
