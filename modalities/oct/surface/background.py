"""The levels of a recording: of noise, of the wall, and of the lines that the detector draws."""

import math
from dataclasses import dataclass, replace

import numpy as np

from endoct.stitching.arrays import Image, Mask

HIDDEN_SHARE = 0.6  # of the wall's contrast: nothing is seen under a line as bright as that


@dataclass(frozen=True, eq=False)
class Background:
    """Levels of a recording, in its (logarithmic) samples.

    Attributes: ``noise`` and ``noise_sigma`` of the dark space between capillary and wall; ``wall``, the typical
    level just below the wall's surface; ``line_excess``, float32 (n_depth,), how far the detector's fixed lines stand
    out of the darkness, 0 where there are none; ``floor``, float32 (n_depth,), by how much noise is brighter at each
    depth than ``noise``; ``noise_power``, the mean power of noise over its median power, 1 / ln 2 unless it was
    processed. But for ``floor``, all refer to samples less ``floor``.
    """

    noise: float
    noise_sigma: float
    wall: float
    line_excess: Image
    floor: Image
    noise_power: float = 1 / math.log(2)

    @property
    def contrast(self) -> float:
        """How far the wall stands out of the noise, in samples of the recording; more than 0."""
        return max(self.wall - self.noise, 1e-6)

    @property
    def lines(self) -> Mask:
        """At which depths there is a fixed line, bool (n_depth,)."""
        return self.line_excess > 0

    @property
    def hidden(self) -> Mask:
        """At which depths a line is as bright as the wall, so that nothing is seen under it, bool (n_depth,)."""
        return np.asarray(self.line_excess > HIDDEN_SHARE * self.contrast)

    def from_row(self, first: int) -> "Background":
        """Return the background of B-scans cropped to depths from sample ``first`` on."""
        return replace(self, line_excess=self.line_excess[first:], floor=self.floor[first:])
