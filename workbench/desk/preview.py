"""What a sidecar changes, drawn at once: a few neighbouring frames surveyed as the form has it, one of them pictured.

It is done in a process of its own, so that the page answers meanwhile, and a fault in a plug-in ends nothing else.
"""

import threading
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from endoct.base.compute.worker_process import WorkerProcess, worker_process
from endoct.base.errors import EndoctError
from endoct.modalities.acquisition import Acquisition
from endoct.modalities.contract import Frame, FrameStream, Picture
from endoct.workbench.desk.sidecar_form import sidecar_form
from endoct.workbench.page.recorded import picture_json
from endoct.workbench.pipeline.information import recognise

NEIGHBOURS = 7
"""Frames that are surveyed: enough for what a plug-in takes from neighbours, few enough for a second."""

LONGEST_S = 180.0
"""For which a frame is waited for: the first of its kind compiles."""


class Previewer:
    """Draws drafts in a process that starts with the first of them and ends with :meth:`close`."""

    def __init__(self) -> None:
        self._process: WorkerProcess | None = None
        self._stack = ExitStack()
        self._lock = threading.Lock()

    def preview(
        self, recording: Path, modality: str | None, texts: Mapping[str, object], share: float
    ) -> dict[str, Any]:
        """Return what :func:`drawn` does."""
        with self._lock:
            if self._process is None:
                self._process = self._stack.enter_context(worker_process())
            try:
                return self._process.call(drawn, recording, modality, dict(texts), share).result(LONGEST_S)
            except TimeoutError as error:
                self.close()
                raise EndoctError("the frame cannot be drawn", found=f"no end after {LONGEST_S:g} s") from error
            except EndoctError as error:
                if "a worker process has ended" in str(error):
                    self.close()
                raise

    def close(self) -> None:
        """End the process."""
        self._stack.close()
        self._process = None


def drawn(recording: Path, modality: str | None, texts: Mapping[str, object], share: float) -> dict[str, Any]:
    """Return pictures of the frame at ``share``, 0 to 1, of ``recording`` for the page, as a form's ``texts`` have it.

    ``frame``, ``frames``; ``missing`` keys with why, by key; ``fault``, why it cannot be used, "" where it can. Where
    something is missing or at fault, ``pictures`` is the frame as its file holds it, if a plug-in can tell.
    """
    form = sidecar_form(recording, modality)
    missing, fault, frame, frames = form.missing(texts), "", 0, 0
    pictures: Sequence[Picture] = ()
    if not missing:
        try:
            stream = form.manifest.load().open(recording, form.acquisition(texts))
            frames = len(stream)
            frame = min(frames - 1, max(0, round(share * (frames - 1))))
            pictures = _pictured(form.manifest.load(), stream, frame)
        except EndoctError as error:
            fault = str(error)
    said = {"missing": missing, "fault": fault, "frame": frame, "frames": frames}
    return {**said, "pictures": [picture_json(each, None) for each in pictures or _as_recorded(recording, modality)]}


def _pictured(plugin: Any, stream: FrameStream, frame: int) -> tuple[Picture, ...]:
    first = min(max(0, frame - NEIGHBOURS // 2), max(0, len(stream) - NEIGHBOURS))
    part = _Part(stream, tuple(range(first, min(len(stream), first + NEIGHBOURS))))
    calibration = plugin.survey(part, plugin.parameters())
    pictures: tuple[Picture, ...] = plugin.illustrate(part[frame - first], calibration)
    return pictures


def _as_recorded(recording: Path, modality: str | None) -> Sequence[Picture]:
    preview = recognise(recording, modality).sniff.preview
    if preview is None or not preview.pictures:
        return ()
    image = np.asarray(preview.pictures[len(preview.pictures) // 2])
    rows, columns = image.shape[:2]
    every = max(1, -(-max(rows, columns) // 1000))
    ends = (0.0, columns - 1.0), (0.0, rows - 1.0)
    return [Picture("recorded", "as its file holds it", image[::every, ::every], "column", "row", *ends)]


@dataclass(frozen=True)
class _Part:
    """Some frames of a stream, as a stream of their own."""

    stream: FrameStream
    frames: tuple[int, ...]

    @property
    def acquisition(self) -> Acquisition:
        """The sidecar, with the positions of these frames."""
        positions_mm = self.stream.acquisition.positions_mm
        if positions_mm is None:
            return self.stream.acquisition
        return self.stream.acquisition.model_copy(
            update={"positions_mm": tuple(positions_mm[frame] for frame in self.frames)}
        )

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, index: int) -> Frame:
        return replace(self.stream[self.frames[index]], index=index)
