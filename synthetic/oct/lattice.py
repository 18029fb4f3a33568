"""The scatterers of the bone: a complex, circular Gaussian number for every place of a lattice in it.

A place is a layer across the bore (z), a node around it (θ) and a ring (r). Its number follows from the bore's seed and
from where it is, whatever is recorded of it, how often and with which instrument.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from endoct.stitching.arrays import Image
from endoct.synthetic.oct.beams import BONE_INDEX
from endoct.synthetic.oct.focus import FWHM
from endoct.synthetic.sample.parameters import Oct
from endoct.synthetic.sample.randomness import Stage, bells, generator

# spacings of the lattice: that of layers is a standard deviation of the narrowest usual spot, that of nodes less, as
# rims of cells lie on nodes; that of rings just less than an axial pixel in bone
LAYER_MM = 0.012
NODE_MM = 0.008
RING_MM = 0.003
FIRST_LAYER = 2**16  # layers before the mouth are counted too


@dataclass(frozen=True)
class Lattice:
    """Where scatterers are: layer k at z = k·``layer_mm``, node j at θ = 2πj/``n_nodes``, ring i at r = i·``ring_mm``.

    ``seed``: of the bore.
    """

    seed: int
    n_nodes: int
    layer_mm: float
    ring_mm: float

    @property
    def node_rad(self) -> float:
        """Angle between two nodes."""
        return 2 * math.pi / self.n_nodes

    def layer(self, index: int, rings: range) -> Image:
        """Return the scatterers of some rings of a layer, float32 (ring, 2·node), real and imaginary part in turn."""
        rng = generator(self.seed, Stage.SCATTERERS, FIRST_LAYER + index)
        bits = rng.bit_generator
        if isinstance(bits, np.random.PCG64):
            bits.advance(rings.start * self.n_nodes)
        words: NDArray[np.uint64] = bits.random_raw(len(rings) * self.n_nodes)
        return bells(words.reshape(len(rings), 2, self.n_nodes // 2))

    def roughness(self, index: int) -> Image:
        """Return how far the surface of dust departs at every node of a layer, (node,), rms 1."""
        words = generator(self.seed, Stage.DUST, FIRST_LAYER + index).bit_generator.random_raw(self.n_nodes // 2)
        return bells(words.reshape(2, -1))


def lattice(seed: int, radius_mm: float, oct_: Oct) -> Lattice:
    """Return the lattice of a bore, one and the same for all usual instruments, finer by 2, 4, … for finer ones."""
    sigma_mm = math.sqrt(2) * oct_.lateral_resolution_mm / FWHM
    across = 2 ** max(0, math.ceil(math.log2(LAYER_MM / sigma_mm) - 1e-6))
    deep = 2 ** max(0, math.ceil(math.log2(RING_MM * BONE_INDEX / oct_.axial_pixel_mm)))
    n_nodes = 4 * round(2 * math.pi * radius_mm / NODE_MM / 4)
    return Lattice(seed, n_nodes * across, LAYER_MM / across, RING_MM / deep)
