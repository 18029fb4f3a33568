"""What an instrument's plug-in must offer.

A plug-in is a :class:`Manifest`, registered as an entry point of the group ``endoct.modalities``, and the
:class:`Modality` it names. The manifest must be importable without torch or OpenCV; the modality is loaded
when a recording is opened.

A plug-in

- **sniffs** a path cheaply, by content, and says why it declines;
- **opens** it without reading samples, as a sized, indexable, picklable stream of frames;
- **surveys** it in one pass: everything that needs the whole recording; the answer must not depend on how
  the pass is split among workers;
- **unrolls** one frame, purely;
- may **keep** of every frame what these two need, so that the recording is read once;
- may find **depth** by what its frames show of the same place;
- may **settle** the assembled panorama;
- may **locate** places of the wall in its pictures of a frame;
- may **calibrate** its instrument by a recording of a printed tube;
- marks unknown samples invalid, changes no input, raises only :class:`EndoctError`.

The conformance suite (:mod:`endoct.modalities.conformance`) checks all of this on any plug-in.
"""

from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError, cause_of
from endoct.modalities.acquisition import MOST_PLACE_MM, Acquisition
from endoct.modalities.reading.remarks import NONE, Remarks
from endoct.modalities.tube.measurement import Measurement
from endoct.modalities.tube.target import Target
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.stitching.per_frame import Meaning
from endoct.stitching.strip import Strip

Channel = Literal["intensity", "depth", "volume"]
Certainty = Literal["sure", "likely", "unsure"]
"""How much a plug-in that claims a path relies on that; the surest one reads it."""
P = TypeVar("P")


@dataclass(frozen=True, eq=False)
class Frame:
    """One endoscope frame or B-scan.

    Attributes: ``index`` in the recording's own order; ``samples``, read-only, for a B-scan (θ, depth), for
    an image (row, column) or (row, column, channel), in the file's dtype; ``z_mm`` nominal, inward, before
    any feed correction; ``metadata``.
    """

    index: int
    samples: NDArray[Any]
    z_mm: float
    metadata: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Preview:
    """What can be said of a recording before anybody wrote a sidecar.

    Attributes: ``n_frames``; ``size``, the samples of one frame in words, as "504 A-scans × 373 depth samples";
    ``dtype`` of the samples; ``pictures``, a few frames from the first to the last as their files hold them,
    (row, column) or (row, column, channel); ``remarks`` on the files, their order among it.
    """

    n_frames: int
    size: str
    dtype: str
    pictures: tuple[NDArray[Any], ...]
    remarks: Remarks = NONE


@dataclass(frozen=True)
class Sniff:
    """Whether a plug-in claims a path, and why (not); how sure it is, and what it saw, where it can say that.

    ``needs``: keys that this recording cannot be read without, though others can.
    """

    claims: bool
    reason: str
    certainty: Certainty = "sure"
    preview: Preview | None = field(default=None, compare=False)
    needs: tuple[str, ...] = ()


@dataclass(frozen=True)
class Manifest:
    """What is known of a plug-in without loading it.

    Attributes: ``name`` as in the sidecar's ``modality``; ``title`` for people; ``suffixes`` of the files it
    reads; ``acquisition``, the model of its sidecar; ``provides``, at most; ``frame_dim``, what a frame is called in
    its panoramas; ``implementation``, "module:name" of the :class:`Modality`; ``per_frame``, what the numbers per
    frame in its calibrations, diagnostics and panoramas mean, by name (those not named mean what their names say, see
    :func:`~endoct.stitching.per_frame.usual_meaning`).
    """

    name: str
    title: str
    suffixes: tuple[str, ...]
    acquisition: type[Acquisition]
    provides: frozenset[Channel]
    frame_dim: str
    implementation: str
    per_frame: Mapping[str, Meaning] = field(default_factory=dict, hash=False)

    def load(self) -> "Modality[Any, Any]":
        """Import the implementation. Raises :class:`EndoctError` naming what is missing."""
        module, _, name = self.implementation.partition(":")
        try:
            modality: Modality[Any, Any] = getattr(import_module(module), name)
        except (Exception, SystemExit) as error:  # a stranger's module may raise anything
            raise EndoctError(f"the modality '{self.name}' cannot be loaded", found=import_cause(error)) from error
        return modality


