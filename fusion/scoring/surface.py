"""The wall as one side shows it, on a grid that both sides share."""

from dataclasses import dataclass
from functools import cached_property

from endoct.base.arrays import Image, Mask
from endoct.fusion.segmentation.regions import Labels, label_in_order


@dataclass(frozen=True, eq=False)
class Surface:
    """What one side knows of the wall on a common grid, all (n_z, n_theta).

    ``mask``, ``valid`` bool; ``relief_mm`` float32 or None: behind the wall, NaN where unknown; ``relief_error_mm``
    float32 or None: its standard error, where that is stated, as of depth by parallax; ``contrast`` float32 or None:
    the evidence by which its cells were separated from the wall, where that is intensity.
    """

    name: str
    mask: Mask
    valid: Mask
    relief_mm: Image | None = None
    contrast: Image | None = None
    relief_error_mm: Image | None = None

    @cached_property
    def labels(self) -> Labels:
        """Its cells by number, int32 (n_z, n_theta), as :func:`endoct.fusion.segmentation.regions.label_in_order`."""
        return label_in_order(self.mask)
