"""A recording that is still at hand, read again for pictures of single frames. It is only read.

The pictures are as the page has them: coded for a browser, with curves, and where a place lies in them.
"""

import base64
import io
import math
import os
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import digests, exists
from endoct.modalities.contract import FrameStream, Manifest, Picture, Seen
from endoct.modalities.illustration import illustrated
from endoct.modalities.recognition import open_recording
from endoct.stitching.store import PanoramaOutline
from endoct.workbench.running.interruption import stop_at_the_end
from endoct.workbench.running.refusals import in_one_line
from endoct.workbench.sides.recordings import Watched

State = Literal["unread", "reading", "read", "failed"]
QUALITY = 92
"""Of a JPEG. WebP of quality 88 makes B-scans a fifth smaller and 0.5 to 1 dB better, in twenty times the time."""
MOST_POINTS = 1000
"""Points of a curve: as many as a picture has columns."""


@dataclass(frozen=True)
class RecordingAtHand:
    """Where a recording lies, and how a panorama was made from it; ``inputs``: digests by the path in the recording."""

    path: Path
    modality: str
    inputs: dict[str, str]
    acquisition: dict[str, Any]
    parameters: dict[str, Any]


def recording_of(outline: PanoramaOutline, folder: Path) -> RecordingAtHand | None:
    """Return the recording that a panorama was made from; None where it is not there, or the panorama does not say.

    A path that was given relative to some folder is looked for from here first. Next come ``folder``, in which the
    output lies, and the folders above it. It is the recording only if its digests are, which :class:`Reader` checks.
    """
    found = outline.provenance
    inputs, acquisition, parameters = (found.get(key) for key in ("inputs", "acquisition", "parameters"))
    stated = path_of_recording(outline)
    path = None if stated is None else _at_hand(stated, folder)
    if stated is None or path is None:
        return None
    if not (isinstance(inputs, dict) and isinstance(acquisition, dict) and isinstance(parameters, dict)):
        return None
    return RecordingAtHand(path, outline.modality, _within(inputs, stated), acquisition, parameters)


def _at_hand(stated: Path, folder: Path) -> Path | None:
    """Return where the recording at the path ``stated`` lies now; None where it is nowhere."""
    here = folder.resolve()
    places = (stated, *(above / stated for above in (here, *here.parents)))
    return next((place for place in places if exists(place)), None)


def _within(inputs: Mapping[str, str], recording: Path) -> dict[str, str]:
    """Return the digests of a recording's samples by their paths within it: sidecars may differ."""
    return {
        Path(name).relative_to(recording).as_posix(): digest
        for name, digest in inputs.items()
        if not name.endswith(".toml")
    }


def path_of_recording(outline: PanoramaOutline) -> Path | None:
    """Return where the recording lay that a panorama was made from; None where the panorama does not say."""
    inputs = outline.provenance.get("inputs")
    names = [Path(name) for name in inputs] if isinstance(inputs, dict) else []
    if len(names) == 1 and names[0].name != "*":
        return names[0]
    with suppress(ValueError):  # of paths that have nothing in common
        return Path(os.path.commonpath([name.parent for name in names]))  # all that lay in one folder
    return None


@dataclass
class Reader:
    """Surveys a recording in a thread of its own once that is started, and then pictures any of its frames."""

    recording: RecordingAtHand
    state: State = "unread"
    said: str = ""
    share: float = 0.0
    """How much of the recording was read, 0 to 1."""
    _stream: FrameStream | None = None
    _manifest: Manifest | None = None
    _calibration: Any = None
    _order: Sequence[int] = ()
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def start(self) -> None:
        """Begin to read the recording, unless that was begun already."""
        with self._lock:
            if self.state in ("reading", "read"):
                return
            self.state = "reading"
        # no daemon: as Python ends, one that comes out of OpenCV would abort the process
        threading.Thread(target=self._survey).start()

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
        recording = self.recording
        if recording.inputs != _within(digests(recording.path, stop_at_the_end), recording.path):
            raise EndoctError(f"{recording.path} is not the recording that the panorama was made from, or was changed")

    def _advance(self, share: float) -> None:
        stop_at_the_end()
        self.share = share

    def _survey(self) -> None:
        recording = self.recording
        try:
            with refusing(f"{recording.path} cannot be read again"):
                self._check_same()
                self._manifest, stream = open_recording(
                    recording.path, modality=recording.modality, overrides=recording.acquisition
                )
                self._stream = Watched(stream, self._advance)
                implementation = self._manifest.load()
                parameters = implementation.parameters(**recording.parameters)
                self._calibration = implementation.survey(self._stream, parameters)
                self._order = np.argsort(self._calibration.per_frame["z_mm"], kind="stable").tolist()
        except (EndoctError, MemoryError) as error:
            self.said, self.state = str(in_one_line(error)), "failed"
        else:
            self.state = "read"


