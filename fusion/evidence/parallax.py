"""Relief by parallax: how far a surface seen by a camera lies behind the wall, where that is known."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from endoct.base.arrays import Image, Mask
from endoct.fusion.evidence.relief import relief
from endoct.stitching.panorama import Panorama

LEAST_KNOWN = 0.2
"""Where depth is known on less of a panorama than this, it does not show where the wall is."""


@dataclass(frozen=True, eq=False)
class ParallaxRelief:
    """Relief on a panorama's own samples.

    ``relief_mm`` and its standard error ``error_mm``, float32 (n_z, n_theta), NaN where the depth is not known.
    """

    relief_mm: Image
    error_mm: Image

    @cached_property
    def known(self) -> Mask:
        """Where it is known, bool (n_z, n_theta)."""
        return np.isfinite(self.relief_mm)


def parallax_relief(panorama: Panorama) -> ParallaxRelief | None:
    """Return the relief of ``panorama`` by parallax; None where it has no such depth, or too little of it."""
    depth_mm, error_mm = panorama.parallax_depth_mm, panorama.parallax_error_mm
    if depth_mm is None or error_mm is None:
        return None
    known = panorama.valid & np.isfinite(depth_mm) & np.isfinite(error_mm)
    if known.mean() < LEAST_KNOWN:
        return None
    behind_mm = relief(np.where(known, depth_mm, np.float32(0)), known, panorama.z_mm)
    unknown = np.float32(np.nan)
    return ParallaxRelief(np.where(known, behind_mm, unknown), np.where(known, error_mm, unknown))
