"""The scatterers of the bone: their lattice, and those that the beams of one turn light.

A scatterer is a complex, circular Gaussian number for a place of the lattice. A place is a layer across the bore
(z), a node around it (θ) and a ring (r). Its number follows from the bore's seed and from where it is, whatever is
recorded of it, how often and with which instrument.

A node stands for the beam that crosses the bore's nominal radius at that node of the lattice. How far a scatterer
is from the catheter does not depend on where the beam points. So a node's path, surface and phase are one and the
same for all columns that see it, and a column is a sum over nodes. This is before they are summed across the beam.
"""

import math
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image
from endoct.synthetic.bone.density import BoneDensity
from endoct.synthetic.elementary import Numbers
from endoct.synthetic.oct.beams import BONE_INDEX, FWHM, spot_sigma_mm
from endoct.synthetic.oct.sweep import REACH, Sweep
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
    """Return the lattice of a bore: the same for all usual instruments, finer by 2, 4, … for finer ones."""
    sigma_mm = math.sqrt(2) * oct_.lateral_resolution_mm / FWHM
    across = 2 ** max(0, math.ceil(math.log2(LAYER_MM / sigma_mm) - 1e-6))
    deep = 2 ** max(0, math.ceil(math.log2(RING_MM * BONE_INDEX / oct_.axial_pixel_mm)))
    n_nodes = 4 * round(2 * math.pi * radius_mm / NODE_MM / 4)
    return Lattice(seed, n_nodes * across, LAYER_MM / across, RING_MM / deep)


ONE_SURFACE_MM = 0.02  # between neighbouring columns: more is a step from one surface to another
DENSITY_BINS = 16  # axial pixels for which density is looked up once: 0.05 mm of bone
MARGIN_RINGS = 3  # for the interpolation between rings


@dataclass(frozen=True, eq=False)
class Nodes:
    """The nodes that a sweep passes, in the order of θ, (node,).

    ``number``: in the lattice, counted on beyond a turn; ``near``: the column that is nearest to each. Interpolated
    between columns: ``z_mm``, ``path_mm`` and ``beyond_mm`` of the solid surface, see
    :class:`endoct.synthetic.oct.beams.Echoes`, ``slant_rad``.
    """

    number: NDArray[np.intp]
    near: NDArray[np.intp]
    z_mm: Coordinates
    path_mm: Coordinates
    beyond_mm: Coordinates
    slant_rad: Coordinates


def unwrapped_rad(sweep: Sweep) -> Coordinates:
    """Return θ at which every column crosses the bore's nominal radius, counted on beyond a turn."""
    return np.unwrap(sweep.echoes.crossing_rad)


def nodes(sweep: Sweep, places: Lattice) -> Nodes:
    """Return the nodes that the spots of all columns reach."""
    echoes, theta = sweep.echoes, unwrapped_rad(sweep)
    reach_rad = REACH * float(np.nanmax(spot_sigma_mm(sweep.oct_, echoes.wall_path_mm))) / sweep.radius_mm
    low, high = (theta.min() - reach_rad) / places.node_rad, (theta.max() + reach_rad) / places.node_rad
    number = np.arange(math.floor(low) - 1, math.ceil(high) + 2)
    columns = np.arange(theta.size, dtype=np.float64)
    sense = 1 if theta[-1] > theta[0] else -1
    column = np.interp(sense * number * places.node_rad, *_rising(sense * theta, columns))
    before = np.minimum(column.astype(np.intp), theta.size - 2)
    near, part = np.rint(column).astype(np.intp), column - before

    def between(values: Coordinates) -> Coordinates:
        first, second = values[before], values[before + 1]
        joined = np.abs(second - first) < ONE_SURFACE_MM
        return np.where(joined, first + part * (second - first), values[near])

    return Nodes(
        number=number,
        near=near,
        z_mm=np.interp(column, columns, echoes.wall_z_mm),
        path_mm=between(echoes.wall_path_mm),
        beyond_mm=between(echoes.beyond_mm),
        slant_rad=np.interp(column, columns, echoes.slant_rad),
    )


def _rising(theta: Coordinates, columns: Coordinates) -> tuple[Coordinates, Coordinates]:
    """Return the columns at which the catheter reached a new farthest place."""
    new = np.flatnonzero(theta >= np.maximum.accumulate(theta))
    return theta[new], columns[new]


