"""The truth holds together, and the recordings show what it says where it says.

The mappings here are written out once more, from the description in ``recording.json``.
"""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile
import xarray as xr
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates


@pytest.fixture(scope="module")
def truth(quick_specimen: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((quick_specimen / "truth/recording.json").read_text(encoding="utf-8"))
    found["sample"] = json.loads((quick_specimen / "truth/sample.json").read_text(encoding="utf-8"))
    return found


@pytest.fixture(scope="module")
def wall(quick_specimen: Path) -> xr.Dataset:
    return xr.open_zarr(quick_specimen / "truth/wall.zarr", consolidated=False).load()


def nearest(wall: xr.Dataset, name: str, z_mm: Coordinates, theta_rad: Coordinates) -> NDArray[Any]:
    row = np.clip(np.rint(z_mm / float(wall.z[1])), 0, wall.z.size - 1).astype(int)
    column = np.rint(theta_rad / float(wall.theta[1])).astype(int) % wall.theta.size
    return np.asarray(wall[name].values[row, column])


def test_cells_fill_what_they_should_and_their_ids_match_the_mask(wall: xr.Dataset, truth: dict[str, Any]) -> None:
    assert 0.08 <= float(wall.cell.mean()) <= 0.30
    assert not np.any(wall.cell & (wall.cell_id == 0))
    # an opening whose rim is rounded, or that dust fills, keeps its id
    assert float((wall.cell_id > 0).mean() - wall.cell.mean()) < 0.005
    numbers = np.unique(wall.cell_id.values[wall.cell.values])
    assert numbers.min() >= 1
    assert numbers.max() <= len(truth["sample"]["bore"]["cells"])
    depth = wall.relief_mm.values
    assert depth[wall.cell.values].mean() > 0.05
    assert np.abs(depth[~wall.cell.values]).max() < 0.15
    assert np.abs(depth[~wall.cell.values]).std() < 0.03


def test_a_cell_lies_where_its_sample_puts_it(wall: xr.Dataset, truth: dict[str, Any]) -> None:
    cells = truth["sample"]["bore"]["cells"]
    assert len(cells) > 10
    for number, cell in enumerate(cells, 1):
        centre = nearest(wall, "cell_id", np.array([cell["z_mm"]]), np.array([cell["theta_rad"]]))[0]
        assert centre > 0, f"cell {number}"


def test_bone_begins_in_the_b_scans_where_the_truth_says(
    quick_specimen: Path, wall: xr.Dataset, truth: dict[str, Any]
) -> None:
    oct_, sample = truth["oct"], truth["sample"]["oct"]
    volume = tifffile.imread(quick_specimen / "oct/pullback.tif")
    n_ascans = volume.shape[2]
    turn = 2 * np.pi * np.arange(n_ascans) / n_ascans
    contrast, observed = [], []
    for i in range(2, volume.shape[0], 6):
        error = oct_["start_angle_rad"][i] + sum(
            cos * np.cos(h * turn) + sin * np.sin(h * turn)
            for h, (cos, sin) in enumerate(
                zip(oct_["rotation_error_cos_rad"][i], oct_["rotation_error_sin_rad"][i], strict=True), 1
            )
        )
        alpha = oct_["theta_origin_rad"] + oct_["theta_sense"] * (turn + error)
        e, beta = oct_["offset_mm"][i], oct_["offset_direction_rad"][i]
        catheter = e * np.exp(1j * beta)
        rho = np.full(n_ascans, truth["bore_radius_mm"])
        for _ in range(40):  # a fixed point that converges where the wall is smooth
            hit = catheter + rho * np.exp(1j * alpha)
            relief = nearest(wall, "relief_mm", np.full(n_ascans, oct_["z_mm"][i]), np.angle(hit))
            rho = rho + 0.7 * (truth["bore_radius_mm"] + relief - np.abs(hit))
        outer = np.array([_circle(sample["capillary_outer_diameter_mm"] / 2, e, a - beta) for a in alpha])
        inner_radius = sample["capillary_outer_diameter_mm"] / 2 - oct_["glass_mm"]
        inner = np.array([_circle(inner_radius, e, a - beta) for a in alpha])
        path = rho + (oct_["glass_index"] - 1) * (outer - inner)
        row = (path - oct_["first_sample_mm"]) / sample["axial_pixel_mm"]
        bone = ~nearest(wall, "cell", np.full(n_ascans, oct_["z_mm"][i]), np.angle(hit)) & (row < 490)
        rows = np.rint(row).astype(int)[bone]
        columns = np.flatnonzero(bone)
        counts = volume[i].astype(float)
        below = np.mean([counts[rows + k, columns] for k in range(1, 9)], axis=0)
        above = np.mean([counts[rows - k, columns] for k in range(5, 13)], axis=0)
        contrast.append((below - above).mean() * sample["db_per_count"])
        # the row at which the mean over all bone, straightened by the truth, rises halfway
        profile = np.array([counts[rows + k, columns].mean() for k in range(-15, 11)])
        level = (profile[:8].mean() + profile[18:22].mean()) / 2
        observed.append(int(np.argmax(profile > level)) - 15)
    assert np.mean(contrast) > 5.0, "dB between bone and the air before it"
    assert np.abs(np.median(observed)) <= 2, "rows between where bone begins and where it should"


def _circle(radius: float, e: float, gamma: float) -> float:
    """Solve |e + ρ u| = R for ρ as a quadratic."""
    return float(max(np.roots([1.0, 2 * e * np.cos(gamma), e**2 - radius**2]).real))


def test_cells_are_dark_in_the_frames_where_the_truth_says(
    quick_specimen: Path, wall: xr.Dataset, truth: dict[str, Any]
) -> None:
    frames, optics = truth["endoscope"], truth["sample"]["endoscope"]
    a, f, d = np.deg2rad(optics["half_angle_deg"]), optics["focal_px"], optics["mirror_distance_mm"]
    radius = truth["bore_radius_mm"]
    ratios, flipped = [], []
    for i in range(0, len(frames["z_mm"]), 5):
        image = cv2.imread(str(quick_specimen / f"endoscope/frame_{i:04d}.png"), cv2.IMREAD_GRAYSCALE).astype(float)
        cx, cy = frames["centre_px"][i]
        row, column = np.mgrid[: image.shape[0], : image.shape[1]]
        r, angle = np.hypot(column - cx, row - cy), np.arctan2(row - cy, column - cx)
        seen = (r > frames["inner_px"] * 1.1) & (r < frames["outer_px"] * 0.97)
        r, angle, grey = r[seen], angle[seen], image[seen]
        # the closed form of a concentric wall
        z = -d * np.cos(2 * a) + (radius + d * np.sin(2 * a)) / np.tan(2 * a - np.arctan(r / f))
        z = z - frames["apex_to_band_centre_mm"] + frames["z_mm"][i]
        cell = nearest(wall, "cell", z, angle + frames["roll_rad"][i])
        wrong = nearest(wall, "cell", z, frames["roll_rad"][i] - angle)
        if 0.05 < cell.mean() < 0.6 and 0.05 < wrong.mean() < 0.6:
            ratios.append(grey[cell].mean() / grey[~cell].mean())
            flipped.append(grey[wrong].mean() / grey[~wrong].mean())
    assert len(ratios) >= 3
    assert np.median(ratios) < 0.75
    assert np.median(flipped) > np.median(ratios) + 0.1
