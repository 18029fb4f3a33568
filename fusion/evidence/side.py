"""One side of a comparison as it came in: its panorama, and the evidence for cells on it, each kind prepared once."""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

from endoct.fusion.evidence.drawn_mask import DrawnMask
from endoct.fusion.evidence.evidence import Evidence, Polarity
from endoct.fusion.evidence.parallax import ParallaxRelief, parallax_relief
from endoct.fusion.evidence.prepare import prepare
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama


@dataclass(frozen=True, eq=False)
class Side:
    """A panorama under the name of its side in a comparison; ``drawing`` where that is a mask drawn by hand.

    Evidence is prepared when it is first read, and kept. Reading it raises :class:`EndoctError` where no sample is
    valid or the intensity is constant.
    """

    name: str
    panorama: Panorama
    drawing: DrawnMask | None = None

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
    return Side(first, one, _drawing(a)), Side(second, two, _drawing(b))


def _drawing(given: Panorama | DrawnMask) -> DrawnMask | None:
    return given if isinstance(given, DrawnMask) else None
