"""All labels of a specimen as they are written: of the endoscope's pixels, and what either instrument sees of a cell.

Which A-scan saw what a pixel saw, and the other way round, leads through the wall. A pixel's place on it is looked
up among the places where beams end, and a beam's end among the places where pixels end. So what one of them cannot
see has no counterpart.
"""

import csv
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from endoct.base.arrays import Coordinates, Image
from endoct.base.compute.parallel import Advance, thread_map
from endoct.base.numeric.circle import mean_angle_rad
from endoct.base.zarr.zarr_store import consolidate
from endoct.synthetic.endoscope.camera import PixelMaps, noise_free, pixel_maps, png
from endoct.synthetic.labels.pullback_labels import Pullback, create, look_along, write_oct_labels
from endoct.synthetic.model import Model
from endoct.synthetic.sample.presets import PRESETS

SAME_PLACE_MM = 0.05
"""A pixel covers up to 0.02 mm of the wall; farther away lies something else, as the floor next to a lip."""
PIXEL = ("frame", "row", "column")
MAPS = {
    "z_mm": (PIXEL, "f4", "where the pixel ends on the wall: z, mm from the mouth; NaN outside the annulus"),
    "theta_rad": (PIXEL, "f4", "and θ in the bore frame, rad"),
    "depth_mm": (PIXEL, "f4", "and depth below the nominal wall, mm"),
    "cell_id": (PIXEL, "i4", "1 + index of the cell in sample.json, 0 on the bore's own wall and outside the annulus"),
    "obscured": (PIXEL, "b1", "dirt, a droplet or a crumb lies over it"),
    "valid": (PIXEL, "b1", "the pixel sees the wall"),
    "oct_slice": (PIXEL, "f4", "slice that looks at the same place, in the order recorded, fractional; NaN for none"),
    "oct_ascan": (PIXEL, "f4", "A-scan of that slice, fractional"),
}
COLUMNS = (
    "cell_id", "z_mm", "theta_rad", "opening_mm2", "depth_mm", "filling", "oct_ascans", "oct_covered",
    "endoscope_pixels", "endoscope_covered",
)  # fmt: skip


def ascans_of_places(pullback: Pullback, z_mm: Coordinates, theta_rad: Coordinates) -> tuple[Image, Image]:
    """Return (slice, A-scan), fractional, float32 (n,), that look at places of the wall (n,); NaN beyond the pullback.

    Between two slices the slice is interpolated; before the first and after the last half a pitch counts.
    """
    n_slices, n_ascans = pullback.z_mm.shape
    middle = pullback.z_mm.mean(axis=1, dtype=np.float64)
    order = np.argsort(middle)
    pitch_mm = np.gradient(middle) if n_slices > 1 else np.ones(1)
    nearest = order[np.searchsorted((middle[order][1:] + middle[order][:-1]) / 2, z_mm)]
    slice_, ascan = np.empty(z_mm.size), np.empty(z_mm.size)
    for i in map(int, np.unique(nearest)):
        mine = np.flatnonzero(nearest == i)
        around = np.argsort(pullback.theta_rad[i], kind="stable")
        theta = pullback.theta_rad[i, around].astype(np.float64)
        # as a point on a circle, for between the turn's end and its start the number jumps
        turns = np.interp(theta_rad[mine], theta, np.exp(2j * np.pi * around / n_ascans), period=2 * np.pi)
        ascan[mine] = np.mod(np.angle(turns) / (2 * np.pi), 1) * n_ascans
        k = np.minimum(ascan[mine].astype(np.intp), n_ascans - 1)
        slice_[mine] = i + (z_mm[mine] - pullback.z_mm[i, k]) / pitch_mm[i]
    beyond = (slice_ < -0.5) | (slice_ > n_slices - 0.5)
    slice_[beyond] = ascan[beyond] = np.nan
    return slice_.astype(np.float32), ascan.astype(np.float32)


def nearest_places(places_mm: Coordinates, wanted_mm: Coordinates) -> NDArray[np.intp]:
    """Return for each wanted place, float64 (m, 3), the index of the same among ``places_mm`` (n, 3), −1 for none."""
    if not len(places_mm):
        return np.full(len(wanted_mm), -1, np.intp)
    distance, index = cKDTree(places_mm).query(np.nan_to_num(wanted_mm, nan=1e6), distance_upper_bound=SAME_PLACE_MM)
    return np.where(np.isfinite(distance), index, -1)


def cartesian_mm(z_mm: Image, theta_rad: Image, radius_mm: Image) -> Coordinates:
    """Return places of the wall, arrays of one shape, as float64 (…, 3): x, y, z in the bore frame."""
    radius = radius_mm.astype(np.float64)
    return np.stack([radius * np.cos(theta_rad), radius * np.sin(theta_rad), z_mm], axis=-1).astype(np.float64)


