"""The plug-in for unrolled images, with the methods that the contract requires."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError
from endoct.modalities.contract import Frame, FrameStream, Modality, Picture
from endoct.modalities.unrolled.image_stream import MOST_STEP, open_image, sniff_image, step_over_seam
from endoct.modalities.unrolled.manifest import UnrolledAcquisition
from endoct.modalities.unrolled.sines import Sines, UnrolledParameters, about_axis, fit_sines
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.stitching.strip import Strip

ONLY_DEPTH = "Only depth was recorded: what is shown as intensity is depth."


@dataclass(frozen=True, eq=False)
class UnrolledCalibration:
    """The calibration of the contract.

    Attributes
    ----------
    grid, row_z_mm, per_frame, notes: as the contract says.
    acquisition: the sidecar.
    sines: what the probe's distance from the axis makes of depth, in recording order; None where there is none.
    zero_mm: what depth as recorded, in mm, is on the nominal wall.
    most: the largest intensity.
    """

    grid: SurfaceGrid
    row_z_mm: Coordinates
    per_frame: Mapping[str, NDArray[Any]]
    notes: tuple[str, ...]
    acquisition: UnrolledAcquisition
    sines: Sines | None
    zero_mm: float
    most: float

    @property
    def handedness_known(self) -> bool:
        """Whether the sidecar says how columns run against θ."""
        return self.acquisition.handedness != "unknown"

    @property
    def travel_known(self) -> bool:
        """Whether the sidecar says which way rows run."""
        return self.acquisition.travel != "unknown"


class Unrolled:
    """The implementation of the modality; it has no state."""

    parameters = UnrolledParameters
    sniff = staticmethod(sniff_image)
    open = staticmethod(open_image)

    def survey(self, stream: FrameStream, parameters: UnrolledParameters) -> UnrolledCalibration:
        """Lay the grid through the rows, and find the sine of every turn of a depth that is not centred."""
        acquisition = stream.acquisition
        if not isinstance(acquisition, UnrolledAcquisition):
            raise EndoctError("an unrolled image needs a sidecar of its own", found=type(acquisition).__name__)
        turns, z_mm = [], np.empty(len(stream))
        for index in range(len(stream)):
            frame = stream[index]
            turns.append(_in_theta(frame, acquisition))
            z_mm[index] = frame.z_mm
        row_z_mm = np.sort(z_mm)
        pitch_mm = float(np.median(np.diff(row_z_mm))) if z_mm.size > 1 else acquisition.row_pitch_mm or 1.0
        radius_mm = acquisition.bore_diameter_mm / 2
        grid = SurfaceGrid.full_circle(
            z_mm.size,
            len(turns[0]),
            z0_mm=float(row_z_mm[0]),
            dz_mm=pitch_mm,
            theta0_rad=acquisition.theta_origin_rad,
            radius_mm=radius_mm,
        )
        per_frame: dict[str, NDArray[Any]] = {"z_mm": z_mm}
        notes, sines, zero_mm, most = [], None, 0.0, 0.0
        if acquisition.intensity_file is not None:
            most = max(
                (float(turn[seen].max()) for turn in (t[:, 0] for t in turns) if (seen := ~np.isnan(turn)).any()),
                default=0.0,
            )
        else:
            notes.append(ONLY_DEPTH)
        if acquisition.depth_file is not None:
            depths = [turn[:, -1] for turn in turns]
            if not acquisition.centred:
                sines = fit_sines(depths, grid, abs(acquisition.mm_per_count), parameters)
                per_frame |= sines.per_frame()
                zero_mm = float(np.median(sines.offset_mm))
                notes += _on_sines(sines)
            elif (known := np.concatenate([depth[np.isfinite(depth)] for depth in depths])).size:
                zero_mm = float(np.median(known))
            if acquisition.zero_depth_mm is not None:
                zero_mm = -acquisition.zero_depth_mm
        return UnrolledCalibration(grid, row_z_mm, per_frame, tuple(notes), acquisition, sines, zero_mm, most)

    def unroll(self, frame: Frame, calibration: UnrolledCalibration) -> Strip:
        """Lay one row of the image on its row of the panorama, about the bore's axis. Pure."""
        grid, a = calibration.grid, calibration.acquisition
        turn = _in_theta(frame, a)
        if len(turn) != grid.n_theta:
            raise EndoctError(
                f"row {frame.index} has another number of columns than the first",
                found=f"{len(turn)}",
                expected=f"{grid.n_theta}",
            )
        valid = np.asarray(np.isfinite(turn).all(axis=1), np.bool_)
        depth_mm = None
        if a.depth_file is not None:
            depth_mm = turn[:, -1].astype(np.float64) - calibration.zero_mm
        intensity = turn[:, 0]
        if a.brighter == "smaller" and a.intensity_file is not None:
            intensity = np.float32(calibration.most) - intensity
        if calibration.sines is not None and depth_mm is not None:
            depth_mm, intensity, valid = _centred(depth_mm, intensity, valid, frame.index, calibration)
        if a.intensity_file is None and depth_mm is not None:
            intensity = depth_mm.astype(np.float32)
        return Strip(
            z_mm=np.array([frame.z_mm]),
            theta_rad=grid.theta_rad,
            intensity=np.where(valid, intensity, 0.0)[np.newaxis],
            depth_mm=None if depth_mm is None else np.where(valid, depth_mm, np.nan)[np.newaxis],
            valid=valid[np.newaxis],
            weight=valid[np.newaxis].astype(np.float32),
        )

    def settle(self, panorama: Panorama, calibration: UnrolledCalibration) -> Panorama:
        """Doubt an image whose last column does not continue in its first."""
        shown = np.where(panorama.valid, panorama.intensity, np.float32(np.nan))
        first = 0 if calibration.acquisition.handedness != "mirrored" else 1
        step, _ = step_over_seam(np.roll(shown, -first, axis=1))
        if not step > MOST_STEP and step != 0:
            return panorama
        what = (
            "The image may show no full turn: from its last column to its first, values change "
            f"{step:.1f} times as much as between neighbours."
            if step
            else "The image's last column repeats its first: leave one out with 'columns'."
        )
        doubt = Doubt("turn-not-closed", what, value=step, unit="1", expected=(0.0, MOST_STEP))
        return replace(panorama, doubts=(*panorama.doubts, doubt))

    def illustrate(self, frame: Frame, calibration: UnrolledCalibration) -> tuple[Picture, ...]:
        """Show the image as recorded about a row, in its colours."""
        del calibration
        around = np.asarray(frame.metadata.get("around", frame.samples[np.newaxis, :, 0]))
        first = int(frame.metadata.get("first_row", frame.index))
        n_rows, n_columns = around.shape[:2]
        line = np.array([[0.0, frame.index], [n_columns - 1.0, frame.index]])
        return (
            Picture(
                name="row",
                title=f"Row {frame.index} of the image as recorded, with those around it",
                image=around,
                x_label="column",
                y_label="row",
                x_extent=(0.0, n_columns - 1.0),
                y_extent=(float(first), float(first + n_rows - 1)),
                curves={"this row": line},
            ),
        )


