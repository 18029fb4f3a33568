"""A bore wall with one marked place, as panorama, volume and comparison, to be found again in what is exported."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mock_comparison import Kind, write_comparison
from numpy.typing import NDArray

from endoct.base.files.output import new_output
from endoct.base.zarr.zarr_store import Named, consolidate, write_arrays
from endoct.fusion.files.store import save_comparison
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.sides import Comparison, PlacedSide
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import save_panorama
from endoct.workbench.running.outputs import COMPARISON, PANORAMA

RADIUS_MM = 1.25
DEPTH_MM = 0.4
"""How far behind the nominal wall the marked place lies."""
WIDE_MM = 0.08
"""Standard deviation of the mark along the wall."""
ALIGNMENT = Alignment(1.1, 0.7, 1.02, mirrored=True, z_reversed=False, confidence=0.9)
WALL, MARK, UNSEEN = 50.0, 250.0, (30, 33)


@dataclass(frozen=True)
class Place:
    """A place in the bore frame."""

    theta_rad: float
    z_mm: float

    @property
    def xyz_mm(self) -> NDArray[np.float64]:
        """Where the marked wall lies there."""
        radius_mm = RADIUS_MM + DEPTH_MM
        return np.array([radius_mm * np.cos(self.theta_rad), radius_mm * np.sin(self.theta_rad), self.z_mm])

    @property
    def mirrored(self) -> "Place":
        """Where it would be found if θ ran the other way."""
        return Place(-self.theta_rad, self.z_mm)


PLACES = (Place(1.1, 1.9), Place(0.01, 1.4), Place(2 * np.pi - 0.01, 2.6), Place(4.0, 3.1))
"""Anywhere, and on either side of the seam of θ. The last one lies at another end of every axis than the first."""


def grid(n_theta: int = 360, *, theta0_rad: float = 0.3) -> SurfaceGrid:
    """A grid whose first column is not at θ = 0."""
    return SurfaceGrid.full_circle(101, n_theta, z0_mm=-0.5, dz_mm=0.05, radius_mm=RADIUS_MM, theta0_rad=theta0_rad)


def mark_on(of: SurfaceGrid, place: Place) -> NDArray[np.float32]:
    """How much every sample is marked, 0 to 1."""
    turn = np.mod(of.theta_rad - place.theta_rad + np.pi, 2 * np.pi) - np.pi
    apart = np.hypot(RADIUS_MM * turn[np.newaxis, :], of.z_mm[:, np.newaxis] - place.z_mm)
    return np.exp(-0.5 * (apart / WIDE_MM) ** 2).astype(np.float32)


def marked_panorama(place: Place, of: SurfaceGrid | None = None) -> Panorama:
    """A panorama with the mark in its relief and its brightness; a few rows were not observed."""
    of = grid() if of is None else of
    mark = mark_on(of, place)
    valid = np.ones(of.shape, np.bool_)
    valid[slice(*UNSEEN), : of.n_theta // 3] = False
    frames = {
        "slice_z_mm": of.z_mm[::10],
        "residual_mm": np.linspace(0.001, 0.002, len(of.z_mm[::10])),
        "bridged": np.arange(len(of.z_mm[::10])) == 3,
        "sine_omega": np.full(len(of.z_mm[::10]), np.nan),
        "rotation_harmonics_rad": np.zeros((len(of.z_mm[::10]), 2)),
    }
    return Panorama(
        grid=of,
        intensity=WALL + (MARK - WALL) * mark,
        depth_mm=DEPTH_MM * mark,
        valid=valid,
        weight=valid.astype(np.float32),
        modality="oct",
        handedness_known=True,
        travel_known=True,
        frame_dim="slice",
        per_frame=frames,
        provenance={"parameters": {}, "inputs": {}, "acquisition": {}, "versions": {}},
    )


def write_marked(path: Path, place: Place, of: SurfaceGrid | None = None, dtype: str | None = None) -> Path:
    """Write the panorama; with a ``dtype`` its volume as well, in which the mark is a ball at the marked place."""
    panorama = marked_panorama(place, of)
    with new_output(path, PANORAMA) as scratch:
        save_panorama(panorama, scratch)
        if dtype is not None:
            _write_volume(scratch / "volume", panorama.grid, place, np.dtype(dtype))
            consolidate(scratch)
    return path


def _write_volume(path: Path, of: SurfaceGrid, place: Place, dtype: np.dtype) -> None:
    radii_mm = np.arange(0.8, 2.0, 0.01)
    x = radii_mm * np.cos(of.theta_rad)[:, np.newaxis]
    y = radii_mm * np.sin(of.theta_rad)[:, np.newaxis]
    at = place.xyz_mm
    square = (x - at[0]) ** 2 + (y - at[1]) ** 2 + (of.z_mm[:, np.newaxis, np.newaxis] - at[2]) ** 2
    values = WALL + (MARK - WALL) * np.exp(-0.5 * square / WIDE_MM**2)
    if dtype.kind == "f":
        values[..., -20:] = np.nan
    write_arrays(
        path,
        {
            "z": Named(("z",), of.z_mm, {"units": "mm"}),
            "theta": Named(("theta",), of.theta_rad, {"units": "rad"}),
            "radius": Named(("depth",), radii_mm, {"units": "mm"}),
            "intensity": Named(("z", "theta", "depth"), values.astype(dtype), {}, (1, *values.shape[1:])),
        },
        {"radius_mm": of.radius_mm},
        coordinates=["radius"],
    )


def write_marked_comparison(folder: Path, place: Place, alignment: Alignment | None = ALIGNMENT) -> Path:
    """A comparison of an endoscope, which has no depth, and an OCT, whose mark is where the place is."""
    of = grid(theta0_rad=0.0)
    mark = mark_on(of, place)
    cells = mark > 0.5
    valid = np.ones(of.shape, np.bool_)
    valid[slice(*UNSEEN)] = False
    nothing = np.full(of.shape, np.nan, np.float32)
    elsewhere = mark_on(of, Place(place.theta_rad + 0.5, place.z_mm))
    sides = (
        PlacedSide(
            name="endoscope",
            intensity=MARK * elsewhere,
            depth_mm=nothing,
            mask=elsewhere > 0.5,
            valid=np.ones(of.shape, np.bool_),
        ),
        PlacedSide(
            name="oct",
            intensity=WALL + (MARK - WALL) * mark,
            depth_mm=DEPTH_MM * mark,
            mask=cells & valid,
            valid=valid,
        ),
    )
    with new_output(folder, COMPARISON) as scratch:
        result = write_comparison(scratch / "mock", Kind("endoscope", depth=False), Kind("oct"))
        save_comparison(Comparison(of, sides, alignment, None, result), scratch / "comparison.zarr")
        (scratch / "result.json").write_text(json.dumps(result.to_json()), encoding="utf-8")
        (scratch / "mock" / "panoramas").rename(scratch / "panoramas")
    return folder
