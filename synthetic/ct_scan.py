"""The CT of three-dimensional bone: its scan, its labels, and the true and the planned line of the bore.

A scan has partial volume, blur, noise and Hounsfield units; it is written as NIfTI, with its labels. The true line
of a bore, and the plan that a surgeon would have had, are markups of 3D Slicer.
"""

import gzip
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from endoct.base.arrays import Coordinates, Image
from endoct.modalities.ct.nifti import OUR_LABELS, nifti_header
from endoct.modalities.ct.trajectory import Trajectory, as_point, write_line
from endoct.synthetic.bone.anatomy import ANTRUM, COCHLEA, sinus_and_antrum, structures, target_mm
from endoct.synthetic.bone.density import density_of
from endoct.synthetic.bone.field import air_in_bone, world_of
from endoct.synthetic.bone.lattice import Lattice
from endoct.synthetic.elementary import Numbers
from endoct.synthetic.sample.parameters import Ct, Sample
from endoct.synthetic.sample.randomness import Stage, generator

AIR_HU, TISSUE_HU, FLUID_HU, CAPSULE_HU = -1000.0, 40.0, 15.0, 600.0
"""Air; soft tissue and nerves; the cochlea's fluid; what the otic capsule has more than other bone."""
CAPSULE_MM = 1.0
ASIDE_MM, BEYOND_MM = 9.0, 9.0
"""The picture shows this much bone around the bore, and at either end."""
FINER = 2
"""A voxel is worked out from at least so many places along each axis."""
NOISE_SIGMA_VOXELS = 0.6
SLAB = 24
"""Number of slices worked on at a time."""
FWHM = 2.3548
"""Full width at half maximum of a Gaussian, over its σ."""
NOISE_STREAM = 110
"""Which of the wall's generators draws the noise before drilling; the next one draws it after."""
BONE, OUTSIDE_Z_MM = 1, 0.0
LPS_TO_RAS = np.diag([-1.0, -1.0, 1.0, 1.0])
LEVEL = 4
"""Files are compressed at this level: more takes long and gains little on noise."""
PLAN_STREAM = 8
"""Which of the bore's generators draws the plan."""
MOST_OFF_MM, MOST_OFF_RAD = 1.0, math.radians(2.0)


@dataclass(frozen=True, eq=False)
class Scan:
    """Voxels (k, j, i) of a CT.

    ``lattice``: where they lie, LPS. ``hu`` int16; ``label`` uint8: 0 air, 1 bone, 2 facial nerve, 3 chorda tympani,
    4 cochlea, 5 sigmoid sinus, 6 antrum, at the middle of each voxel; ``cell`` int32: the cell there, as in the
    recordings, 0 for none.
    """

    lattice: Lattice
    hu: NDArray[np.int16]
    label: NDArray[np.uint8]
    cell: NDArray[np.int32]


def scan(sample: Sample, ct: Ct, *, drilled: bool) -> Scan:
    """Return the CT of the bone of ``sample``, before drilling or with the bore in it."""
    to_world = world_of(sample)
    lattice = field_of_view(sample, ct, to_world)
    to_bore = np.asarray(np.linalg.inv(to_world), np.float64)
    hu = np.empty(lattice.shape, np.float32)
    label, cell = np.empty(lattice.shape, np.uint8), np.empty(lattice.shape, np.int32)
    for first in range(0, lattice.shape[0], SLAB):
        rows = slice(first, min(first + SLAB, lattice.shape[0]))
        part = lattice.part((rows, slice(0, lattice.shape[1]), slice(0, lattice.shape[2])))
        middle = part.moved(to_bore)
        clearance, of = air_in_bone(sample, middle, ASIDE_MM + BEYOND_MM)
        label[rows], cell[rows] = _labels(sample, middle, clearance), np.where(clearance > 0, of, 0)
        hu[rows] = _sharp(sample, ct, part, to_bore, drilled=drilled)
    rng = generator(sample.seed, Stage.WALL, NOISE_STREAM + int(drilled))
    noise = ndimage.gaussian_filter(rng.standard_normal(lattice.shape, dtype=np.float32), NOISE_SIGMA_VOXELS)
    hu += np.float32(ct.noise_hu) * noise / noise.std()
    return Scan(lattice, np.clip(np.rint(hu), -1024, 3071).astype(np.int16), label, cell)


