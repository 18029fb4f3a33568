"""Labels of the endoscope's frames: where every pixel looks, what it sees there, and the A-scan that saw the same."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from endoct.stitching.arrays import Image
from endoct.stitching.parallel import thread_map
from endoct.stitching.zarr_store import consolidate
from endoct.synthetic.endoscope.camera import PixelMaps, noise_free, pixel_maps
from endoct.synthetic.endoscope.png import write_png
from endoct.synthetic.labels.arrays import create
from endoct.synthetic.labels.correspondence import ascans_of_places, cartesian_mm, nearest_places
from endoct.synthetic.labels.pullback import Pullback
from endoct.synthetic.model import Model
from endoct.synthetic.progress import Advance

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


def write_endoscope_labels(
    folder: Path, model: Model, pullback: Pullback, advance: Advance, workers: int
) -> tuple[NDArray[np.int32], NDArray[np.intp]]:
    """Write ``endoscope.zarr`` and the noise-free twins ``endoscope_clean/frame_0000.png`` ….

    Return for every A-scan frame, row and column of the pixel that sees the same place, int32 (3, slice, A-scan), −1
    for none; and how many pixels see each cell, (n_cells + 1,).
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
        write_png(twins / f"frame_{i:04d}.png", twin)
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
