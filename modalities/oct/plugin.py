"""The OCT plug-in with the methods that the contract requires; every step has a module of its own."""

from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.modalities.acquisition import Acquisition
from endoct.modalities.contract import (
    Frame,
    FrameStream,
    Picture,
    Places,
    Sniff,
    VolumetricModality,
)
from endoct.modalities.oct.bscan import reduced_pullback
from endoct.modalities.oct.calibration import OctCalibration
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.pictures import locate_in_bscan, picture_bscan
from endoct.modalities.oct.pullback_stream import Pullback, sniff_pullback
from endoct.modalities.oct.survey import survey_pullback
from endoct.modalities.oct.tube_calibration import calibrate_pullback
from endoct.modalities.oct.undistort import write_volume
from endoct.modalities.oct.unroll import settle_pullback, unroll_bscan
from endoct.modalities.tube.measurement import Measurement
from endoct.modalities.tube.target import Target
from endoct.stitching.panorama import Panorama
from endoct.stitching.strip import Strip


@dataclass(frozen=True)
class OctModality:
    """Catheter OCT. ``device``: where torch makes B-scans of raw spectra; None: on the CPU, without torch."""

    device: str | None = None
    parameters = OctParameters

    def on_device(self, device: str) -> "OctModality":
        """Return the plug-in that makes B-scans of raw spectra on ``device``; the rest stays where it is."""
        return OctModality(device)

    def sniff(self, path: Path) -> Sniff:
        """Say whether ``path`` holds a stack of B-scans."""
        return sniff_pullback(path)

    def open(self, path: Path, acquisition: Acquisition) -> Pullback:
        """Open a pullback. Raises :class:`EndoctError` where it is unusable."""
        if not isinstance(acquisition, OctAcquisition):
            raise EndoctError("a pullback needs the sidecar of an OCT", found=type(acquisition).__name__)
        return Pullback(path, acquisition, self.device)

    def survey(self, stream: FrameStream, parameters: OctParameters) -> OctCalibration:
        """Locate the capillary in every slice and measure the rotation and the recording's levels, in one pass."""
        return survey_pullback(stream, parameters)

    def reading_once(self, stream: FrameStream, parameters: OctParameters) -> AbstractContextManager[FrameStream]:
        """Give the pullback's B-scans averaged over the panorama's columns, each read from ``stream`` once."""
        return reduced_pullback(stream, parameters)

    def unroll(self, frame: Frame, calibration: OctCalibration) -> Strip:
        """Turn one B-scan into one row of the panorama. Pure."""
        return unroll_bscan(frame, calibration)

    def settle(self, panorama: Panorama, calibration: OctCalibration) -> Panorama:
        """Finish the panorama: put a helical scan's rows in place, note a faint wall, and doubt a false sidecar."""
        return settle_pullback(panorama, calibration)

    def illustrate(self, frame: Frame, calibration: OctCalibration) -> tuple[Picture, ...]:
        """Return pictures of a B-scan: as recorded, with fitted face, sine and wall, and undistorted."""
        return picture_bscan(frame, calibration)

    def locate(self, index: int, places: Places, calibration: OctCalibration) -> dict[str, Coordinates]:
        """Return which beam of a B-scan meets each place, and how deep; and where that is in the undistorted one."""
        return locate_in_bscan(index, places, calibration)

    def write_volume(self, stream: FrameStream, calibration: OctCalibration, store: Path) -> None:
        """Write the dense hollow cylinder as the group ``volume`` of ``store``, one slice a chunk."""
        write_volume(stream, calibration, store)

    def calibrate(self, stream: FrameStream, parameters: OctParameters, target: Target) -> Measurement:
        """Return what a pullback through a printed tube says of the OCT."""
        return calibrate_pullback(stream, parameters, target)


OCT: VolumetricModality[OctParameters, OctCalibration] = OctModality()
