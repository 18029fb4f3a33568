"""The air of three-dimensional bone: how far each place is from the nearest surface, and in which cell it lies."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from endoct.base.arrays import Coordinates, Image
from endoct.base.errors import EndoctError
from endoct.modalities.ct.trajectory import axes_at
from endoct.synthetic.bone.lattice import Lattice, resampled, trilinear
from endoct.synthetic.bone.network import air_on
from endoct.synthetic.bone.patient import bone_around, bore_to_lps, check_bone_share
from endoct.synthetic.elementary import Numbers
from endoct.synthetic.sample.parameters import Sample, Volume
from endoct.synthetic.sample.randomness import Stage, generator

STEEPEST = 1.25
"""The clearance falls no faster than this between nodes: 1 for a distance, more for what detail is added."""
Vectors = tuple[Numbers, Numbers, Numbers]
"""Vectors are x, y and z, (n,) each."""
EDGE_MM = 0.012
"""The rim of an opening is rounded over this, as those of planted cells are."""
REACH_MM = 4.2
"""The field ends this far from the axis, as far as the OCT's beams are followed; beyond, it goes on as it is there."""
FILLINGS_STREAM, DETAIL_STREAM = 101, 102
"""These are the wall's generators that draw fillings and detail, beyond those of its textures."""
DETAIL_NODES, DETAIL_STEP_MM, DETAIL_SIGMA_NODES = 64, 0.02, 1.5
WALL_PLACES = 64
NETWORK_STEP_MM, VOLUME_STEPS_MM = 0.06, (0.04, 0.1)
FILLED_EVERY = 3
"""The extent of a cell is looked up at every third node along each axis."""


@dataclass(frozen=True, eq=False)
class Field:
    """Nodes (z, y, x) of the bore frame, ``step_mm`` apart, the first at ``origin_mm`` (x, y, z).

    ``clearance_mm`` float32: distance to the nearest surface of the bone as it was before drilling, > 0 in air;
    ``cell`` int32: the cell that a place belongs to, in air and in the bone near by, 0 for none.

    ``level_mm`` and ``dust_mm`` float32 (n + 1,): how far along ``down`` the surface of the fluid, and of the dust,
    lies in each cell, ∞ without. ``down`` (3,) is a unit vector. ``detail`` float32 (k, k, k), its nodes
    ``detail_step_mm`` apart and repeated: roughness that is added to the clearance, of shape (0, 0, 0) for none.
    """

    clearance_mm: Image
    cell: NDArray[np.int32]
    origin_mm: Coordinates
    step_mm: float
    down: Coordinates
    level_mm: Image
    dust_mm: Image
    detail: Image
    detail_step_mm: float

    def air_mm(self, x: Numbers, y: Numbers, z: Numbers) -> Numbers:
        """Return the clearance of places (n,), whatever fills the cells; trilinear, beyond the border as at it."""
        at = self._index(x, y, z)
        air = trilinear(self.clearance_mm, at, wrap=False)
        if self.detail.size:
            near = np.flatnonzero(np.abs(air) < 8 * self.detail_step_mm)
            fine = [values.take(near) * (1 / self.detail_step_mm) for values in (z, y, x)]
            air[near] += trilinear(self.detail, fine, wrap=True)
        return air

    def clear_mm(self, x: Numbers, y: Numbers, z: Numbers) -> Numbers:
        """Return the clearance of places (n,), to bone or to the dust in a cell."""
        air = self.air_mm(x, y, z)
        return np.minimum(air, self.above_dust_mm(x, y, z)) if self.dusty else air

    @property
    def dusty(self) -> bool:
        """Whether there is dust in any cell."""
        return bool(np.isfinite(self.dust_mm).any())

    def above_dust_mm(self, x: Numbers, y: Numbers, z: Numbers) -> Numbers:
        """Return how far places (n,) are above the dust in their cell, ∞ where there is none."""
        return np.asarray(self.dust_mm[self.cell_at(x, y, z)] - self.depth_mm(x, y, z))

    def fluid_mm(self, cell: NDArray[np.int32], origin: Vectors, heading: Vectors, end: Numbers) -> Numbers:
        """Return where rays that end at ``end`` (n,) below the fluid of their ``cell`` (n,) enter it, else NaN.

        ``origin`` and ``heading``: three of (n,). A ray that goes up through a fluid counts as one that meets none.
        """
        level = self.level_mm[cell]
        start, sinks = self.depth_mm(*origin), self.depth_mm(*heading)
        below = (sinks > 1e-6) & (start + end * sinks > level) & (start < level)
        return np.where(below, (level - start) / np.maximum(sinks, 1e-6), np.float32(np.nan))

    def depth_mm(self, x: Numbers, y: Numbers, z: Numbers) -> Numbers:
        """Return the depth of places (n,) along ``down``."""
        down = self.down.astype(x.dtype)
        return np.asarray(x * down[0] + y * down[1] + z * down[2])

    def cell_at(self, x: Numbers, y: Numbers, z: Numbers) -> NDArray[np.int32]:
        """Return the cell of the node nearest to each place (n,)."""
        index = [
            np.clip(np.rint(at), 0, n - 1).astype(np.intp)
            for at, n in zip(self._index(x, y, z), self.cell.shape, strict=True)
        ]
        return np.asarray(self.cell[index[0], index[1], index[2]])

    def _index(self, x: Numbers, y: Numbers, z: Numbers) -> list[Numbers]:
        per_mm, (x0, y0, z0) = 1 / self.step_mm, (float(one) for one in self.origin_mm)
        return [(values - first) * per_mm for values, first in ((z, z0), (y, y0), (x, x0))]


