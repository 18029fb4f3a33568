"""One side of a comparison as it came in: a panorama or a mask drawn by hand, with the evidence for cells on it."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from endoct.base.arrays import Mask
from endoct.fusion.evidence import MASK_MODALITY
from endoct.fusion.evidence.evidence import Evidence, Polarity, prepare
from endoct.fusion.evidence.relief import ParallaxRelief, parallax_relief
from endoct.fusion.geometry.placement import bore_scale, scaled_grid, scaled_panorama
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama


@dataclass(frozen=True, eq=False)
class DrawnMask:
    """The cells that one rater drew in one session.

    Attributes
    ----------
    grid: rows and columns of the drawing, over the full circle of θ.
    mask: the cells, bool (n_z, n_theta).
    rater, session: texts that say who drew it, and when.
    drawn_on: the panorama on whose samples it was drawn; None where the drawing has rows of its own.
    file: the name of the file it was read from.
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
            # a mask drawn on the other side's panorama has its frame; of any other nothing is known
            handedness_known=self.drawn_on is not None,
            travel_known=self.drawn_on is not None,
            provenance={
                "drawn_on_other_side": self.drawn_on is not None,
                "mask": self.file,
                "rater": self.rater,
                "session": self.session,
            },
        )


@dataclass(frozen=True, eq=False)
class Side:
    """A panorama under the name of its side in a comparison; ``drawing`` where that is a mask drawn by hand.

    ``reference_scale``: how many times as wide as in ``in_reference`` its bore is; None where its own radius says it.

    Each kind of evidence is prepared once, when it is first read. Reading it raises :class:`EndoctError` where no
    sample is valid or the intensity is constant.
    """

    name: str
    panorama: Panorama
    drawing: DrawnMask | None = None
    reference_scale: float | None = None

    @property
    def scale(self) -> float:
        """How many times as wide as in ``in_reference`` its bore is: 1 in bone."""
        return bore_scale(self.grid.radius_mm) if self.reference_scale is None else self.reference_scale

    @cached_property
    def in_reference(self) -> "Side":
        """The side as evidence for cells is to be looked at: itself, where the bore is not far wider than in bone."""
        if self.scale == 1:
            return self
        drawing = self.drawing and replace(self.drawing, grid=scaled_grid(self.drawing.grid, 1 / self.scale))
        return Side(self.name, scaled_panorama(self.panorama, 1 / self.scale), drawing, 1.0)

    @property
    def grid(self) -> SurfaceGrid:
        """Where its own samples lie."""
        return self.panorama.grid

    @cached_property
    def evidence(self) -> Evidence:
        """What the side is aligned by: relief where it has depth, else darkness; a mask as it is."""
        return prepare(self.panorama)

    @property
    def relief(self) -> Evidence | None:
        """How far the surface lies behind the wall; None where the side has no depth."""
        return self.evidence if self.evidence.kind == "relief" else None

    @cached_property
    def parallax(self) -> ParallaxRelief | None:
        """Relief by parallax; None where the side has none, or depth of its own."""
        return parallax_relief(self.panorama) if self.relief is None else None

    def cell_evidence(self, of: Literal["relief", "intensity"], polarity: Polarity = "dark") -> Evidence:
        """Return the evidence that cells are segmented by: relief, if wanted and there is one, else the intensity.

        ``polarity`` says whether cells are dark or bright. A mask is taken as it is.
        """
        if self.evidence.kind == "mask" or (of == "relief" and self.relief is not None):
            return self.evidence
        return self.contrast(polarity)

    def contrast(self, polarity: Polarity) -> Evidence:
        """Return the evidence in the intensity for cells that are dark, or bright."""
        return self._darkness if polarity == "dark" else self._brightness

    @cached_property
    def _darkness(self) -> Evidence:
        return self.evidence if self.evidence.kind == "darkness" else prepare(self.panorama, prefer="intensity")

    @cached_property
    def _brightness(self) -> Evidence:
        return prepare(self.panorama, prefer="intensity", polarity="bright")

    def is_drawn_on(self, other: "Side") -> bool:
        """Whether this is a mask drawn on the samples of ``other``, and so needs no alignment."""
        return self.drawing is not None and self.drawing.lies_on(other.panorama)


def two_sides(a: Panorama | DrawnMask, b: Panorama | DrawnMask) -> tuple[Side, Side]:
    """Return ``a`` and ``b`` as sides named after their modalities, numbered where these are the same."""
    one, two = (given.panorama if isinstance(given, DrawnMask) else given for given in (a, b))
    first, second = one.modality, two.modality
    if first == second:
        first, second = f"{first}-1", f"{second}-2"
    scale = bore_scale(one.grid.radius_mm)
    return Side(first, one, _drawing(a), scale), Side(second, two, _drawing(b), scale)


def _drawing(given: Panorama | DrawnMask) -> DrawnMask | None:
    return given if isinstance(given, DrawnMask) else None