def _in_theta(frame: Frame, acquisition: UnrolledAcquisition) -> Image:
    """Return a row, float32 (column, channel), in the order of θ, depth in mm."""
    samples = np.asarray(frame.samples, np.float32)
    if acquisition.handedness == "mirrored":
        samples = np.roll(samples[::-1], 1, axis=0)  # direction k becomes −k
    if acquisition.depth_file is None:
        return samples
    scaled = samples.copy()
    scaled[:, -1] *= np.float32(acquisition.mm_per_count)
    return scaled


def _centred(
    depth_mm: Coordinates, intensity: Image, valid: Mask, index: int, calibration: UnrolledCalibration
) -> tuple[Coordinates, Image, Mask]:
    """Return depth, intensity and what is valid on the grid's columns, of beams from a probe off the axis."""
    sines, grid = calibration.sines, calibration.grid
    if sines is None or sines.bridged[index] or not valid.any():
        return depth_mm, intensity, np.zeros_like(valid)
    off_mm = -float(sines.cosine_mm[index]), -float(sines.sine_mm[index])
    angle, depth_mm = about_axis(depth_mm, grid.theta_rad, off_mm, grid.radius_mm)
    seen = np.flatnonzero(valid)
    at = np.mod(angle[seen] - grid.theta0_rad, 2 * np.pi)
    order = np.argsort(at, kind="stable")
    columns = grid.theta_rad - grid.theta0_rad
    on_grid = [np.interp(columns, at[order], values[seen][order], period=2 * np.pi) for values in (depth_mm, intensity)]
    steps = np.diff(at[order], append=at[order[0]] + 2 * np.pi)
    gap = steps[np.searchsorted(at[order], columns, side="right") - 1]
    return on_grid[0], on_grid[1].astype(np.float32), gap < 2 * grid.dtheta_rad


def _on_sines(sines: Sines) -> list[str]:
    bridged = int(np.count_nonzero(sines.bridged))
    typical = float(np.median(np.hypot(sines.cosine_mm, sines.sine_mm)))
    said = [f"The probe was {typical:.3g} mm off the axis in the median of turns; the sine of each was taken off."]
    if bridged:
        said.append(f"{bridged} of {sines.bridged.size} turns show no sine and are not valid.")
    return said


UNROLLED: Modality[UnrolledParameters, UnrolledCalibration] = Unrolled()
