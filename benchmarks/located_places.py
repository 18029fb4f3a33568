"""How exactly plug-ins locate places of the wall in frames as recorded, against the truth of labelled specimens.

    python -m benchmarks.located_places --preset quick --seeds 1000 1001

Of every place that the labels know (an A-scan with the depth sample of the surface it meets, a pixel with the place it
looks at) the place is moved into the panorama's frame by the true pose, located again, and held against the A-scan, the
depth sample, or the pixel it came from.
"""

import argparse
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import xarray as xr

from endoct.modalities.contract import Places
from endoct.modalities.illustration import illustrated
from endoct.synthetic.specimen import simulate
from endoct.workbench.pipeline.truth import TruePose, load_truth, true_pose
from endoct.workbench.running.progress import SilentStages
from endoct.workbench.sides.recordings import Unrolled, open_recording, unroll_recording

EVERY = 7
"""Pixel, of those in a row and in a column."""


def oct_errors(specimen: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return by how many A-scans and by how many depth samples places of the wall are missed, float64 (n,) each."""
    made, pose = _unrolled(specimen / "oct")
    with xr.open_zarr(specimen / "truth/labels/oct.zarr") as labels:
        truth = {name: labels[name].values for name in ("theta_rad", "z_mm", "radius_mm", "surface_row", "cell_id")}
    calibration, modality = made.calibration, made.recording.manifest.load()
    n_slices, n_ascans = truth["theta_rad"].shape
    around, along = [], []
    for index in range(n_slices):
        # of the wall itself: in a cell the place of the panorama is that of the beam, not of the surface it meets
        wall = np.flatnonzero((truth["cell_id"][index] == 0) & (truth["surface_row"][index] < calibration.n_depth - 1))
        theta_rad = np.mod(pose.sense * (truth["theta_rad"][index, wall] - pose.theta0_rad), 2 * np.pi)
        depth_mm = truth["radius_mm"][index, wall] - calibration.grid.radius_mm
        z_mm = np.full(wall.size, calibration.slice_z_mm[index])
        found = modality.locate(index, Places(theta_rad, z_mm, depth_mm.astype(float)), calibration)["bscan"]
        ascan = found[:, 0] / (2 * np.pi) * n_ascans
        around.append(np.mod(ascan - wall + n_ascans / 2, n_ascans) - n_ascans / 2)
        along.append(found[:, 1] / calibration.mm_per_px - truth["surface_row"][index, wall])
    both = np.concatenate(around), np.concatenate(along)
    known = np.isfinite(both[0]) & np.isfinite(both[1])
    return both[0][known], both[1][known]


def pixel_errors(specimen: Path) -> np.ndarray:
    """Return by how many pixels places of the wall are missed in the endoscope's frames, float64 (n,)."""
    made, pose = _unrolled(specimen / "endoscope")
    modality, missed = made.recording.manifest.load(), []
    order = np.argsort(pose.z_bore_mm)
    with xr.open_zarr(specimen / "truth/labels/endoscope.zarr") as labels:
        for index in range(labels.sizes["frame"]):
            frame = labels.isel(frame=index)
            wall = frame.valid.values & (frame.cell_id.values == 0) & (np.abs(frame.depth_mm.values) < 0.02)
            row, column = (at[::EVERY] for at in np.nonzero(wall))
            theta_rad = np.mod(pose.sense * (frame.theta_rad.values[row, column] - pose.theta0_rad), 2 * np.pi)
            z_mm = _z_of_panorama(pose, frame.z_mm.values[row, column], order)
            nowhere = np.full(row.size, np.nan)
            found = modality.locate(index, Places(theta_rad.astype(float), z_mm, nowhere), made.calibration)["frame"]
            missed.append(np.hypot(found[:, 0] - column, found[:, 1] - row))
    missed_px = np.concatenate(missed)
    return missed_px[np.isfinite(missed_px)]


def table_errors(specimen: Path, name: str) -> np.ndarray:
    """Return by how many pixels of a picture the table misses what ``locate`` says, halfway between its entries."""
    made, _ = _unrolled(specimen / name)
    index = len(made.recording.stream) // 2
    frame, modality = made.recording.stream[index], made.recording.manifest.load()
    missed = []
    for picture in illustrated(modality, frame, made.calibration):
        if picture.seen is None or picture.name not in ("bscan", "frame"):
            continue
        n_theta = picture.seen.xy.shape[1]
        theta_rad = 2 * np.pi / n_theta * (np.arange(n_theta) + 0.5)
        z_mm = np.full(n_theta, picture.seen.z_mm[len(picture.seen.z_mm) // 2])
        row = picture.seen.xy[len(picture.seen.z_mm) // 2]
        exact = modality.locate(index, Places(theta_rad, z_mm, np.zeros(n_theta)), made.calibration)[picture.name]
        between = row + _short(np.roll(row, -1, axis=0) - row, picture.x_label) / 2
        height, width = picture.image.shape[:2]
        scale = np.array([width, height]) / np.array([np.ptp(picture.x_extent), np.ptp(picture.y_extent)])
        apart = np.abs(_short(exact - between, picture.x_label) * scale)
        missed.append(apart[:, 0] if picture.name == "bscan" else np.hypot(*apart.T))
    found = np.concatenate(missed)
    return found[np.isfinite(found)]


def _short(step: np.ndarray, label: str) -> np.ndarray:
    if not label.endswith("(rad)"):
        return step
    return np.stack([np.mod(step[:, 0] + np.pi, 2 * np.pi) - np.pi, step[:, 1]], axis=1)


@cache
def _unrolled(path: Path) -> tuple[Unrolled, TruePose]:
    made = unroll_recording(open_recording(path), SilentStages())
    return made, true_pose(made.panorama, load_truth(path.parent))


def _z_of_panorama(pose: TruePose, z_bore_mm: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Return z in the panorama, continued beyond the first and last frame as :meth:`TruePose.z_bore` is."""
    there, here = pose.z_bore_mm[order], pose.z_panorama_mm[order]
    inner = np.interp(z_bore_mm, there, here)
    slope = np.sign(here[-1] - here[0])
    return np.asarray(inner + slope * (z_bore_mm - np.clip(z_bore_mm, there[0], there[-1])))


def lines(preset: str, seed: int) -> Iterator[str]:
    """Yield what there is to say of one specimen."""
    with tempfile.TemporaryDirectory() as folder:
        specimen = Path(folder) / "specimen"
        simulate(specimen, preset=preset, seed=seed, labels=True)
        around, along = oct_errors(specimen)
        missed = pixel_errors(specimen)
        tables = {name: table_errors(specimen, name) for name in ("oct", "endoscope")}
    said = (
        ("oct, A-scans", around), ("oct, depth samples", along), ("endoscope, px", missed),
        ("table between entries, oct, px of the picture", tables["oct"]),
        ("table between entries, endoscope, px", tables["endoscope"]),
    )  # fmt: skip
    for name, errors in said:
        size = np.abs(errors)
        yield (
            f"seed {seed}, {name}: {errors.size} places, median {np.median(size):.2f}, "
            f"95th percentile {np.percentile(size, 95):.2f}, bias {np.median(errors):+.2f}"
        )


if __name__ == "__main__":
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--preset", default="quick")
    asked.add_argument("--seeds", type=int, nargs="+", default=[1000])
    arguments = asked.parse_args()
    for one in arguments.seeds:
        for line in lines(arguments.preset, one):
            print(line, flush=True)
