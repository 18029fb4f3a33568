"""All labels of a specimen as they are written, and what either instrument sees of each cell."""

import csv
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from endoct.base.compute.parallel import Advance
from endoct.base.numeric.circle import mean_angle_rad
from endoct.synthetic.labels.frame_labels import write_endoscope_labels
from endoct.synthetic.labels.pullback_labels import Pullback, look_along, write_oct_labels
from endoct.synthetic.model import Model
from endoct.synthetic.sample.presets import PRESETS

COLUMNS = (
    "cell_id", "z_mm", "theta_rad", "opening_mm2", "depth_mm", "filling", "oct_ascans", "oct_covered",
    "endoscope_pixels", "endoscope_covered",
)  # fmt: skip


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
