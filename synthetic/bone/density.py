"""How dense bone is from place to place: what CT, OCT and endoscope all show of its inside.

Trabecular and compact bone give way to one another at random. Channels of vessels run through both, about the curves on
which two smooth random fields are zero. Such a channel holds a vessel and marrow, which the drill cuts flush: the wall
is not missing there, so that truth has no cell.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

from endoct.base.arrays import Image
from endoct.synthetic.bone.lattice import Lattice
from endoct.synthetic.elementary import Numbers
from endoct.synthetic.sample.parameters import Density, Sample
from endoct.synthetic.sample.randomness import Stage, generator

DENSITY_STREAM = 6
"""Which of the bore's generators draws the density."""
NODES, STEP_MM = (320, 80, 80), 0.1
"""Nodes along z, y and x repeat; along z, they do so after more than a bore is long in any preset."""
LEAST, MOST = 0.3, 1.7
"""Outside channels the density lies between these, relative to its mean."""
EDGE_MM = 0.03
"""A channel's wall is blurred over this, which nodes 0.1 mm apart still show."""
STEEPNESS = 1.6
"""Mean gradient of a field in three dimensions, over the rms of one of its components."""


@dataclass(frozen=True, eq=False)
class BoneDensity:
    """Nodes (z, y, x) of the bore frame, ``STEP_MM`` apart and repeated, the first at its origin; float32.

    ``bone``: density relative to its mean, without channels; ``channel_mm2``: square of how far the nearest channel's
    middle is; ``drawn``: what both follow from.
    """

    bone: Image
    channel_mm2: Image
    drawn: Density

    def backscatter(self, x: Numbers, y: Numbers, z: Numbers) -> Image:
        """Return how strongly places scatter the light of the OCT, in power: in proportion to their mineral."""
        return np.maximum(self.at(x, y, z), np.float32(10 ** (self.drawn.marrow_db / 10)))

    def albedo(self, x: Numbers, y: Numbers, z: Numbers) -> Image:
        """Return the albedo of places over that of bone of mean density."""
        return np.asarray(1 + np.float32(self.drawn.albedo) * (self.at(x, y, z) - 1), np.float32)

    def at(self, x: Numbers, y: Numbers, z: Numbers) -> Image:
        """Return the density of places (any shape) relative to the mean of bone, float32; 0 within a channel."""
        places = np.stack([z, y, x]) * np.float32(1 / STEP_MM)
        bone, channel_mm2 = (
            ndimage.map_coordinates(values, places, output=np.float32, order=1, mode="grid-wrap")
            for values in (self.bone, self.channel_mm2)
        )
        return self._with_channels(bone, channel_mm2)

    def on(self, lattice: Lattice) -> Image:
        """Return :meth:`at` of every place of ``lattice``, which is in the bore frame."""
        matrix, first = lattice.steps_mm[:, ::-1].T / STEP_MM, lattice.origin_mm[::-1] / STEP_MM
        bone, channel_mm2 = (
            ndimage.affine_transform(values, matrix, first, lattice.shape, np.float32, order=1, mode="grid-wrap")
            for values in (self.bone, self.channel_mm2)
        )
        return self._with_channels(bone, channel_mm2)

    def _with_channels(self, bone: Image, channel_mm2: Image) -> Image:
        if self.drawn.channel_mm > 0:
            beyond_mm = np.sqrt(channel_mm2) - np.float32(self.drawn.channel_mm / 2)
            bone *= np.clip(beyond_mm / np.float32(EDGE_MM) + np.float32(0.5), 0, 1)
        return bone


def density_of(sample: Sample) -> BoneDensity | None:
    """Return the density of the bone of ``sample``, None where it is everywhere the same."""
    density = sample.bore.density
    if density is None or density.contrast == density.channel_mm == 0:
        return None
    return _density(density, sample.bore_seed)


@lru_cache(maxsize=1)
def _density(density: Density, bore_seed: int) -> BoneDensity:
    rng = generator(bore_seed, Stage.BORE, DENSITY_STREAM)
    noise = rng.standard_normal((3, *NODES), dtype=np.float32)
    # of noise blurred by σ, correlation falls to 1/e over 2σ
    bone = _blurred(noise[0], density.scale_mm / 2) * np.float32(density.contrast) + 1
    # such curves cross a surface 1/(4πσ²) times a unit of area
    sigma_mm = 1 / math.sqrt(4 * math.pi * density.channels_per_mm2)
    first, second = (_blurred(one, sigma_mm) for one in noise[1:])
    slope = STEEPNESS / (math.sqrt(2) * sigma_mm)
    channel_mm2 = np.asarray((first * first + second * second) / slope**2, np.float32)
    return BoneDensity(np.clip(bone, LEAST, MOST, out=bone), channel_mm2, density)


def _blurred(noise: Image, sigma_mm: float) -> Image:
    """Return ``noise`` blurred by a Gaussian, mean 0, rms 1, repeated along all axes."""
    spectrum: NDArray[np.complex64] = fft.rfftn(noise, workers=1)
    steps = [fft.fftfreq(n, STEP_MM) for n in noise.shape[:2]] + [fft.rfftfreq(noise.shape[2], STEP_MM)]
    for axis, per_mm in enumerate(steps):
        weight = np.exp(-2 * (math.pi * sigma_mm * per_mm) ** 2).astype(np.float32)
        spectrum *= weight.reshape([-1 if axis == a else 1 for a in range(3)])
    spectrum[0, 0, 0] = 0
    field: Image = fft.irfftn(spectrum, noise.shape, workers=1)
    return np.asarray(field / np.sqrt(np.mean(np.square(field, dtype=np.float64))), dtype=np.float32)
