"""The scatterers of the bone: their lattice, those that the beams of one turn light, and the speckle they return.

A scatterer is a complex, circular Gaussian number for a place of the lattice. A place is a layer across the bore
(z), a node around it (θ) and a ring (r). Its number follows from the bore's seed and from where it is, whatever is
recorded of it, how often and with which instrument.

A node stands for the beam that crosses the bore's nominal radius at that node of the lattice. How far a scatterer
is from the catheter does not depend on where the beam points. So a node's path, surface and phase are the same for all
columns that see it, and a column is a sum over nodes. The speckle is fully developed: scatterers are weakened with
depth and summed across the beam.
"""

import math
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy import sparse

from endoct.base.arrays import Coordinates, Image
from endoct.synthetic.bone.density import BoneDensity
from endoct.synthetic.elementary import Numbers
from endoct.synthetic.oct.beams import BONE_INDEX, FWHM, Echoes, coupling, spot_sigma_mm
from endoct.synthetic.oct.spectrometer import centred, roll_off
from endoct.synthetic.oct.sweep import REACH, Sweep
from endoct.synthetic.sample.parameters import Oct
from endoct.synthetic.sample.randomness import Stage, bells, generator

LAYER_MM = 0.012
"""Layers are a standard deviation of the narrowest usual spot apart."""
NODE_MM = 0.008
"""Nodes are closer than layers, as rims of cells lie on nodes."""
RING_MM = 0.003
"""Rings are just less than an axial pixel in bone apart."""
FIRST_LAYER = 2**16
"""The layer at the mouth has this number: layers before it are counted too."""
ONE_SURFACE_MM = 0.02
"""A surface changes by less than this between neighbouring columns: more is a step to another surface."""
DENSITY_BINS = 16
"""Density is looked up once for so many axial pixels: 0.05 mm of bone."""
MARGIN_RINGS = 3
"""Interpolation between rings reads so many beyond."""
NODES = 128
"""Number of nodes worked on at a time."""
NEGLIGIBLE_DB = -20.0
"""What bone returns below this is left out."""
TABLE_PER_PX = 32
"""The profile of bone over depth is tabulated for so many shifts of an axial pixel."""


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
    turned = sense * theta
    rising = np.flatnonzero(
        turned >= np.maximum.accumulate(turned)
    )  # there the catheter had turned farther than before
    column = np.interp(sense * number * places.node_rad, turned[rising], columns[rising])
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
    usual_path_mm = np.nanmedian(sweep.echoes.wall_path_mm, keepdims=True)
    sigma_mm = float(spot_sigma_mm(sweep.oct_, usual_path_mm)[0])  # across the turn, at the depth of most of the wall
    stack = _across_layers(places, wider, z_mm, sigma_mm, rings)
    stack *= _carrier(sweep, places, wider)
    image = np.ascontiguousarray(stack.T).view(np.float32).reshape(wider.size, len(rings), 2)
    ring -= rings.start
    shift += np.arange(n, dtype=np.float32)[:, None] - np.float32(least)
    seen = np.asarray(cv2.remap(image, ring, shift, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE), np.float32)
    if sweep.density is not None:
        seen *= _amplitude(sweep.density, places, passed, outward, aside)[:, :, None]
    return seen


def _amplitude(density: BoneDensity, places: Lattice, passed: Nodes, outward: Numbers, aside: Numbers) -> Image:
    """Return the rms of scatterers, float32 (node, bin): denser bone has as many more.

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


def _carrier(sweep: Sweep, places: Lattice, number: NDArray[np.intp]) -> NDArray[np.complex64]:
    """Return exp(2i·k₀·path) at every node of the nominal wall: how its scatterers add up from where the catheter is.

    What is common to all scatterers in a spot shows in no magnitude, but how their phases differ across it does. That
    follows from the path over the nominal wall, as a distance in air.
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


