"""Planes that cut a bore: those found in real drilled holes beside the eye of a person, and those that are not there.

    python -m benchmarks.planes images TELEVIEWER_FOLDER
    python -m benchmarks.planes bores PAIRS

``images``: two optical images, in which a person wrote down the planes before anything was found; what was found in
them as they are, in a copy, with their columns shuffled, and with each column shifted along the hole. ``bores``: in
what endoscopes saw of bores in bone (pickled pairs of panoramas), where there is none, as they are and shuffled.
"""

import argparse
import pickle
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Picture

from endoct.fusion.evidence.side import Side
from endoct.fusion.result import CuttingPlane
from endoct.fusion.scoring.overlap import jaccard
from endoct.fusion.segmentation.parameters import SegmentParameters
from endoct.fusion.segmentation.planes import find_planes
from endoct.fusion.segmentation.side_cells import segment_side
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama

RADIUS_MM, LENGTH_MM, ROWS_OFF = 48.0, 3000.0, 12
# the row and the column of a plane's highest and of its lowest place, by eye; a few whole turns, then cut ones
BY_EYE = {
    "optical": (
        [
            (-1, 60, 63, 250), (138, 40, 194, 222), (166, 62, 260, 235), (193, 50, 268, 245), (245, 50, 307, 220),
            (333, 55, 407, 240), (361, 50, 431, 230), (391, 50, 500, 225), (463, 55, 532, 222), (519, 55, 636, 215),
            (573, 53, 675, 225), (602, 58, 700, 225), (714, 45, 795, 200), (790, 70, 829, 250), (831, 50, 935, 225),
            (869, 62, 942, 232), (950, 40, 1064, 190), (1003, 58, 1110, 232), (1066, 45, 1163, 232),
            (1146, 55, 1211, 253), (1237, 40, 1288, 240), (1243, 35, 1388, 195),
        ],
        [
            (-3, 286, 43, 106), (193, 50, 294, 218), (224, 50, 300, 235), (391, 50, 479, 225), (380, 25, 454, 220),
            (485, 285, 536, 105), (485, 40, 577, 220), (519, 55, 646, 216), (734, 45, 797, 220), (763, 60, 840, 240),
            (1278, 85, 1341, 262), (1345, 30, 1490, 210), (1415, 45, 1470, 225),
        ],
    ),
    "optical-folded": (
        [(778, 318, 940, 150), (807, 325, 1002, 149), (834, 321, 1034, 146)],
        [
            (869, 325, 1080, 150), (893, 325, 1105, 150), (913, 325, 1125, 150), (931, 325, 1140, 150),
            (944, 325, 1155, 150),
        ],
    ),
}  # fmt: skip


def side_of(image: NDArray[np.float32], dz_mm: float, radius_mm: float) -> Side:
    """Return an image, NaN where nothing was observed, as a side as wide as a bore in bone."""
    grid, valid = SurfaceGrid.full_circle(*image.shape, z0_mm=0.0, dz_mm=dz_mm, radius_mm=radius_mm), np.isfinite(image)
    panorama = Panorama(grid, np.nan_to_num(image), None, valid, valid.astype(np.float32), "image", True, True)
    return Side("image", panorama).in_reference


def shuffled(image: NDArray[np.float32], rng: np.random.Generator) -> Iterator[NDArray[np.float32]]:
    """Yield an image with its columns in another order, and with each shifted along the hole."""
    yield image[:, rng.permutation(image.shape[1])]
    yield np.stack([np.roll(column, rng.integers(column.size)) for column in image.T], axis=1)


def matched(
    planes: list[CuttingPlane], by_eye: list[tuple[int, ...]], dz_mm: float, free: set[int]
) -> list[int | None]:
    """Return which ``free`` plane is each one by eye, at most ``ROWS_OFF`` off in the root mean square, and take it."""
    theta = np.radians(np.arange(0, 360, 5))
    answers: list[int | None] = []
    for top, _, bottom, column in by_eye:
        rows = (top + bottom) / 2 + (bottom - top) / 2 * np.cos(theta - np.radians(column))
        off = {k: float(np.sqrt(np.mean((planes[k].z_at(theta) / dz_mm - rows) ** 2))) for k in free}
        best = min(off, key=lambda k: off[k], default=None)
        answers.append(best if best is not None and off[best] <= ROWS_OFF else None)
        free.discard(-1 if answers[-1] is None else answers[-1])
    return answers


