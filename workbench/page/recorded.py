"""A recording that is still at hand, read again for pictures of single frames. It is only read."""

import os
import threading
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from endoct.modalities.contract import Frame, FrameStream, Manifest, Picture
from endoct.modalities.illustrating import illustrated
from endoct.modalities.registry import open_recording
from endoct.stitching.digests import digests
from endoct.stitching.errors import EndoctError, refusing
from endoct.stitching.store import PanoramaOutline

State = Literal["unread", "reading", "read", "failed"]


@dataclass(frozen=True)
class Recording:
    """Where a recording lies, its digests, and how a panorama was made from it."""

    path: Path
    modality: str
    inputs: dict[str, str]
    acquisition: dict[str, Any]
    parameters: dict[str, Any]


def recording_of(outline: PanoramaOutline) -> Recording | None:
    """Return the recording that a panorama was made from; None where it is not there, or the panorama does not say."""
    found = outline.provenance
    inputs, acquisition, parameters = (found.get(key) for key in ("inputs", "acquisition", "parameters"))
    path = path_of_recording(outline)
    if path is None or not path.exists():
        return None
    if not (isinstance(inputs, dict) and isinstance(acquisition, dict) and isinstance(parameters, dict)):
        return None
    return Recording(path, outline.modality, dict(inputs), acquisition, parameters)


def path_of_recording(outline: PanoramaOutline) -> Path | None:
    """Return where the recording lay that a panorama was made from; None where the panorama does not say."""
    inputs = outline.provenance.get("inputs")
    names = [Path(name) for name in inputs] if isinstance(inputs, dict) else []
    if len(names) == 1 and names[0].name != "*":
        return names[0]
    with suppress(ValueError):  # of paths that have nothing in common
        return Path(os.path.commonpath([name.parent for name in names]))  # all that lay in one folder
    return None


class _Counted:
    """A stream that knows how much of it was read."""

    def __init__(self, stream: FrameStream) -> None:
        self._stream, self.n_read = stream, 0

    @property
    def acquisition(self) -> Any:
        return self._stream.acquisition

    @property
    def share(self) -> float:
        """Share of the frames that were read, 0 to 1."""
        return min(1.0, self.n_read / max(1, len(self._stream)))

    def __len__(self) -> int:
        return len(self._stream)

    def __getitem__(self, index: int) -> Frame:
        self.n_read += 1
        return self._stream[index]


@dataclass
class Reader:
    """Surveys a recording in a thread of its own when it is first asked to, and then pictures any of its frames."""

    recording: Recording
    state: State = "unread"
    said: str = ""
    _stream: _Counted | None = None
    _manifest: Manifest | None = None
    _calibration: Any = None
    _order: Sequence[int] = ()
    _lock: threading.Lock = field(default_factory=threading.Lock)

    @property
    def share(self) -> float:
        """How much of the recording was read, 0 to 1."""
        return 0.0 if self._stream is None else self._stream.share

    def start(self) -> None:
        """Begin to read the recording, unless that was begun already."""
        with self._lock:
            if self.state in ("reading", "read"):
                return
            self.state = "reading"
        threading.Thread(target=self._survey, daemon=True).start()

    def pictures(self, place: int) -> tuple[Picture, ...]:
        """Return the pictures of the frame at ``place`` in the order of ascending z.

        Raises :class:`EndoctError` where the recording has not been read, or has no such frame.
        """
        if self.state != "read" or self._stream is None or self._manifest is None:
            raise EndoctError(f"{self.recording.path} has not been read", found=self.state)
        if not 0 <= place < len(self._order):
            raise EndoctError("there is no such frame", found=str(place), expected=f"0 to {len(self._order) - 1}")
        with refusing(f"frame {place} of {self.recording.path} cannot be read"), self._lock:
            frame = self._stream[self._order[place]]
            return illustrated(self._manifest.load(), frame, self._calibration)

    def _check_same(self) -> None:
        """Raise :class:`EndoctError` where the recording is another than the panorama was made from.

        A store from elsewhere so leads to no file but those whose bytes its author had.
        """
        found, recording = digests(self.recording.path), self.recording
        if {name: digest for name, digest in recording.inputs.items() if not name.endswith(".toml")} != {
            name: digest for name, digest in found.items() if not name.endswith(".toml")
        }:
            raise EndoctError(f"{recording.path} is not the recording that the panorama was made from, or was changed")

    def _survey(self) -> None:
        recording = self.recording
        try:
            with refusing(f"{recording.path} cannot be read again"):
                self._check_same()
                self._manifest, stream = open_recording(
                    recording.path, modality=recording.modality, overrides=recording.acquisition
                )
                self._stream = _Counted(stream)
                implementation = self._manifest.load()
                parameters = implementation.parameters(**recording.parameters)
                self._calibration = implementation.survey(self._stream, parameters)
                self._order = np.argsort(self._calibration.per_frame["z_mm"], kind="stable").tolist()
        except EndoctError as error:
            self.said, self.state = str(error), "failed"
        else:
            self.state = "read"