def speckle(sweep: Sweep) -> NDArray[np.complex64]:
    """Return the scatterers that every column's beam gathers, complex64 (column, n), of relative amplitude."""
    oct_, one, echoes = sweep.oct_, sweep.spectrometer, sweep.echoes
    n, pixel = one.window.size, oct_.axial_pixel_mm
    bone = np.zeros((sweep.turn.n, n), np.complex64)
    if not np.any(np.isfinite(echoes.wall_path_mm)):
        return bone
    places = lattice(sweep.bore_seed, sweep.radius_mm, oct_)
    passed = nodes(sweep, places)
    near, dust = passed.near, echoes.dust[passed.near]
    level_db = oct_.wall_db + sweep.wall_db[near] + oct_.dust_db * dust - echoes.shadow_db[near]
    # a steep wall returns little
    level = 10 ** (level_db / 10) * (0.06 + 0.94 * np.nan_to_num(echoes.wall_cosine[near]) ** 1.5)
    level *= coupling(oct_, np.nan_to_num(passed.path_mm))
    layer = places.roughness(round(float(np.mean(passed.z_mm)) / places.layer_mm))
    rough_mm = np.where(dust, oct_.dust_roughness_mm * layer[np.mod(passed.number, places.n_nodes)], 0)
    entry_px = (passed.path_mm + rough_mm - oct_.first_sample_mm) / pixel
    first = int(np.clip(np.nanmin(entry_px) - 1, 0, n - 1))
    last = _negligible_from(oct_, float(level.max()), first, n)

    # All nodes show one profile, shifted: they are windows of its table. Everything stands twice in a row, for the real
    # and the imaginary part.
    bins = np.arange(first, last)
    below = np.arange(-TABLE_PER_PX, (last - first + 2) * TABLE_PER_PX) / TABLE_PER_PX
    table = np.sqrt(_profile(oct_, below, np.clip(below + 0.5, 0, 1))).astype(np.float32).reshape(-1, TABLE_PER_PX).T
    above, beyond_table = np.zeros((TABLE_PER_PX, bins.size), np.float32), np.repeat(table[:, -1:], bins.size, axis=1)
    table = np.repeat(np.concatenate([above, table, beyond_table], axis=1), 2, axis=1)
    place = TABLE_PER_PX * (first + 1) - np.rint(np.nan_to_num(entry_px, nan=2.0 * n) * TABLE_PER_PX).astype(np.intp)
    start = np.clip(place // TABLE_PER_PX + bins.size, 0, table.shape[1] // 2 - bins.size)
    windows = sliding_window_view(table, 2 * bins.size, axis=1)
    # as many rings as an axial pixel holds add up in it
    rings = pixel / BONE_INDEX / places.ring_mm
    gain = np.sqrt(0.5 * rings * one.bone_unit2 * level).astype(np.float32)[:, None]
    rolled = np.repeat(roll_off(oct_, bins.astype(np.float64), n) * centred(bins), 2).astype(np.float32)
    amplitude = along_beams(sweep, places, passed, bins).reshape(near.size, -1)
    for a_block in range(0, near.size, NODES):
        some = slice(a_block, min(near.size, a_block + NODES))
        part = windows[place[some] % TABLE_PER_PX, 2 * start[some]]
        for node in np.flatnonzero(np.isfinite(echoes.exit_path_mm[near[some]])) + a_block:
            part[node - a_block] = np.repeat(_beyond_septum(oct_, echoes, int(near[node]), entry_px[node], bins), 2)
        part *= gain[some]
        part *= rolled
        amplitude[some] *= part
    bone[:, first:last] = (_spots(sweep, places, passed) @ amplitude).view(np.complex64)
    return bone


def _spots(sweep: Sweep, places: Lattice, passed: Nodes) -> sparse.csr_array:
    """Return how much of every node's light each column gathers, (column, node): a Gaussian of unit power."""
    echoes, theta = sweep.echoes, unwrapped_rad(sweep)
    path_mm = np.where(np.isfinite(echoes.wall_path_mm), echoes.wall_path_mm, np.nanmedian(echoes.wall_path_mm))
    sigma_mm = spot_sigma_mm(sweep.oct_, path_mm)
    # across the beam, where the wall is: beams diverge as they turn
    diverging = 1 + np.gradient(echoes.slant_rad, theta)
    mm_per_rad = sweep.radius_mm * np.cos(echoes.slant_rad) + np.nan_to_num(echoes.beyond_mm) * diverging
    at = theta / places.node_rad - passed.number[0]
    half = math.ceil(float(np.max(REACH * sigma_mm / (mm_per_rad * places.node_rad))))
    node = np.rint(at).astype(np.intp)[:, None] + np.arange(-half, half + 1)
    apart = (node - at[:, None]) * (places.node_rad * mm_per_rad / sigma_mm)[:, None]
    known = (node >= 0) & (node < passed.number.size)
    weight = np.where(known & (np.abs(apart) <= REACH), np.exp(-0.5 * apart**2), 0)
    weight /= np.sqrt(np.sum(weight**2, axis=1, keepdims=True))
    n_columns, n_taps = node.shape
    ends = n_taps * np.arange(n_columns + 1)
    chosen = np.clip(node, 0, passed.number.size - 1).ravel()
    shape = n_columns, passed.number.size
    return sparse.csr_array((weight.astype(np.float32).ravel(), chosen, ends), shape=shape)


def _beyond_septum(oct_: Oct, echoes: Echoes, column: int, entry_px: float, bins: NDArray[np.intp]) -> Coordinates:
    """Return the amplitude from axial pixels ``bins`` of a beam that leaves bone and may meet it again."""
    ends = [echoes.exit_path_mm[column], echoes.reentry_path_mm[column]]
    out, back = (np.nan_to_num(np.array(ends), nan=np.inf) - oct_.first_sample_mm) / oct_.axial_pixel_mm
    inside, beyond = bins - entry_px, np.minimum(bins, back) - out
    gap = np.clip(bins + 0.5 - out, 0, 1) - np.clip(bins + 0.5 - back, 0, 1)
    share = np.clip(inside + 0.5, 0, 1)
    left: Coordinates = np.sqrt(_profile(oct_, inside - np.maximum(beyond, 0), share - np.minimum(gap, share)))
    return left


def _profile(oct_: Oct, below_px: Coordinates, share: Coordinates) -> Coordinates:
    """Return the intensity from axial pixels with ``below_px`` of bone above them, a ``share`` of them bone."""
    depth_mm = np.maximum(below_px, 0) * oct_.axial_pixel_mm / BONE_INDEX
    tail = 10 ** (oct_.tail_db / 10)
    profile: Coordinates = (1 - tail) * np.exp(-depth_mm / oct_.attenuation_mm) + tail * np.exp(
        -depth_mm / oct_.tail_mm
    )
    return share * profile


def _negligible_from(oct_: Oct, most: float, first: int, n: int) -> int:
    """Return the axial pixel from which bone that begins at ``first`` cannot be seen, not even folded back."""
    bins = np.arange(first, n, dtype=np.float64)
    left = _profile(oct_, bins - first, np.ones_like(bins))
    bright = np.flatnonzero(most * left * roll_off(oct_, bins, n) ** 2 > 10 ** (NEGLIGIBLE_DB / 10))
    return first + (int(bright[-1]) + 1 if bright.size else 1)