class FrameStream(Protocol):
    """A recording, opened. Sized, indexable from 0, picklable; reads one frame's samples when indexed.

    It may have ``remarks`` on its files: their order, and what was left out
    (:class:`~endoct.modalities.reading.remarks.Remarks`). They are asked for once all frames are read, and become notes
    and doubts of the panorama. It may have ``provides``, where a recording gives less than others of its modality.
    """

    @property
    def acquisition(self) -> Acquisition:
        """The checked sidecar, overrides included."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int, /) -> Frame: ...


class StreamOver:
    """A stream made of another: as long, and with its sidecar, except where a class of it has its own."""

    stream: FrameStream

    @property
    def acquisition(self) -> Acquisition:
        """The sidecar of the whole recording."""
        return self.stream.acquisition

    def __len__(self) -> int:
        return len(self.stream)


class Calibration(Protocol):
    """What a survey measured: everything that ``unroll`` needs besides the frame, picklable.

    ``grid`` and ``row_z_mm`` (float64 (n_z,), ascending) are the rows and columns of the panorama, on which
    every strip must lie. ``per_frame`` is geometry and quality per frame, in the recording's own order, with
    ``"z_mm"`` among them. ``notes`` says, in full sentences, what is to be known of the recording or of some of its
    frames. What speaks against the whole is a doubt, which ``settle`` adds.
    """

    @property
    def grid(self) -> SurfaceGrid:
        """The panorama's grid."""

    @property
    def row_z_mm(self) -> Coordinates:
        """float64 (n_z,), ascending, mm: the panorama's rows."""

    @property
    def per_frame(self) -> Mapping[str, NDArray[Any]]:
        """Geometry and quality per frame, in recording order."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What was not trusted, in full sentences."""

    @property
    def handedness_known(self) -> bool:
        """Whether θ's sense of rotation is known."""

    @property
    def travel_known(self) -> bool:
        """Whether z's direction is known."""


@dataclass(frozen=True, eq=False)
class Places:
    """Places on the wall of a panorama, float64 (n,) each.

    Attributes: ``theta_rad`` and ``z_mm`` in the panorama's frame; ``depth_mm``, by how much the wall there lies behind
    the nominal bore, as strips have it, NaN where that is not known.
    """

    theta_rad: Coordinates
    z_mm: Coordinates
    depth_mm: Coordinates


@dataclass(frozen=True, eq=False)
class Seen:
    """Where places of the wall are seen in a picture: ``xy``, float64 (n_z, n_theta, 2), in the picture's coordinates.

    Of places at ``z_mm``, float64 (n_z,), ascending, and at n_theta even steps of θ from 0, in the frame of the
    panorama. NaN where a place is not seen; y alone where only the column is known.
    """

    z_mm: Coordinates
    xy: Coordinates


@dataclass(frozen=True, eq=False)
class Picture:
    """One picture that shows a reader what was done to a frame.

    Attributes: ``name`` (short, used in file names); ``title``; ``image`` (row, column) or (row, column, 3),
    at most about 1000 samples a side; ``x_label`` and ``y_label`` with units; ``x_extent`` and ``y_extent``,
    the coordinates of the first and the last pixel centre along columns and rows; ``curves``: label to
    float64 (n, 2) of x and y in those coordinates, NaN where a curve is interrupted; ``about``: what else there is to
    see in it, in a sentence or two; ``seen``, where places of the wall are seen in it, if anybody knows.
    """

    name: str
    title: str
    image: NDArray[Any]
    x_label: str
    y_label: str
    x_extent: tuple[float, float]
    y_extent: tuple[float, float]
    curves: Mapping[str, Coordinates] = field(default_factory=dict)
    about: str = ""
    seen: Seen | None = None


def import_cause(error: BaseException) -> str:
    """Return why a module cannot be imported, in one line."""
    return str(error) if isinstance(error, ImportError | AttributeError) else cause_of(error)


C = TypeVar("C", bound=Calibration)