def joined_with_bore(bore_mm: Numbers, field_mm: Numbers) -> Numbers:
    """Return the clearance of the bore and of the air in bone together, rounded where both surfaces meet."""
    blend = np.maximum(EDGE_MM - np.abs(bore_mm - field_mm), 0)
    return np.asarray(np.maximum(bore_mm, field_mm) + blend * blend / (4 * EDGE_MM))


def build_field(sample: Sample) -> Field:
    """Return the air in the bone of ``sample``, which is three-dimensional."""
    volume, network = sample.bore.volume, sample.bore.network
    step, detail = NETWORK_STEP_MM, 0.0
    if network is not None:
        detail = network.detail_mm
    if volume is not None:
        finest = bone_around(volume, REACH_MM).lattice.spacing_mm.min() / 2
        step, detail = float(np.clip(finest, *VOLUME_STEPS_MM)), volume.detail_mm
    lattice = Lattice.around_bore(sample.bore.length_mm, REACH_MM, step)
    clearance, cell = air_in_bone(sample, lattice, REACH_MM)
    field = _filled(sample, lattice, step, clearance, cell, detail)
    if volume is not None:
        check_bone_share(_bone_share(sample, field), volume)
    return field


def air_in_bone(sample: Sample, lattice: Lattice, reach_mm: float) -> tuple[Image, NDArray[np.int32]]:
    """Return the clearance and the cell of every place of ``lattice``, within ``reach_mm`` of the bore's axis.

    ``lattice`` is in the bore frame. float32, mm, > 0 in air; int32, 0 for no cell. Raises :class:`EndoctError` for
    bone whose cells are planted.
    """
    if sample.bore.volume is not None:
        return _of_volume(sample.bore.volume, lattice, reach_mm)
    return air_on(sample, lattice)


def world_of(sample: Sample) -> Coordinates:
    """Return the transform (4, 4) from the bore frame to the patient's, LPS."""
    if sample.bore.volume is not None:
        return bore_to_lps(sample.bore.volume)
    if sample.bore.network is None:
        raise EndoctError("this bone is of no patient", found=sample.bore.bone, expected="bone in three dimensions")
    return axes_at(np.array(sample.bore.network.entry_mm), np.array(sample.bore.network.inward))


def _of_volume(volume: Volume, lattice: Lattice, reach_mm: float) -> tuple[Image, NDArray[np.int32]]:
    bone, places = bone_around(volume, reach_mm), lattice.moved(bore_to_lps(volume))
    near = bone_around(volume, REACH_MM)  # cells have no number beyond what the recordings can reach
    return resampled(bone.distance_mm, bone.lattice, places, 3), resampled(near.cell, near.lattice, places, 0)


def _filled(
    sample: Sample, lattice: Lattice, step_mm: float, clearance: Image, cell: NDArray[np.int32], detail_mm: float
) -> Field:
    """Return the field of these nodes, with dust and fluid in the shares that the sample gives."""
    n = int(cell.max(initial=0))
    rng = generator(sample.bore_seed, Stage.WALL, FILLINGS_STREAM)
    down = rng.normal(size=3)
    down /= np.linalg.norm(down)
    filled, height = rng.random((2, n))
    dust, fluid = np.full(n + 1, math.inf, np.float32), np.full(n + 1, math.inf, np.float32)
    if n and sample.bore.dust + sample.bore.fluid > 0:
        some = slice(None, None, FILLED_EVERY)
        in_air = clearance[some, some, some] > 0
        x, y, z = (one[some, some, some][in_air] for one in lattice.places())
        depth, of, numbers = (
            x * down[0] + y * down[1] + z * down[2],
            cell[some, some, some][in_air],
            np.arange(1, n + 1),
        )
        top, floor = ndimage.minimum(depth, of, numbers), ndimage.maximum(depth, of, numbers)
        surface = np.asarray(floor - (0.1 + 0.6 * height) * (floor - top))
        dust[1:] = np.where(filled < sample.bore.dust, surface, math.inf)
        wet = (filled >= sample.bore.dust) & (filled < sample.bore.dust + sample.bore.fluid)
        fluid[1:] = np.where(wet, surface, math.inf)
    return Field(
        clearance_mm=clearance,
        cell=cell,
        origin_mm=lattice.origin_mm,
        step_mm=step_mm,
        down=down,
        level_mm=fluid,
        dust_mm=dust,
        detail=_detail(sample, detail_mm),
        detail_step_mm=DETAIL_STEP_MM,
    )


def _detail(sample: Sample, rms_mm: float) -> Image:
    if rms_mm == 0:
        return np.zeros((0, 0, 0), np.float32)
    rng = generator(sample.bore_seed, Stage.WALL, DETAIL_STREAM)
    noise = rng.standard_normal((DETAIL_NODES,) * 3, dtype=np.float32)
    noise = ndimage.gaussian_filter(noise, DETAIL_SIGMA_NODES, mode="wrap")
    return np.asarray(noise * (rms_mm / noise.std()), dtype=np.float32)


def _bone_share(sample: Sample, field: Field) -> float:
    """Return the share of the bore's wall that is bone."""
    theta = np.linspace(0, 2 * np.pi, WALL_PLACES, endpoint=False)
    z = np.arange(0, sample.bore.length_mm, 0.1)
    radius = sample.bore.diameter_mm / 2
    x, y, z = (
        np.broadcast_to(one, (z.size, theta.size)).ravel().astype(np.float32)
        for one in (radius * np.cos(theta), radius * np.sin(theta), z[:, None])
    )
    return float(np.mean(field.air_mm(x, y, z) <= 0))
