"""A pneumatised mastoid in three dimensions: a network of air cells, cut by whatever is drilled through it.

Sites with log-normal radii divide space as a power diagram does (Aurenhammer 1987, "Power diagrams"): two neighbours
meet where their power distances are equal. Of its part, a cell is what lies within an ellipsoid about its site and half
a septum away from its neighbours, with rounded edges. Only a share of the sites holds air, more in some regions than in
others. Some neighbours are open to one another through a round hole in their septum.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree
from scipy.special import ndtri

from endoct.base.arrays import Coordinates, Image
from endoct.base.errors import EndoctError
from endoct.synthetic.bone.anatomy import COVER_MM, sinus_and_antrum, structures
from endoct.synthetic.bone.lattice import Lattice, trilinear
from endoct.synthetic.sample.parameters import Bore, Network, Sample
from endoct.synthetic.sample.randomness import Stage, generator

ASIDE_MM = 15.0  # Sites lie up to this far from the bore's axis, and beyond its ends.
CANDIDATES = 3.0  # So many are drawn for each site that there is room for.
NEAREST = 0.75  # Two sites are at least this far apart, over the sum of their radii.
LARGEST = 3.0  # No radius is larger than this, over the median.
BULGE = 1.1  # A site's ellipsoid is larger than its radius by this factor.
ROUND_MM = 0.12  # Edges between walls are rounded over this.
LEAST_SEPTUM_MM = 0.08  # Nodes of a field 0.06 mm apart still show such a septum.
BEYOND_MM = 0.45  # Distances in bone are right this far from a cell: enough for the thickest septum seen through.
HOLE = (0.3, 0.7)  # An opening's radius lies between these, over that of the face.
REGION_MM = 7.0  # This is the wavelength over which bone changes from dense to pneumatised.
WAVES = 24
BORE_STREAM, UNEVEN_STREAM = 1, 3  # These are two of the bore's generators.
UNEVEN_NODES, UNEVEN_STEP_MM, UNEVEN_SIGMA_MM = 48, 0.1, 0.22
UNEVEN_WITHIN_MM = 0.4
PLACES_AT_ONCE = 200_000


@dataclass(frozen=True, eq=False)
class Sites:
    """Sites in the bore frame, float64, (n,) or (n, 3).

    ``place_mm``, ``radius_mm``; ``axes`` (n, 3, 3): rows unit vectors over semi-axes of the ellipsoid; ``pairs``
    (m, 2): neighbours; ``septum_mm`` (m,) between them; ``hole_mm`` (m,): radius of their opening, 0 for none;
    ``air`` bool (n,): it holds a cell, whose number is 1 + its index.
    """

    place_mm: Coordinates
    radius_mm: Coordinates
    axes: Coordinates
    pairs: NDArray[np.intp]
    septum_mm: Coordinates
    hole_mm: Coordinates
    air: NDArray[np.bool_]

    def face(self, pair: int, of: int) -> tuple[Coordinates, float]:
        """Return the unit vector from site ``of`` to the other of a pair, and how far along it their parts meet."""
        first, second = self.pairs[pair]
        other = second if of == first else first
        way = self.place_mm[other] - self.place_mm[of]
        apart = float(np.linalg.norm(way))
        meets = (apart**2 + self.radius_mm[of] ** 2 - self.radius_mm[other] ** 2) / (2 * apart)
        return way / apart, meets


def sites(sample: Sample) -> Sites:
    """Return the sites of the bone around the bore of ``sample``."""
    return _sites(sample.bore, sample.bore_seed)


@lru_cache(maxsize=1)
def _sites(bore: Bore, bore_seed: int) -> Sites:
    network = bore.network
    if network is None:
        raise EndoctError("this bone is no network")
    rng = generator(bore_seed, Stage.BORE, BORE_STREAM)
    place, radius = _packed(rng, network, bore.length_mm)
    n = len(place)
    pairs = cKDTree(place).query_pairs(2 * BULGE * float(radius.max()), output_type="ndarray")
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    first, second = pairs.T
    apart = np.linalg.norm(place[first] - place[second], axis=1)
    close = apart < BULGE * (radius[first] + radius[second])
    pairs, apart, first, second = pairs[close], apart[close], first[close], second[close]
    septum = network.septum_mm * np.exp(network.septum_spread * rng.normal(size=len(pairs)))
    septum = np.maximum(septum, LEAST_SEPTUM_MM)
    meets = (apart**2 + radius[first] ** 2 - radius[second] ** 2) / (2 * apart)
    face = np.sqrt(np.maximum(radius[first] ** 2 - np.clip(meets, 0, None) ** 2, 0))
    hole = rng.uniform(*HOLE, len(pairs)) * face
    hole[(rng.random(len(pairs)) >= network.communicating) | (hole < 0.05)] = 0
    axes, air = _ellipsoids(rng, radius), _pneumatised(rng, network, place, n)
    longest = 1 / np.linalg.norm(axes, axis=2).min(axis=1)
    x, y, z = place.T.astype(np.float32)
    for structure in structures(bore):
        air &= structure.distance_mm(x, y, z) > longest + COVER_MM
    return Sites(place, radius, axes, pairs, septum, hole, air)


def _packed(rng: Generator, network: Network, length_mm: float) -> tuple[Coordinates, Coordinates]:
    """Return sites about the bore, none nearer to another than their radii allow; the largest come first."""
    low, high = np.array([-ASIDE_MM, -ASIDE_MM, 0]), np.array([ASIDE_MM, ASIDE_MM, length_mm + ASIDE_MM])
    median, spread = network.cell_mm / 2, network.cell_spread
    mean_volume = 4 / 3 * math.pi * median**3 * math.exp(4.5 * spread**2)
    count = math.ceil(CANDIDATES * float(np.prod(high - low)) / mean_volume)
    place = rng.uniform(low, high, (count, 3))
    radius = median * np.exp(np.clip(spread * rng.normal(size=count), -math.log(LARGEST), math.log(LARGEST)))
    within = np.hypot(place[:, 0], place[:, 1]) < ASIDE_MM
    # there is some cortical bone at the surface before the first cell
    within &= place[:, 2] > network.cortex_mm + radius
    place, radius = place[within], radius[within]
    order = np.argsort(-radius, kind="stable")
    place, radius = place[order], radius[order]
    tree = cKDTree(place)
    free = np.ones(len(place), np.bool_)
    for index in range(len(place)):
        if free[index]:
            near = np.array(tree.query_ball_point(place[index], NEAREST * 2 * radius[index]), np.intp)
            near = near[near > index]
            apart = np.linalg.norm(place[near] - place[index], axis=1)
            free[near[apart < NEAREST * (radius[near] + radius[index])]] = False
    return place[free], radius[free]


def _ellipsoids(rng: Generator, radius: Coordinates) -> Coordinates:
    """Return the axes (n, 3, 3) of ellipsoids, stretched by up to one half along a random direction."""
    n = len(radius)
    first = rng.normal(size=(n, 3))
    first /= np.linalg.norm(first, axis=1)[:, None]
    second = np.cross(first, rng.normal(size=(n, 3)))
    second /= np.linalg.norm(second, axis=1)[:, None]
    stretch = rng.uniform(1.0, 1.4, n)
    semi = BULGE * radius[:, None] * np.stack([stretch, stretch**-0.5, stretch**-0.5], axis=1)
    return np.stack([first, second, np.cross(first, second)], axis=1) / semi[:, :, None]


def _pneumatised(rng: Generator, network: Network, place: Coordinates, n: int) -> NDArray[np.bool_]:
    """Return which sites hold air: more of them in some regions."""
    waves = rng.normal(size=(WAVES, 3)) * (2 * math.pi / REGION_MM / math.sqrt(3))
    region = np.cos(place @ waves.T + rng.uniform(0, 2 * math.pi, WAVES)).sum(axis=1) / math.sqrt(WAVES / 2)
    score = network.patchiness * region + math.sqrt(1 - network.patchiness**2) * rng.normal(size=n)
    return np.asarray(score > -float(ndtri(network.pneumatised)))


def air_on(sample: Sample, lattice: Lattice) -> tuple[Image, NDArray[np.int32]]:
    """Return the clearance of every place of ``lattice``, which is in the bore frame, and the cell it belongs to.

    Both of its shape: float32, mm, > 0 in air, at least −``BEYOND_MM``; int32, 0 away from all cells.
    """
    every = sites(sample)
    clearance, cell = np.full(lattice.shape, -BEYOND_MM, np.float32), np.zeros(lattice.shape, np.int32)
    of_site: list[list[int]] = [[] for _ in every.radius_mm]
    for pair, (first, second) in enumerate(every.pairs):
        of_site[first].append(pair)
        of_site[second].append(pair)
    for site in np.flatnonzero(every.air):
        semi = every.axes[site] / np.sum(every.axes[site] ** 2, axis=1)[:, None]
        box = lattice.box(every.place_mm[site], BEYOND_MM, semi)
        if any(one.start >= one.stop for one in box):
            continue
        air = _of_site(every, int(site), of_site[site], lattice.part(box))
        known, number = clearance[box], cell[box]
        better = air > known
        np.copyto(known, air, where=better)
        np.copyto(number, np.int32(site + 1), where=better)
    _with_sinus_and_antrum(sample.bore, len(every.air) + 1, lattice, clearance, cell)
    _roughen(sample, lattice, clearance)
    return clearance, cell


def _with_sinus_and_antrum(
    bore: Bore, number: int, lattice: Lattice, clearance: Image, cell: NDArray[np.int32]
) -> None:
    """Add the antrum, which is cell ``number``, and stop cells before the sinus."""
    sinus, antrum = sinus_and_antrum(bore)
    box = antrum.box(lattice, BEYOND_MM)
    if clearance[box].size:
        x, y, z = lattice.part(box).places()
        air = -antrum.distance_mm(x, y, z)
        for structure in structures(bore):
            np.minimum(air, structure.distance_mm(x, y, z) - np.float32(COVER_MM), out=air)
        better = air > clearance[box]
        np.copyto(clearance[box], air, where=better)
        np.copyto(cell[box], np.int32(number), where=better)
    box = sinus.box(lattice, COVER_MM + BEYOND_MM)
    if clearance[box].size:
        away = sinus.distance_mm(*lattice.part(box).places()) - np.float32(COVER_MM)
        np.minimum(clearance[box], np.maximum(away, -BEYOND_MM), out=clearance[box])


def _roughen(sample: Sample, lattice: Lattice, clearance: Image) -> None:
    """Roughen the surfaces with a repeated random field, which makes septa thinner, thicker or perforated."""
    network = sample.bore.network
    if network is None or network.unevenness_mm == 0:
        return
    rng = generator(sample.bore_seed, Stage.BORE, UNEVEN_STREAM)
    noise = ndimage.gaussian_filter(
        rng.standard_normal((UNEVEN_NODES,) * 3, dtype=np.float32), UNEVEN_SIGMA_MM / UNEVEN_STEP_MM, mode="wrap"
    )
    noise *= np.float32(network.unevenness_mm / noise.std())
    flat = clearance.ravel()
    near = np.flatnonzero(np.abs(flat) < UNEVEN_WITHIN_MM)
    for first in range(0, near.size, PLACES_AT_ONCE):
        which = near[first : first + PLACES_AT_ONCE]
        x, y, z = (one * np.float32(1 / UNEVEN_STEP_MM) for one in lattice.some_places(which))
        # it ends where the surface is too far for it to matter: beyond, all distances would be wrong
        flat[which] += trilinear(noise, [z, y, x], wrap=True) * (1 - (flat[which] * (1 / UNEVEN_WITHIN_MM)) ** 2)


def _of_site(every: Sites, site: int, pairs: list[int], part: Lattice) -> Image:
    """Return the clearance of one cell, with its half of the openings to its neighbours, at the places of ``part``."""
    place = every.place_mm[site]
    u, v, w = (_linear(part, axis, -float(axis @ place)) for axis in every.axes[site])
    shortest = 1 / float(np.linalg.norm(every.axes[site], axis=1).max())
    inside: Image = np.asarray(shortest * (1 - np.sqrt(u * u + v * v + w * w)), dtype=np.float32)
    opened: Image | None = None
    for pair in pairs:
        towards, meets = every.face(pair, site)
        to_face = _linear(part, -towards, float(towards @ place) + meets)
        inside = _smooth_least(inside, to_face - np.float32(every.septum_mm[pair] / 2))
        if every.hole_mm[pair] and every.air[every.pairs[pair]].all():
            # up to the middle of the septum, and a little into the other half, which belongs to the neighbour
            hole = _hole(part, place, towards, meets, every.hole_mm[pair], every.septum_mm[pair])
            opened = hole if opened is None else np.maximum(opened, hole)
    return inside if opened is None else np.maximum(inside, opened)


def _hole(
    part: Lattice, place: Coordinates, towards: Coordinates, meets: float, radius_mm: float, septum_mm: float
) -> Image:
    """Return the clearance of a short round shaft through a septum, about the line between two sites."""
    across = np.cross(towards, [0.0, 0.0, 1.0] if abs(towards[2]) < 0.8 else [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    other = np.cross(towards, across)
    a, b = (_linear(part, axis, -float(axis @ place)) for axis in (across, other))
    along = _linear(part, towards, -float(towards @ place) - meets)
    ends = np.float32(septum_mm / 2 + ROUND_MM) - np.abs(along)
    return np.asarray(np.minimum(np.float32(radius_mm) - np.sqrt(a * a + b * b), ends))


def _linear(part: Lattice, gradient: Coordinates, constant: float) -> Image:
    """Return gradient · place + constant at all places, float32."""
    rates = part.steps_mm @ gradient
    first, second, third = ((rate * np.arange(n)).astype(np.float32) for rate, n in zip(rates, part.shape, strict=True))
    start = np.float32(float(gradient @ part.origin_mm) + constant)
    return np.asarray((first + start)[:, None, None] + (second[:, None] + third)[None])


def _smooth_least(a: Image, b: Image) -> Image:
    """Return the smaller of both, and less where they are nearly the same, a rounded edge; ``a`` is overwritten."""
    blend = a - b
    np.abs(blend, out=blend)
    np.subtract(np.float32(ROUND_MM), blend, out=blend)
    np.maximum(blend, 0, out=blend)
    blend *= blend
    blend *= np.float32(1 / (4 * ROUND_MM))
    np.minimum(a, b, out=a)
    a -= blend
    return a
