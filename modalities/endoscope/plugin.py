"""The endoscope plug-in with the methods that the contract requires; every step has a module of its own."""

from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path

from endoct.base.arrays import Coordinates
from endoct.modalities.acquisition import Acquisition
from endoct.modalities.contract import Frame, FrameStream, LocatingModality, Picture, Places, Sniff
from endoct.modalities.endoscope.calibration import EndoscopeCalibration
from endoct.modalities.endoscope.frame_stream import EndoscopeRecording, open_frames, sniff_frames
from endoct.modalities.endoscope.light import green_frames
from endoct.modalities.endoscope.parallax.depth import add_parallax
from endoct.modalities.endoscope.parameters import EndoscopeParameters
from endoct.modalities.endoscope.pictures import locate_in_frame, picture_frame
from endoct.modalities.endoscope.survey import survey_frames
from endoct.modalities.endoscope.tube_calibration import calibrate_endoscope
from endoct.modalities.endoscope.unroll import unroll_frame
from endoct.modalities.tube.measurement import Measurement
from endoct.modalities.tube.target import Target
from endoct.stitching.panorama import Panorama
from endoct.stitching.strip import Strip


@dataclass(frozen=True)
class EndoscopeModality:
    """The cone-mirror endoscope. ``device``: where torch samples frames; None: on the CPU, without torch."""

    device: str | None = None
    parameters = EndoscopeParameters

    def on_device(self, device: str) -> "EndoscopeModality":
        """Return the plug-in that samples frames for their strips on ``device``; the rest stays where it is."""
        return EndoscopeModality(device)

    def sniff(self, path: Path) -> Sniff:
        """Say whether ``path`` holds images of a mirror's annulus."""
        return sniff_frames(path)

    def open(self, path: Path, acquisition: Acquisition) -> EndoscopeRecording:
        """Open a folder of images, a multi-page TIFF or a video. Raises :class:`EndoctError` where it is unusable."""
        return open_frames(path, acquisition)

    def survey(self, stream: FrameStream, parameters: EndoscopeParameters) -> EndoscopeCalibration:
        """Find annulus, light, feed and roll, in one pass."""
        return survey_frames(stream, parameters)

    def reading_once(
        self,
        stream: FrameStream,
        parameters: EndoscopeParameters,  # noqa: ARG002 – the contract's
    ) -> AbstractContextManager[FrameStream]:
        """Return the recording's frames, reduced to what is needed and each read once from ``stream``."""
        return green_frames(stream)

    def unroll(self, frame: Frame, calibration: EndoscopeCalibration) -> Strip:
        """Turn one frame into a strip. Pure."""
        return unroll_frame(frame, calibration, self.device)

    def add_depth(
        self,
        panorama: Panorama,
        stream: FrameStream,
        calibration: EndoscopeCalibration,
        parameters: EndoscopeParameters,
    ) -> Panorama:
        """Add depth by parallax, where that is wanted and the frames have enough in common."""
        return add_parallax(panorama, stream, calibration) if parameters.parallax else panorama

    def settle(self, panorama: Panorama, calibration: EndoscopeCalibration) -> Panorama:
        """Add what is to be doubted; there is no depth of slices to reconcile."""
        return replace(panorama, doubts=(*panorama.doubts, *calibration.doubts))

    def illustrate(self, frame: Frame, calibration: EndoscopeCalibration) -> tuple[Picture, ...]:
        """Return the frame with its annulus drawn in, and the strip it unrolls to."""
        return picture_frame(frame, calibration)

    def locate(self, index: int, places: Places, calibration: EndoscopeCalibration) -> dict[str, Coordinates]:
        """Return which pixel of a frame sees each place, and where that is in the frame's strip."""
        return locate_in_frame(index, places, calibration)

    def calibrate(self, stream: FrameStream, parameters: EndoscopeParameters, target: Target) -> Measurement:
        """Return what a recording of a printed tube says of the endoscope."""
        return calibrate_endoscope(stream, parameters, target)


ENDOSCOPE: LocatingModality[EndoscopeParameters, EndoscopeCalibration] = EndoscopeModality()