def images(folder: Path) -> None:
    """Print what was found of what a person saw."""
    rng = np.random.default_rng(0)
    for name, (whole, cut) in BY_EYE.items():
        image = np.asarray(Picture.open(folder / f"{name}.png").convert("RGB"))[..., 1].astype(np.float32)
        dz_mm = LENGTH_MM / len(image)
        side = side_of(image, dz_mm, RADIUS_MM)
        found = list(find_planes(side.contrast("dark")))
        scale_mm = dz_mm * side.grid.radius_mm / RADIUS_MM
        free = set(range(len(found)))
        answers = [matched(found, seen, scale_mm, free) for seen in (whole, cut)]
        of = [f"{sum(k is not None for k in got)} of {len(got)}" for got in answers]
        others = [found[k] for k in sorted(free)]
        print(f"{name}: {len(found)} planes; whole ones {of[0]}, cut ones {of[1]}; others {len(others)}")
        for what, seen, got in zip(("whole", "cut"), (whole, cut), answers, strict=True):
            print(f"  missed, {what}:", *(f"{one[0]}–{one[2]}" for one, k in zip(seen, got, strict=True) if k is None))
        print("  others, at row:", *(f"{plane.z_mm / scale_mm:.0f}" for plane in others))
        errors = [np.degrees([plane.dip_error_rad, plane.azimuth_error_rad]) for plane in found]
        if errors:
            print("  standard errors of dip and azimuth, median:", np.median(errors, axis=0).round(2), "°")
        in_a_copy(image, dz_mm, rng)
        for how in range(2):
            false = [find_planes(side_of(list(shuffled(image, rng))[how], dz_mm, RADIUS_MM).contrast("dark"))
                     for _ in range(5)]  # fmt: skip
            print(f"  {'shifted' if how else 'shuffled'} five times:", *map(len, false))


def in_a_copy(image: NDArray[np.float32], dz_mm: float, rng: np.random.Generator) -> None:
    """Print which planes of an image are found again once it is turned, dimmed and noisy, and how the cells agree."""
    by = 77
    noisy = 0.9 * np.roll(image, by, axis=1) + rng.normal(0, 4, image.shape).astype(np.float32)
    first, second = (segment_side(side_of(one, dz_mm, RADIUS_MM), SegmentParameters(), "dark")
                     for one in (image, np.clip(noisy, 0, None)))  # fmt: skip
    turn, pulls = 2 * np.pi * by / image.shape[1], []
    for plane in first.planes:
        for other in second.planes:
            azimuth = np.angle(np.exp(1j * (other.azimuth_rad - plane.azimuth_rad - turn)))
            off = other.z_mm - plane.z_mm, other.dip_rad - plane.dip_rad, azimuth
            if np.all(np.abs(off) < (0.1, 0.05, 0.1)):
                errors = [(one.z_error_mm, one.dip_error_rad, one.azimuth_error_rad) for one in (plane, other)]
                pulls.append(np.abs(off) / np.hypot(*errors))
    print(f"  a copy has {len(second.planes)}, of which {len(pulls)} are the same; apart, in standard errors:", end=" ")
    print(*(f"{value:.1f}" for value in np.quantile(pulls, (0.5, 1))) if pulls else "")
    again = np.roll(second.mask, -by, axis=1)
    print(f"  Jaccard index of the cells {jaccard(first.mask, again, np.ones(again.shape, np.bool_)):.2f}")


def bores(folder: Path) -> None:
    """Print how many planes were found in bores that have none."""
    rng, counts = np.random.default_rng(0), {}
    for path in sorted(folder.glob("*.pkl")):
        seen: Panorama = pickle.loads(path.read_bytes())["a"]
        rows = counts.setdefault(path.name.split("-")[0], [])
        image = np.where(seen.valid, seen.intensity, np.float32(np.nan))
        others = [side_of(other, seen.grid.dz_mm, seen.grid.radius_mm) for other in shuffled(image, rng)]
        planes = [find_planes(side.contrast("dark")) for side in (Side("light", seen), *others)]
        length_mm = float(np.ptp(seen.z_mm))
        rows.append((length_mm, *map(len, planes)))
    for name, rows in counts.items():
        length_mm, *false = np.sum(rows, axis=0)
        print(f"{name}: {len(rows)} bores, {length_mm:.0f} mm; as they are, shuffled, shifted:", *map(int, false))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("of", choices=("images", "bores"))
    parser.add_argument("folder", type=Path)
    asked = parser.parse_args()
    (images if asked.of == "images" else bores)(asked.folder)