def along_beams(sweep: Sweep, places: Lattice, passed: Nodes, bins: NDArray[np.intp]) -> Image:
    """Return the scatterer in each of the axial pixels ``bins`` of every node's beam, float32 (node, bin, 2).

    Real and imaginary part, variance 1 each in bone of mean density. Meaningless before bone begins.
    """
    oct_, echoes, n = sweep.oct_, sweep.echoes, passed.number.size
    way = oct_.first_sample_mm + oct_.axial_pixel_mm * bins - passed.path_mm[:, None]
    out_mm, back_mm = (path[passed.near] for path in (echoes.exit_path_mm, echoes.reentry_path_mm))
    for node in np.flatnonzero(np.isfinite(out_mm)):
        # light is faster in the gap behind a septum
        path = way[node] + passed.path_mm[node]
        way[node] += (BONE_INDEX - 1) * np.clip(np.minimum(path, back_mm[node]) - out_mm[node], 0, None)
    way /= BONE_INDEX
    way = np.nan_to_num(np.maximum(way, 0) + passed.beyond_mm[:, None]).astype(np.float32)
    outward = sweep.radius_mm + way * np.cos(passed.slant_rad).astype(np.float32)[:, None]
    aside = way * np.sin(passed.slant_rad).astype(np.float32)[:, None]
    ring = np.sqrt(outward * outward + aside * aside)
    ring *= np.float32(1 / places.ring_mm)
    shift = np.rint(aside / (outward * np.float32(places.node_rad)))
    rings = range(max(0, int(ring.min()) - MARGIN_RINGS), int(ring.max()) + MARGIN_RINGS + 2)
    least = int(shift.min())
    wider = np.arange(passed.number[0] + least, passed.number[-1] + int(shift.max()) + 1)
    z_mm = np.interp(wider, passed.number, passed.z_mm)
    stack = _across_layers(places, wider, z_mm, _sigma_across_mm(sweep), rings)
    stack *= _carrier(sweep, places, wider)
    image = np.ascontiguousarray(stack.T).view(np.float32).reshape(wider.size, len(rings), 2)
    ring -= rings.start
    shift += np.arange(n, dtype=np.float32)[:, None] - np.float32(least)
    seen = np.asarray(cv2.remap(image, ring, shift, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE), np.float32)
    if sweep.density is not None:
        seen *= _amplitude(sweep.density, places, passed, outward, aside)[:, :, None]
    return seen


def _amplitude(density: BoneDensity, places: Lattice, passed: Nodes, outward: Numbers, aside: Numbers) -> Image:
    """Return the rms of scatterers where the bone is as dense as it is, float32 (node, bin): there are as many more.

    Their places are ``outward`` and ``aside`` (node, bin) of every node's radius.
    """
    n = outward.shape[1]
    n_known = math.ceil(n / DENSITY_BINS)
    known = ((np.arange(n_known) + 0.5) * (n / n_known)).astype(np.intp)
    outward, aside = outward[:, known], aside[:, known]
    theta = (places.node_rad * passed.number).astype(np.float32)[:, None]
    x = outward * np.cos(theta) - aside * np.sin(theta)
    y = outward * np.sin(theta) + aside * np.cos(theta)
    z = np.broadcast_to(passed.z_mm.astype(np.float32)[:, None], x.shape)
    amplitude = np.sqrt(density.backscatter(x, y, z))
    return np.asarray(cv2.resize(amplitude, (n, amplitude.shape[0]), interpolation=cv2.INTER_LINEAR), np.float32)


def _sigma_across_mm(sweep: Sweep) -> float:
    """Return the width of the spot across the turn, taken at the depth of most of the wall."""
    usual = np.nanmedian(sweep.echoes.wall_path_mm, keepdims=True)
    return float(spot_sigma_mm(sweep.oct_, usual)[0])


def _carrier(sweep: Sweep, places: Lattice, number: NDArray[np.intp]) -> NDArray[np.complex64]:
    """Return exp(2i·k₀·path) at every node of the nominal wall: how its scatterers add up from where the catheter is.

    What is common to all scatterers in a spot shows in no magnitude; how their phases differ across it does, and that
    the path over the nominal wall says, as a distance in air.
    """
    wall = sweep.radius_mm * np.exp(1j * places.node_rad * number)
    path_mm = np.abs(wall - sweep.catheter_mm)
    turned = 4j * math.pi / sweep.oct_.wavelength_mm * path_mm
    return np.asarray(np.exp(turned), dtype=np.complex64)


def _across_layers(
    places: Lattice, number: NDArray[np.intp], z_mm: Coordinates, sigma_mm: float, rings: range
) -> NDArray[np.complex64]:
    """Return the scatterers of all layers that a spot at ``z_mm`` (node,) reaches, summed: complex64 (ring, node)."""
    first = math.ceil((z_mm.min() - REACH * sigma_mm) / places.layer_mm)
    last = math.floor((z_mm.max() + REACH * sigma_mm) / places.layer_mm)
    apart = np.arange(first, last + 1)[:, None] * places.layer_mm - z_mm
    weight = np.where(np.abs(apart) <= REACH * sigma_mm, np.exp(-0.5 * (apart / sigma_mm) ** 2), 0)
    weight /= np.sqrt(np.sum(weight**2, axis=0))
    total = np.zeros((len(rings), 2 * number.size), np.float32)
    # as many nodes at a time as lie side by side in the lattice
    starts = [0, *(np.flatnonzero(np.mod(number[1:], places.n_nodes) == 0) + 1).tolist(), number.size]
    for index, share in enumerate(np.repeat(weight, 2, axis=1).astype(np.float32), first):
        layer = places.layer(index, rings)
        for begin, end in pairwise(starts):
            part, at = slice(2 * begin, 2 * end), 2 * int(number[begin] % places.n_nodes)
            if np.any(share[part]):
                total[:, part] += layer[:, at : at + 2 * (end - begin)] * share[part]
    return total.view(np.complex64)