class Modality(Protocol[P, C]):
    """The implementation of a plug-in: a class with no state, or a module-level instance of one.

    Generic in its parameters ``P`` and its calibration ``C``.
    """

    @property
    def parameters(self) -> type[P]:
        """A frozen pydantic model of the processing parameters, all with defaults, names with units."""

    def sniff(self, path: Path) -> Sniff:
        """Say whether this plug-in reads ``path`` (a file or a folder), looking at content, not at names."""

    def open(self, path: Path, acquisition: Acquisition) -> FrameStream:
        """Open the recording without reading samples. Raises :class:`EndoctError` where it is unusable."""

    def survey(self, stream: FrameStream, parameters: P) -> C:
        """Find everything that needs the whole recording, in one pass over its frames."""

    def unroll(self, frame: Frame, calibration: C) -> Strip:
        """Turn one frame into a strip on the calibration's grid. Pure."""

    def settle(self, panorama: Panorama, calibration: C) -> Panorama:
        """Finish the assembled panorama (continuity of the wall in θ and z) and doubt it; may return it as it is."""

    def illustrate(self, frame: Frame, calibration: C) -> tuple[Picture, ...]:
        """Show for a report how one frame was understood: as recorded, with what was found, and unrolled."""


class ReadingOnce(Modality[P, C], Protocol[P, C]):
    """A plug-in that keeps of every frame what survey and unrolling need, so that a recording is read once."""

    def reading_once(self, stream: FrameStream, parameters: P) -> AbstractContextManager[FrameStream]:
        """Give a stream of what is kept of the frames of ``stream``, to be used within the context.

        ``survey`` and ``unroll`` return for its frames what they return for the recording's own.
        """


class ParallaxModality(Modality[P, C], Protocol[P, C]):
    """A plug-in that finds depth by comparing what its frames show of the same place."""

    def add_depth(self, panorama: Panorama, stream: FrameStream, calibration: C, parameters: P) -> Panorama:
        """Return ``panorama``, assembled of ``stream``, with ``parallax_depth_mm`` and ``parallax_error_mm``.

        As it is where ``parameters`` do not want them; NaN where the frames have too little in common.
        """


class VolumetricModality(Modality[P, C], Protocol[P, C]):
    """A plug-in that provides "volume": what lies below the surface too."""

    def write_volume(self, stream: FrameStream, calibration: C, store: Path) -> None:
        """Write the group ``volume`` (z, theta, depth) into the Zarr ``store``, one frame at a time."""


class CalibratingModality(Modality[P, C], Protocol[P, C]):
    """A plug-in whose instrument can be calibrated by a printed tube."""

    def calibrate(self, stream: FrameStream, parameters: P, target: Target) -> Measurement:
        """Return keys of the sidecar, with standard errors, that a recording of the tube ``target`` gives.

        Raises :class:`EndoctError` where it does not show the tube's marks, or contradicts its sizes.
        """


class LocatingModality(Modality[P, C], Protocol[P, C]):
    """A plug-in that knows where in its pictures places of the wall are seen."""

    def locate(self, index: int, places: Places, calibration: C) -> Mapping[str, Coordinates]:
        """Return where ``places`` are seen in the pictures of frame ``index``, by their names: float64 (n, 2).

        In the coordinates of a picture's axes. NaN where a place is not seen in that frame; NaN for y alone where the
        column is known but not how deep. A picture in which nothing can be located is left out.
        """


def inward_positions_mm(
    n_frames: int, *, pitch_mm: float, travel: str, positions_mm: tuple[float, ...] | None
) -> Coordinates:
    """Return the nominal z of every frame in recording order, float64 (n_frames,), 0 nearest the mouth.

    Frames travel inward unless ``travel`` is "out". ``positions_mm`` (along the travel) beats the pitch.
    Raises :class:`EndoctError` where there is not one finite position for each frame, or they lie farther apart
    than any bore is long.
    """
    if positions_mm is None:
        along = pitch_mm * np.arange(n_frames)
    else:
        along = np.asarray(positions_mm, dtype=np.float64)
        if along.shape != (n_frames,) or not np.all(np.isfinite(along)):
            raise EndoctError(
                "positions_mm must hold one finite position for each frame",
                found=f"{along.size} positions",
                expected=f"{n_frames}",
            )
    if np.ptp(along) > 2 * MOST_PLACE_MM:
        raise EndoctError(
            "the frames lie farther apart than any bore is long",
            found=f"{np.ptp(along):.4g} mm from the first to the last of {n_frames}",
            expected=f"{2 * MOST_PLACE_MM:g} mm at most",
            remedy="check the pitch, and the numbers in the names of the files",
        )
    z_mm = -along if travel == "out" else along
    return np.asarray(z_mm - z_mm.min(), dtype=np.float64)
