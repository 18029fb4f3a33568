"""Reading and unrolling a profilometer recording: there is little to unroll, a turn is a row of the wall."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.modalities.contract import Frame, Picture, Places, Sniff, inward_positions_mm
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.stitching.strip import Strip
from endoct_profilometer.manifest import ProfilometerAcquisition

HEADER = "radius_mm,brightness"


class Parameters(BaseModel):
    """How a profilometer recording is processed."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    deepest_mm: float = Field(default=3.0, gt=0, description="a radius farther than this from the bore is a ghost")


@dataclass(frozen=True, eq=False)
class Turns:
    """A recording, opened: one CSV file a turn."""

    files: tuple[Path, ...]
    acquisition: ProfilometerAcquisition
    z_mm: Coordinates

    def __len__(self) -> int:
        return len(self.files)

    def __getitem__(self, index: int) -> Frame:
        if not 0 <= index < len(self):
            raise IndexError(index)
        return Frame(index, _read(self.files[index]), float(self.z_mm[index]))


@dataclass(frozen=True, eq=False)
class ProfilometerCalibration:
    """Where every turn lies, and which radii are ghosts."""

    grid: SurfaceGrid
    row_z_mm: Coordinates
    per_frame: Mapping[str, NDArray[Any]]
    notes: tuple[str, ...]
    handedness_known: bool
    travel_known: bool
    deepest_mm: float
    mirrored: bool


class Profilometer:
    """The implementation of the modality; it has no state."""

    parameters = Parameters

    def sniff(self, path: Path) -> Sniff:
        """Claim a folder whose first CSV file starts with the header."""
        if not path.is_dir():
            return Sniff(False, "a profilometer recording is a folder")
        files = _files(path)
        if not files:
            return Sniff(False, "no CSV file in the folder")
        with files[0].open("rb") as file:
            if file.read(len(HEADER)) != HEADER.encode():
                return Sniff(False, f"{files[0].name} does not start with '{HEADER}'")
        return Sniff(True, f"{len(files)} turns")

    def open(self, path: Path, acquisition: ProfilometerAcquisition) -> Turns:
        """List the turns."""
        files = _files(path) if path.is_dir() else ()
        if not files:
            raise EndoctError(f"{path} holds no turns", expected="a folder of CSV files, one a turn")
        z_mm = inward_positions_mm(
            len(files), pitch_mm=acquisition.pitch_mm, travel=acquisition.travel, positions_mm=acquisition.positions_mm
        )
        return Turns(files, acquisition, z_mm)

    def survey(self, stream: Turns, parameters: Parameters) -> ProfilometerCalibration:
        """Lay the grid through the turns, and count what is missing in each."""
        acquisition = stream.acquisition
        turns = [stream[index] for index in range(len(stream))]
        missing = np.array([float(np.mean(np.isnan(turn.samples[:, 0]))) for turn in turns])
        z_mm = np.array([turn.z_mm for turn in turns])
        row_z_mm = np.unique(z_mm)
        grid = SurfaceGrid.full_circle(
            row_z_mm.size,
            len(turns[0].samples),
            z0_mm=float(row_z_mm[0]),
            dz_mm=float(np.median(np.diff(row_z_mm))) if row_z_mm.size > 1 else acquisition.pitch_mm,
            theta0_rad=acquisition.theta_origin_rad,
            radius_mm=acquisition.bore_diameter_mm / 2,
        )
        dark = int(np.sum(missing > 0.5))
        return ProfilometerCalibration(
            grid=grid,
            row_z_mm=row_z_mm,
            per_frame={"z_mm": z_mm, "missing_fraction": missing},
            notes=(f"{dark} of {len(turns)} turns lack more than half of their radii.",) if dark else (),
            handedness_known=acquisition.handedness != "unknown",
            travel_known=acquisition.travel != "unknown",
            deepest_mm=parameters.deepest_mm,
            mirrored=acquisition.handedness == "mirrored",
        )

    def unroll(self, frame: Frame, calibration: ProfilometerCalibration) -> Strip:
        """Make the one row of the wall that a turn is."""
        grid = calibration.grid
        if frame.samples.shape != (grid.n_theta, 2):
            raise EndoctError(
                f"turn {frame.index} has another number of lines than the first",
                found=f"{len(frame.samples)}",
                expected=f"{grid.n_theta}",
            )
        samples = frame.samples
        if calibration.mirrored:
            samples = np.roll(samples[::-1], 1, axis=0)  # direction k becomes −k
        depth_mm = samples[:, 0] - np.float32(grid.radius_mm)
        valid = np.abs(depth_mm) <= calibration.deepest_mm  # False where the radius is NaN
        return Strip(
            z_mm=np.array([frame.z_mm]),
            theta_rad=grid.theta_rad,
            intensity=np.where(valid, samples[:, 1], 0.0)[np.newaxis],
            depth_mm=np.where(valid, depth_mm, np.nan)[np.newaxis],
            valid=valid[np.newaxis],
            weight=valid[np.newaxis].astype(np.float32),
        )

    def settle(self, panorama: Panorama, calibration: ProfilometerCalibration) -> Panorama:
        """Nothing is left to do."""
        del calibration
        return panorama

    def illustrate(self, frame: Frame, calibration: ProfilometerCalibration) -> tuple[Picture, ...]:
        """Show the turn as a row of brightness."""
        theta_rad = calibration.grid.theta_rad
        return (
            Picture(
                name="turn",
                title=f"Turn {frame.index} as recorded",
                image=np.repeat(frame.samples[np.newaxis, :, 1], 32, axis=0),
                x_label="θ (rad)",
                y_label="the turn, repeated",
                x_extent=(float(theta_rad[0]), float(theta_rad[-1])),
                y_extent=(0.0, 31.0),
            ),
        )

    def locate(self, index: int, places: Places, calibration: ProfilometerCalibration) -> dict[str, Coordinates]:
        """Say at which direction of a turn a place was measured."""
        near = np.abs(places.z_mm - calibration.per_frame["z_mm"][index]) <= calibration.grid.dz_mm
        theta0_rad = calibration.grid.theta0_rad
        along_x = np.mod(places.theta_rad - theta0_rad, 2 * np.pi) + theta0_rad
        xy = np.stack([along_x, np.full(along_x.size, np.nan)], axis=1)  # which direction; there is no depth in it
        return {"turn": np.where(near[:, np.newaxis], xy, np.nan)}


def _files(folder: Path) -> tuple[Path, ...]:
    return tuple(sorted(folder.glob("*.csv")))


def _read(path: Path) -> NDArray[np.float32]:
    """Return the turn as read-only float32 (direction, 2): radius in mm, NaN where there is none, and brightness."""
    try:
        header, *lines = path.read_text(encoding="utf-8").splitlines()
        samples = np.array([[float(cell or "nan") for cell in line.split(",")] for line in lines], dtype=np.float32)
    except (OSError, ValueError) as error:
        raise EndoctError(f"{path} cannot be read", found=str(error), expected=f"'{HEADER}' and numbers") from error
    if header != HEADER or samples.ndim != 2 or samples.shape[1] != 2:
        raise EndoctError(f"{path} is no turn", found=f"'{header[:40]}'", expected=f"'{HEADER}' and its two columns")
    samples.flags.writeable = False
    return samples


PROFILOMETER = Profilometer()