def picture_json(picture: Picture, ring: dict[str, float] | None) -> dict[str, Any]:
    """Return ``picture`` for the page.

    ``seen`` says where places of the wall are seen in it: ``x`` and ``y``, (n_z, n_theta), at ``z_mm`` and even steps
    of θ, None where not; None as a whole where the plug-in does not say. ``axis`` says how θ is found in it else:
    "theta", along x, or "ring": on the ``ring``, a line from its inner to its outer circle; None: nowhere.
    """
    is_ring = ring is not None and picture.x_label.endswith("(px)") and picture.y_label.endswith("(px)")
    axis = "ring" if is_ring else "theta" if picture.x_label.startswith("θ") else None
    every = {label: max(1, -(-len(curve) // MOST_POINTS)) for label, curve in picture.curves.items()}
    return {
        "title": picture.title,
        "about": picture.about,
        "x_label": picture.x_label,
        "y_label": picture.y_label,
        "x_extent": picture.x_extent,
        "y_extent": picture.y_extent,
        "curves": {label: _points(curve[:: every[label]]) for label, curve in picture.curves.items()},
        "seen": _seen(picture.seen),
        "axis": axis,
        "ring": ring if is_ring else None,
        "image": f"data:image/jpeg;base64,{base64.b64encode(_jpeg(picture.image)).decode('ascii')}",
    }


def ring_of(outline: PanoramaOutline, place: int) -> dict[str, float] | None:
    """Return the mirror's ring in the frame at ``place``, px, and its roll; None where the panorama does not say.

    θ on the wall is the angle in the image plus ``roll_rad``.
    """
    names = {
        **{"inner_x": "annulus_inner_x_px", "inner_y": "annulus_inner_y_px", "inner": "annulus_inner_px"},
        **{"outer_x": "annulus_x_px", "outer_y": "annulus_y_px", "outer": "annulus_outer_px"},
        "roll_rad": "roll_rad",
    }
    found = {key: outline.per_frame.get(name) for key, name in names.items()}
    per_frame = {key: one.values for key, one in found.items() if one is not None and one.values.ndim == 1}
    values = {key: float(numbers[place]) for key, numbers in per_frame.items() if place < numbers.size}
    return values if len(values) == len(names) and np.isfinite(list(values.values())).all() else None


def _points(curve: NDArray[np.float64]) -> Sequence[Sequence[float | None]]:
    known = np.isfinite(curve)
    places = zip(known[:, 0] & known[:, 1], curve.tolist(), strict=True)
    return [[float(f"{x:.5g}"), float(f"{y:.5g}")] if good else [None, None] for good, (x, y) in places]


def _seen(seen: Seen | None) -> dict[str, Any] | None:
    if seen is None:
        return None
    x, y = (
        [[float(f"{value:.5g}") if math.isfinite(value) else None for value in row] for row in seen.xy[..., k].tolist()]
        for k in (0, 1)
    )
    return {"z_mm": [round(z_mm, 6) for z_mm in seen.z_mm.tolist()], "x": x, "y": y}


def _jpeg(image: NDArray[Any]) -> bytes:
    """Return an image in grey or colours: of 8 bits as it is, others from the 0.2nd to the 99.8th percentile."""
    if image.dtype != np.uint8:
        known = image[np.isfinite(image)].astype(np.float32)
        low, high = np.percentile(known, [0.2, 99.8]) if known.size else (0.0, 1.0)
        scaled = (np.nan_to_num(image.astype(np.float32), nan=float(low)) - low) / max(float(high - low), 1e-9)
        image = np.clip(255 * scaled, 0, 255).astype(np.uint8)
    file = io.BytesIO()
    Pillow.fromarray(image).save(file, "JPEG", quality=QUALITY, subsampling="4:4:4")
    return file.getvalue()
