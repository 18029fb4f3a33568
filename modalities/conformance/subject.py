"""A plug-in under test with a recording it reads, and what the checks share."""

import pickle
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from endoct.base.errors import EndoctError
from endoct.modalities.acquisition import read_keys, sidecar_path, validate
from endoct.modalities.contract import Calibration, Frame, FrameStream, Manifest, Modality, StreamOver
from endoct.stitching.strip import Strip

Anything = TypeVar("Anything")


class NotConforming(Exception):
    """A plug-in breaks the contract; the message says where."""


class Subject:
    """A plug-in and a recording it reads, with what several checks need made once.

    ``recording`` is a folder or a file with its ``acquisition.toml``.
    """

    def __init__(self, manifest: Manifest, recording: Path) -> None:
        self.manifest = manifest
        self.recording = recording

    def open(self, **overrides: Any) -> FrameStream:
        """Open the recording with its sidecar, ``overrides`` replacing keys."""
        keys = read_keys(self.recording) | {"modality": self.manifest.name} | overrides
        acquisition = validate(self.manifest.acquisition, keys, str(sidecar_path(self.recording)))
        return self.modality.open(self.recording, acquisition)

    def survey(self, stream: FrameStream) -> Calibration:
        """Survey ``stream`` with the default parameters."""
        calibration: Calibration = self.modality.survey(stream, self.modality.parameters())
        return calibration

    @cached_property
    def modality(self) -> Modality[Any, Any]:
        """The loaded implementation."""
        return self.manifest.load()

    @cached_property
    def stream(self) -> FrameStream:
        """The recording, opened."""
        return self.open()

    @cached_property
    def calibration(self) -> Calibration:
        """What the survey finds."""
        return self.survey(self.stream)

    @cached_property
    def strips(self) -> Mapping[int, Strip]:
        """The first, the middle and the last frame, unrolled, by index."""
        probed = sorted({0, len(self.stream) // 2, len(self.stream) - 1})
        return {index: self.modality.unroll(self.stream[index], self.calibration) for index in probed}


class Replaced(StreamOver):
    """Some frames of a stream, by index, with their samples changed; a stream itself."""

    def __init__(
        self,
        stream: FrameStream,
        indices: tuple[int, ...],
        change: Callable[[np.ndarray[Any, Any]], np.ndarray[Any, Any]] | None = None,
    ) -> None:
        self.stream, self._indices, self._change = stream, indices, change

    def __len__(self) -> int:
        return len(self._indices)

    def __getitem__(self, index: int) -> Frame:
        frame = self.stream[self._indices[index]]
        samples = frame.samples if self._change is None else self._change(frame.samples)
        samples.flags.writeable = False
        return replace(frame, index=index, samples=samples)


def demand(condition: object, complaint: str) -> None:
    """Raise :class:`NotConforming` with ``complaint`` unless ``condition`` holds."""
    if not condition:
        raise NotConforming(complaint)


@contextmanager
def only_endoct_errors(doing: str) -> Iterator[None]:
    """Turn every exception that is no :class:`EndoctError` into a complaint about ``doing``."""
    try:
        yield
    except (EndoctError, NotConforming):
        raise
    except Exception as error:
        raise NotConforming(f"{doing} raises {type(error).__name__}: {error}") from error


@contextmanager
def refusal_allowed() -> Iterator[None]:
    """Let an :class:`EndoctError` of one line pass: the plug-in may refuse this input."""
    try:
        yield
    except EndoctError as error:
        demand("\n" not in str(error), f"an error is longer than one line: {error}")


def pickled(value: Anything, name: str) -> Anything:
    """Return ``value`` as another process would get it."""
    try:
        copy: Anything = pickle.loads(pickle.dumps(value))
    except Exception as error:
        raise NotConforming(f"{name} cannot be pickled: {error}") from error
    return copy


def same(a: np.ndarray[Any, Any], b: np.ndarray[Any, Any]) -> bool:
    """Say whether two arrays are the same to the last bit."""
    a, b = np.asarray(a), np.asarray(b)
    return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()


def same_strip(a: Strip, b: Strip) -> bool:
    """Say whether two strips are the same to the last bit, wherever they are valid."""
    names = ("z_mm", "theta_rad", "intensity", "valid", "weight")
    if (a.depth_mm is None) != (b.depth_mm is None) or not all(same(getattr(a, n), getattr(b, n)) for n in names):
        return False
    return a.depth_mm is None or b.depth_mm is None or same(a.depth_mm, b.depth_mm)
