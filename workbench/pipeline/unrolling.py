"""One recording to one panorama, whatever its modality."""

from collections.abc import Mapping
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from threading import Event
from typing import Any, cast

from endoct.base.compute.own_process import give_back
from endoct.base.compute.parallel import thread_map
from endoct.base.errors import EndoctError, NotSeen
from endoct.base.files.files import State, check_unchanged, digests, state_of
from endoct.modalities.acquisition import Acquisition
from endoct.modalities.assembly import assemble
from endoct.modalities.contract import (
    Calibration,
    Frame,
    FrameStream,
    Manifest,
    Modality,
    ReadingOnce,
    VolumetricModality,
)
from endoct.modalities.device import Device
from endoct.modalities.reading.remarks import remarks_of
from endoct.modalities.registry import manifest_for, open_recording
from endoct.stitching.panorama import Panorama, doubts_of_observed
from endoct.workbench.pipeline.inputs import versions
from endoct.workbench.pipeline.settings import split
from endoct.workbench.running.progress import Advance, Stages

LOADED = 0.03
"""Share of the frames that are read before all libraries are loaded, compiled loops with them."""


@dataclass(frozen=True)
class Unrolled:
    """A panorama with what it was made from, for pictures of single frames and for volumes."""

    panorama: Panorama
    manifest: Manifest
    stream: FrameStream
    calibration: Calibration


@dataclass(frozen=True)
class Opened:
    """A recording that is known to be readable, with how and where to process it, and its files as they were."""

    path: Path
    files: State
    manifest: Manifest
    stream: FrameStream
    parameters: Any
    device: Device


class _Watched:
    """A stream that reports the share of it that has been read."""

    def __init__(self, stream: FrameStream, advance: Advance) -> None:
        self._stream, self._advance, self._read = stream, advance, 0

    @property
    def acquisition(self) -> Acquisition:
        return self._stream.acquisition

    def __len__(self) -> int:
        return len(self._stream)

    def __getitem__(self, index: int) -> Frame:
        frame = self._stream[index]
        self._read += 1
        self._advance(min(1.0, self._read / len(self._stream)))
        return frame