def field_of_view(sample: Sample, ct: Ct, to_world: Coordinates) -> Lattice:
    """Return the voxels of a picture along the patient's axes that holds the bore and what is around it.

    ``to_world`` (4, 4): the transform from the bore frame to the patient's, LPS.
    """
    ends = to_world[:3, 3] + np.array([[0.0], [sample.bore.length_mm]]) * to_world[:3, 2]
    low, high = ends.min(axis=0) - max(ASIDE_MM, BEYOND_MM), ends.max(axis=0) + max(ASIDE_MM, BEYOND_MM)
    steps = np.array([ct.slice_mm or ct.voxel_mm, ct.voxel_mm, ct.voxel_mm])
    n = np.ceil((high - low)[::-1] / steps).astype(int)
    return Lattice(low, np.diag(steps)[:, ::-1], (int(n[0]), int(n[1]), int(n[2])))


def _sharp(sample: Sample, ct: Ct, part: Lattice, to_bore: Coordinates, *, drilled: bool) -> Image:
    """Return Hounsfield units of the voxels of ``part`` without noise: of finer places, blurred, and their mean."""
    n_k = max(FINER, int(np.rint(FINER * part.spacing_mm[0] / ct.voxel_mm)))
    each = np.array([n_k, FINER, FINER])
    steps = part.steps_mm / each[:, None]
    sigma = ct.psf_mm / FWHM / np.linalg.norm(steps, axis=1)
    margin = (-(-np.ceil(3 * sigma) // each) * each).astype(int)
    first = part.origin_mm - (0.5 * part.steps_mm.sum(axis=0) - 0.5 * steps.sum(axis=0)) - margin @ steps
    shape = tuple(int(n) for n in np.array(part.shape) * each + 2 * margin)
    fine = Lattice(first, steps, (shape[0], shape[1], shape[2])).moved(to_bore)
    hu = _tissues(sample, ct, fine, drilled=drilled)
    hu = ndimage.gaussian_filter(hu, sigma, truncate=3.0, mode="nearest")
    k, j, i = (slice(m, n - m) for m, n in zip(margin, shape, strict=True))
    blocks = hu[k, j, i].reshape(part.shape[0], n_k, part.shape[1], FINER, part.shape[2], FINER)
    return np.asarray(blocks.mean(axis=(1, 3, 5)), dtype=np.float32)


def _tissues(sample: Sample, ct: Ct, places: Lattice, *, drilled: bool) -> Image:
    """Return Hounsfield units at places of the bore frame; a place that a surface runs through has a share of both."""
    clearance, _ = air_in_bone(sample, places, ASIDE_MM + BEYOND_MM)
    step = float(places.spacing_mm.mean())
    x, y, z = places.places()
    bone = np.full(places.shape, ct.bone_hu, np.float32)
    if density := density_of(sample):
        # what bone has more than soft tissue is its mineral; a channel holds soft tissue
        bone = np.float32(TISSUE_HU) + np.float32(ct.bone_hu - TISSUE_HU) * density.on(places)
    for structure in (*structures(sample.bore), *sinus_and_antrum(sample.bore)):
        if structure.label == ANTRUM:
            continue
        box = structure.box(places, CAPSULE_MM + step)
        away = structure.distance_mm(x[box], y[box], z[box])
        if structure.label == COCHLEA:
            bone[box] += np.float32(CAPSULE_HU) * _share(CAPSULE_MM - away, step)
        inside = _share(-away, step)
        bone[box] += inside * (np.float32(FLUID_HU if structure.label == COCHLEA else TISSUE_HU) - bone[box])
    hu = bone + _share(clearance, step) * (np.float32(AIR_HU) - bone)
    if sample.bore.network is not None:
        hu += _share(OUTSIDE_Z_MM - z, step) * (np.float32(TISSUE_HU) - hu)
    if drilled:
        within = np.minimum(
            np.minimum(z, np.float32(sample.bore.length_mm) - z), sample.bore.diameter_mm / 2 - np.hypot(x, y)
        )
        hu += _share(within, step) * (np.float32(AIR_HU) - hu)
    return hu


def _share(inside_mm: Numbers, step_mm: float) -> Image:
    """Return which part of a place of that size lies inside a plane surface that is ``inside_mm`` away."""
    share = np.asarray(inside_mm, np.float32) / np.float32(step_mm) + np.float32(0.5)
    return np.asarray(np.clip(share, 0, 1), dtype=np.float32)


def _labels(sample: Sample, places: Lattice, clearance: Image) -> NDArray[np.uint8]:
    label = np.where(clearance > 0, 0, BONE).astype(np.uint8)
    x, y, z = places.places()
    if sample.bore.network is not None:
        label[z < OUTSIDE_Z_MM] = 0
    for structure in (*sinus_and_antrum(sample.bore), *structures(sample.bore)):
        box = structure.box(places)
        inside = structure.distance_mm(x[box], y[box], z[box]) < 0
        if structure.label == ANTRUM:
            inside &= clearance[box] > 0
        label[box][inside] = structure.label
    return label


def write_ct(folder: Path, sample: Sample) -> None:
    """Write what the sample has of ``ct.nii.gz`` with ``_labels`` and ``_cells``, and of ``cone_beam.nii.gz``."""
    if sample.ct is not None:
        before = scan(sample, sample.ct, drilled=False)
        _write(folder / "ct.nii.gz", before.hu, before.lattice, "HU before drilling")
        _write(folder / "ct_labels.nii.gz", before.label, before.lattice, OUR_LABELS)
        _write(folder / "ct_cells.nii.gz", before.cell, before.lattice, "cell_id as in wall.zarr")
    if sample.cone_beam is not None:
        after = scan(sample, sample.cone_beam, drilled=True)
        _write(folder / "cone_beam.nii.gz", after.hu, after.lattice, "HU after drilling")


def _write(path: Path, voxels: NDArray[np.generic], lattice: Lattice, text: str) -> None:
    to_lps = np.eye(4)
    to_lps[:3, :3], to_lps[:3, 3] = lattice.steps_mm[::-1].T, lattice.origin_mm
    k, j, i = lattice.shape
    with path.open("wb") as file, gzip.GzipFile("", "wb", LEVEL, file, mtime=0) as stream:
        stream.write(nifti_header((i, j, k), voxels.dtype, LPS_TO_RAS @ to_lps, "patient, RAS", text))
        for slice_ in voxels:
            stream.write(slice_.astype(slice_.dtype.newbyteorder("<"), copy=False).tobytes())


def write_lines(folder: Path, sample: Sample) -> None:
    """Write the true line to ``truth/bore.mrk.json`` of a specimen's ``folder``, and its plan to ``plan.mrk.json``."""
    write_line(true_line(sample), "true bore", folder / "truth" / "bore.mrk.json")
    write_line(drawn_plan(sample), "plan", folder / "plan.mrk.json")


def true_line(sample: Sample) -> Trajectory:
    """Return the line from the mouth of the bore to what the drill aims at, LPS."""
    to_lps = world_of(sample)
    return Trajectory(as_point(to_lps[:3, 3]), as_point(to_lps[:3, :3] @ target_mm(sample.bore) + to_lps[:3, 3]))


def drawn_plan(sample: Sample) -> Trajectory:
    """Return a line as long as the true one: its entry up to 1 mm off, anywhere in a ball, tilted by up to 2°.

    It depends on the bore's seed alone, so that all recordings of one bore have one plan.
    """
    rng, line = generator(sample.bore_seed, Stage.BORE, PLAN_STREAM), true_line(sample)
    off = rng.normal(size=3)
    off *= MOST_OFF_MM * rng.random() ** (1 / 3) / np.linalg.norm(off)
    tilt, towards = MOST_OFF_RAD * math.sqrt(rng.random()), rng.uniform(0, 2 * math.pi)
    aside = math.sin(tilt)
    inward = np.array([aside * math.cos(towards), aside * math.sin(towards), math.cos(tilt)])
    axes = line.to_lps
    entry = axes[:3, :3] @ off + axes[:3, 3]
    return Trajectory(as_point(entry), as_point(entry + line.length_mm * (axes[:3, :3] @ inward)))
