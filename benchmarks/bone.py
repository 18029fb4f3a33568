"""What bone is like: air, surface, chords, cells, and what is closed, of a simulated network or of a real volume.

    python benchmarks/bone.py --seeds 2000-2019
    python benchmarks/bone.py --seeds 2000-2019 --voxel 0.192
    python benchmarks/bone.py --volume RT147_256.nrrd --bores 20

The same estimators for both, in a box of 8 × 8 mm about a bore 14 mm long, at 0.1 mm. Real bores are drawn at random
where there is bone and air cells: 8–45 % of the wall missing, no place of it more than 1.6 mm from bone, only label 1.
"""

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.measure import marching_cubes, mesh_surface_area

from endoct.modalities.ct.ct_volume import LABEL_SIGMA_VOXELS, read_ct
from endoct.modalities.ct.trajectory import axes_at
from endoct.synthetic.bone.lattice import Lattice, resampled
from endoct.synthetic.bone.network import air_on
from endoct.synthetic.bone.patient import CHAMBER_MM, chambers, signed_distance
from endoct.synthetic.draw import draw
from endoct.synthetic.sample.parameters import Sample
from endoct.workbench.settings import parse_vary

STEP_MM, HALF_MM, LENGTH_MM, RADIUS_MM = 0.1, 4.0, 14.0, 1.25
BEHIND_MM = 1.0
NAMES = (
    "air", "wall missing", "surface/volume mm⁻¹", "air chord mm", "bone chord mm", "cell mm (median)", "cell mm (90 %)",
    "closed behind wall",
)  # fmt: skip


def lattice() -> Lattice:
    """Return the places looked at, in the bore frame."""
    return Lattice.around_bore(LENGTH_MM, HALF_MM, STEP_MM)


def figures(distance: NDArray[np.float32], places: Lattice) -> list[float]:
    """Return what ``NAMES`` say of air given by its distance to bone (z, y, x)."""
    air = distance > 0
    vertices, faces, _, _ = marching_cubes(distance, 0.0, spacing=(STEP_MM,) * 3)
    surface = float(mesh_surface_area(vertices, faces))
    volume = float(air.sum()) * STEP_MM**3
    cell = chambers(distance, places.spacing_mm, CHAMBER_MM)
    x, y, _ = places.places()
    radius = np.hypot(x, y)
    opened = np.unique(cell[(radius < RADIUS_MM) & air])
    behind = air & (radius > RADIUS_MM) & (radius < RADIUS_MM + BEHIND_MM)
    within = air & (radius < HALF_MM)
    inside = np.unique(cell[within])
    size = np.bincount(cell[air])[inside] * STEP_MM**3
    across = (6 * size[size > 0.01] / np.pi) ** (1 / 3)
    by_volume = np.sort(across)
    half, most = np.interp([0.5, 0.9], np.cumsum(by_volume**3) / np.sum(by_volume**3), by_volume)
    ring = np.abs(radius - RADIUS_MM) < STEP_MM / 2
    return [
        float(air.mean()),
        float(air[ring].mean()),
        surface / volume,
        chord(air),
        chord(~air),
        float(half),
        float(most),
        float(1 - np.isin(cell[behind], opened).mean()),
    ]


def chord(inside: NDArray[np.bool_]) -> float:
    """Return the mean chord along the three axes, of chords that the box does not cut, mm."""
    lengths: list[NDArray[np.intp]] = []
    for axis in range(3):
        lines = np.moveaxis(inside, axis, -1).reshape(-1, inside.shape[axis]).astype(np.int8)
        row, place = np.nonzero(np.diff(lines, axis=1))
        begins = lines[row, place + 1] == 1
        whole = begins[:-1] & (row[1:] == row[:-1])  # what begins in a line ends where the next change is
        lengths.append((place[1:] - place[:-1])[whole])
    every = np.concatenate(lengths)
    return STEP_MM * float(every.mean()) if every.size else float("nan")


def segmented(sample: Sample, voxel_mm: float) -> NDArray[np.float32]:
    """Return the air of a network as a segmentation on voxels of that size would have it."""
    voxels = Lattice.around_bore(LENGTH_MM, HALF_MM + 2 * voxel_mm, voxel_mm)
    distance = _of_segmentation(air_on(sample, voxels)[0] <= 0, voxels)
    return resampled(distance, voxels, lattice(), order=3)


def _of_segmentation(bone: NDArray[np.bool_], voxels: Lattice) -> NDArray[np.float32]:
    blurred = ndimage.gaussian_filter(bone.astype(np.float32), LABEL_SIGMA_VOXELS)
    return signed_distance(np.asarray(0.5 - blurred, np.float32), voxels.spacing_mm)


def real_bores(path: Path, count: int) -> list[tuple[NDArray[np.float32], Lattice]]:
    """Return the air around bores drawn at random in a segmentation."""
    ct = read_ct(path, "lps")
    k, j, i = ct.voxels.shape
    whole = Lattice(ct.origin_mm, ct.steps_mm, (k, j, i))
    distance = _of_segmentation(ct.voxels > 0, whole)
    other = (ct.voxels > 1).astype(np.float32)
    rng, places, bores = np.random.default_rng(0), lattice(), []
    x, y, _ = places.places()
    ring = np.abs(np.hypot(x, y) - RADIUS_MM) < STEP_MM / 2
    coarse = np.argwhere(ring)[::61].astype(np.float64)
    for _ in range(200_000):
        if len(bores) == count:
            break
        axis = rng.normal(size=3)
        middle = whole.at(rng.uniform(20, np.array(whole.shape) - 20))
        axis /= np.linalg.norm(axis)
        frame = axes_at(middle - LENGTH_MM / 2 * axis, axis)
        at = whole.index_of(places.at(coarse) @ frame[:3, :3].T + frame[:3, 3])
        if np.any(at < 10) or np.any(at > np.array(whole.shape) - 10):
            continue
        here = tuple(np.rint(at).astype(int).T)
        of_wall = distance[here]
        if of_wall.max() > 1.6 or other[here].mean() > 0.02 or not 0.08 <= (of_wall > 0).mean() <= 0.45:
            continue
        bores.append((resampled(distance, whole, places.moved(frame), order=3), places))
    return bores


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", default="2000-2019")
    parser.add_argument("--volume", type=Path)
    parser.add_argument("--bores", type=int, default=20)
    parser.add_argument("--voxel", type=float, default=0.0, help="mm; default: the network itself")
    parser.add_argument("--vary", action="append", default=[])
    arguments = parser.parse_args()
    if arguments.volume:
        rows = [figures(*bore) for bore in real_bores(arguments.volume, arguments.bores)]
    else:
        first, last = (int(text) for text in arguments.seeds.split("-"))
        ranges = parse_vary(arguments.vary)
        samples = [draw("mastoid", seed, ranges=ranges) for seed in range(first, last + 1)]
        voxel = arguments.voxel
        air = (segmented(sample, voxel) if voxel else air_on(sample, lattice())[0] for sample in samples)
        rows = [figures(one, lattice()) for one in air]
    table = np.array(rows)
    print(f"{len(rows)} bores" + " " * 14 + "5 %  median    95 %    mean")
    for name, values in zip(NAMES, table.T, strict=True):
        low, middle, high = np.nanpercentile(values, [5, 50, 95])
        print(f"{name:22}{low:7.2f}{middle:8.2f}{high:8.2f}{np.nanmean(values):8.2f}")


if __name__ == "__main__":
    main()