def write_endoscope_labels(
    folder: Path, model: Model, pullback: Pullback, advance: Advance, workers: int
) -> tuple[NDArray[np.int32], NDArray[np.intp]]:
    """Write ``endoscope.zarr`` and the noise-free twins ``endoscope_clean/frame_0000.png`` ….

    Return for every A-scan frame, row and column of the pixel that sees the same place, int32 (3, slice, A-scan), −1
    for none. The second value is how many pixels see each cell, (n_cells + 1,).
    """
    sample, wall, camera = model.sample, model.wall, model.sample.endoscope
    n_frames = len(camera.z_mm)
    sizes = {"frame": n_frames, "row": camera.height_px, "column": camera.width_px}
    arrays = create(folder / "endoscope.zarr", sizes, MAPS, {})
    twins = folder / "endoscope_clean"
    twins.mkdir()
    pixels = np.full((3, *pullback.z_mm.shape), -1, np.int32)
    per_cell = np.zeros(wall.scene.contents.lining.size, np.intp)
    squarest = _squarest_frame(np.asarray(camera.z_mm), camera.visible_length_mm, pullback.z_mm)

    def look(i: int) -> tuple[PixelMaps, Image, Image, NDArray[np.uint8]]:
        view = pixel_maps(sample, wall, i)
        slice_, ascan = (np.full(view.valid.shape, np.nan, np.float32) for _ in range(2))
        z_mm, theta_rad = (values[view.valid].astype(np.float64) for values in (view.z_mm, view.theta_rad))
        slice_[view.valid], ascan[view.valid] = ascans_of_places(pullback, z_mm, theta_rad)
        mine = squarest == i
        places = cartesian_mm(pullback.z_mm[mine], pullback.theta_rad[mine], pullback.radius_mm[mine])
        row, column = np.nonzero(view.valid)
        radius_mm = wall.radius_mm + view.depth_mm[view.valid]
        same = nearest_places(cartesian_mm(view.z_mm[view.valid], view.theta_rad[view.valid], radius_mm), places)
        pixels[:, mine] = np.where(same >= 0, np.stack([np.full(same.size, i), row[same], column[same]]), -1)
        return view, slice_, ascan, noise_free(sample, wall, model.lighting, i)

    for i, (view, slice_, ascan, twin) in enumerate(thread_map(look, range(n_frames), workers)):
        values = {
            "z_mm": view.z_mm, "theta_rad": view.theta_rad, "depth_mm": view.depth_mm, "cell_id": view.cell,
            "obscured": view.obscured, "valid": view.valid, "oct_slice": slice_, "oct_ascan": ascan,
        }  # fmt: skip
        for name, value in values.items():
            arrays[name][i] = value
        (twins / f"frame_{i:04d}.png").write_bytes(png(twin))
        per_cell += np.bincount(view.cell[view.valid & ~view.obscured], minlength=per_cell.size)
        advance((i + 1) / n_frames)
    consolidate(folder / "endoscope.zarr")
    return pixels, per_cell


def _squarest_frame(frame_z_mm: NDArray[np.float64], visible_mm: float, z_mm: Image) -> NDArray[np.intp]:
    """Return for every A-scan the frame whose visible band's centre is nearest, −1 where none shows its z."""
    order = np.argsort(frame_z_mm)
    between = (frame_z_mm[order][1:] + frame_z_mm[order][:-1]) / 2
    nearest = order[np.searchsorted(between, z_mm)]
    return np.where(np.abs(z_mm - frame_z_mm[nearest]) < visible_mm / 2, nearest, -1)


def write_cells(path: Path, model: Model, pullback: Pullback, pixels: NDArray[np.intp]) -> None:
    """Write one row a cell that opens into the bore.

    ``z_mm``, ``theta_rad``: centre of its opening; ``opening_mm2`` on the nominal wall; ``depth_mm``: its deepest
    place along radial rays. ``oct_ascans``, ``endoscope_pixels``: how many end in it, shadows and dirt not counted;
    0 is a cell that this recording does not show. ``oct_covered``, ``endoscope_covered``: share of its opening
    within half a pitch of a slice, and within the band that a frame shows.
    """
    sample, wall = model.sample, model.wall
    clear = pullback.shadow_db < 6
    row_limit = PRESETS[sample.preset].n_depth
    ascans = np.bincount(pullback.cell_id[clear & (pullback.surface_row < row_limit)].ravel(), minlength=pixels.size)
    z_mm = wall.dz_mm * np.arange(wall.cell_id.shape[0], dtype=np.float64)
    half_pitch, half_band = PRESETS[sample.preset].pitch_mm / 2, sample.endoscope.visible_length_mm / 2
    slice_mm = pullback.z_mm.mean(axis=1, dtype=np.float64)
    covered = (_near(z_mm, slice_mm, half_pitch), _near(z_mm, sample.endoscope.z_mm, half_band))
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(COLUMNS)
        for number in np.unique(wall.cell_id[wall.cell_id > 0]):
            row, column = np.nonzero(wall.cell_id == number)
            centre = mean_angle_rad(column * wall.dtheta_rad) % (2 * np.pi)
            opening = row.size * wall.dz_mm * wall.dtheta_rad * wall.radius_mm
            oct_covered, endoscope_covered = (float(near[row].mean()) for near in covered)
            depth = float(wall.relief_mm[row, column].max())
            numbers = (z_mm[row].mean(), centre, opening, depth)
            table.writerow(
                [number, *(f"{value:.4f}" for value in numbers), wall.scene.contents.filling[number],
                 ascans[number], f"{oct_covered:.3f}", pixels[number], f"{endoscope_covered:.3f}"]
            )  # fmt: skip


def _near(z_mm: NDArray[np.float64], places_mm: ArrayLike, reach_mm: float) -> NDArray[np.bool_]:
    return np.asarray(np.min(np.abs(z_mm[:, None] - np.asarray(places_mm)), axis=1) <= reach_mm)


def write_labels(folder: Path, model: Model, advance: Advance, workers: int) -> None:
    """Write ``oct.zarr``, ``oct_clean.tif``, ``endoscope.zarr``, ``endoscope_clean/`` and ``cells.csv``.

    The arrays say of themselves what they hold (``long_name``); cells have the ids of ``truth/wall.zarr``.
    """
    folder.mkdir()
    pullback = look_along(model, workers)
    pixels, per_cell = write_endoscope_labels(folder, model, pullback, lambda share: advance(share / 2), workers)
    write_oct_labels(folder, model, pullback, pixels, lambda share: advance((1 + share) / 2), workers)
    write_cells(folder / "cells.csv", model, pullback, per_cell)