class _Digests:
    """The digests of a recording, made by a thread of their own; given up with the context.

    It works while libraries are loaded and once all frames are read. In between, all processors are busy.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._idle, self._stop = path, Event(), Event()
        self._idle.set()

    def __enter__(self) -> "_Digests":
        self._pool = ThreadPoolExecutor(1)
        self._made = self._pool.submit(digests, self._path, self._wait)
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._idle.set()
        self._pool.shutdown()

    def during(self, advance: Advance) -> Advance:
        """Return ``advance``, which from then on also says when frames are being read."""

        def watched(share: float) -> None:
            (self._idle.clear if LOADED < share < 1 else self._idle.set)()
            advance(share)

        return watched

    def result(self) -> dict[str, str]:
        """Return them once they are made."""
        self._idle.set()
        return self._made.result()

    def _wait(self) -> None:
        self._idle.wait()
        if self._stop.is_set():
            raise CancelledError


def open_side(path: Path, *, modality: str | None, settings: Mapping[str, object], device: Device = "cpu") -> Opened:
    """Open the recording at ``path`` without unrolling it.

    ``settings`` holds keys of its sidecar and of its plug-in's parameters; ``device`` is where to compute what the
    plug-in can compute elsewhere than on the CPU. Raises :class:`EndoctError` where the recording, its sidecar or a
    setting cannot be used.
    """
    return _opened(path, state_of(path), modality, settings, device)


def unroll_path(
    path: Path, stages: Stages, *, modality: str | None, settings: Mapping[str, object], device: Device = "cpu"
) -> Unrolled:
    """Open the recording at ``path``, as :func:`open_side` does, and unroll it.

    Raises what these raise. Its digests are begun before libraries are loaded.
    """
    files = state_of(path)  # taken before any of it is read
    with _Digests(path) as inputs:
        return _unroll(_opened(path, files, modality, settings, device), inputs, stages)


def unroll_recording(opened: Opened, stages: Stages, label: str = "") -> Unrolled:
    """Survey, unroll and settle an opened recording.

    ``label`` tells apart the stages of two recordings. Raises :class:`EndoctError` where it shows no bore wall, or its
    files were changed since it was opened.
    """
    with _Digests(opened.path) as inputs:
        return _unroll(opened, inputs, stages, label)


def _opened(path: Path, files: State, modality: str | None, settings: Mapping[str, object], device: Device) -> Opened:
    overrides, parameters = split(settings, manifest_for(path, modality))
    manifest, stream = open_recording(path, modality=modality, overrides=overrides, device=device)
    return Opened(path, files, manifest, stream, parameters, device)


def _unroll(opened: Opened, inputs: _Digests, stages: Stages, label: str = "") -> Unrolled:
    manifest, stream, parameters = opened.manifest, opened.stream, opened.parameters
    title = f"{label} {manifest.name}".strip()
    implementation = manifest.load(opened.device)
    with _read_once(implementation, stream, parameters) as frames:
        with stages.stage(f"survey {title}") as advance:
            calibration = implementation.survey(_Watched(frames, inputs.during(advance)), parameters)
        give_back()
        with stages.stage(f"unroll {title}") as advance:
            strips = thread_map(partial(implementation.unroll, calibration=calibration), _Watched(frames, advance))
            blended = assemble(
                strips,
                calibration,
                manifest,
                provenance={
                    "parameters": parameters.model_dump(mode="json"),
                    "acquisition": stream.acquisition.model_dump(mode="json", exclude_none=True),
                    **_made_with(opened.device),
                },
            )
        with stages.stage(f"settle {title}"):
            settled = implementation.settle(blended, calibration)
        panorama = replace(
            settled,
            axial_scale=stream.acquisition.axial_scale,
            provenance={**settled.provenance, "inputs": inputs.result()},
        )
    give_back()
    check_unchanged(opened.path, opened.files)
    if not panorama.valid.any():
        raise NotSeen(
            f"nothing of the wall could be seen in {opened.path}",
            found=" ".join([*(doubt.what for doubt in panorama.doubts), *panorama.notes]).rstrip(".")
            or "no valid sample in the panorama",
            expected="a recording of a bore wall",
            remedy=f"look at the {manifest.frame_dim}s",
        )
    remarks = remarks_of(stream)
    panorama = replace(
        panorama,
        doubts=(*remarks.doubts, *panorama.doubts, *doubts_of_observed(panorama)),
        notes=(*remarks.notes, *panorama.notes),
    )
    return Unrolled(panorama, manifest, stream, calibration)


def _made_with(device: Device) -> dict[str, object]:
    """Return the versions that a panorama depends on and, where it is not the CPU, the device that was asked for."""
    return {"versions": versions()} if device == "cpu" else {"versions": versions("torch"), "device": device}


def _read_once(
    implementation: Modality[Any, Any], stream: FrameStream, parameters: Any
) -> AbstractContextManager[FrameStream]:
    """Give ``stream``, or what the plug-in keeps of its frames, where it offers that."""
    if not hasattr(implementation, "reading_once"):
        return nullcontext(stream)
    return cast(ReadingOnce[Any, Any], implementation).reading_once(stream, parameters)


def write_volume(unrolled: Unrolled, store: Path, stages: Stages) -> None:
    """Write the group ``volume`` into ``store``. Raises :class:`EndoctError` where the modality has none."""
    if "volume" not in unrolled.manifest.provides:
        raise EndoctError(
            f"the modality '{unrolled.manifest.name}' has no volume", remedy="leave out volume=True for this recording"
        )
    implementation = cast(VolumetricModality[Any, Any], unrolled.manifest.load())
    with stages.stage("volume") as advance:
        implementation.write_volume(_Watched(unrolled.stream, advance), unrolled.calibration, store)
