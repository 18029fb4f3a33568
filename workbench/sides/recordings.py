"""Open one recording of any modality, and unroll it into a panorama."""

from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from endoct.base.compute.memory import give_back
from endoct.base.compute.parallel import thread_map
from endoct.base.errors import NotSeen
from endoct.base.files.files import State, check_unchanged, digests, state_of
from endoct.fusion.evidence.depth_against_light import with_depth_against_light
from endoct.modalities.acquisition import Acquisition
from endoct.modalities.assembly import assemble
from endoct.modalities.contract import (
    Calibration,
    Frame,
    FrameStream,
    Manifest,
    Modality,
    ParallaxModality,
    ReadingOnce,
    StreamOver,
)
from endoct.modalities.reading.remarks import remarks_of
from endoct.modalities.recognition import recognise
from endoct.stitching.panorama import TRAVEL_BY_DEFAULT, Panorama, doubts_of_observed
from endoct.workbench.running.outputs import versions
from endoct.workbench.running.progress import Advance, Stages
from endoct.workbench.running.scheduler import in_background
from endoct.workbench.settings import split
from endoct.workbench.sides.recipes import with_recipe

if TYPE_CHECKING:  # else the process that unrolls the second side would load what reads command lines
    from endoct.workbench.requests import RecipeName


@dataclass(frozen=True)
class Recording:
    """A recording that is known to be readable, with how to process it, and its files as they were."""

    path: Path
    files: State
    manifest: Manifest
    stream: FrameStream
    parameters: Any


@dataclass(frozen=True)
class Unrolled:
    """A recording's panorama, and how the recording was surveyed, for pictures of single frames and for volumes."""

    recording: Recording
    panorama: Panorama
    calibration: Calibration


class Watched(StreamOver):
    """A stream that reports the share of it that has been read."""

    def __init__(self, stream: FrameStream, advance: Advance) -> None:
        self.stream, self._advance, self._read = stream, advance, 0

    def __getitem__(self, index: int) -> Frame:
        frame = self.stream[index]
        self._read += 1
        self._advance(min(1.0, self._read / len(self.stream)))
        return frame


def open_recording(
    path: Path,
    *,
    modality: str | None = None,
    recipe: "RecipeName | None" = None,
    settings: Mapping[str, object] | None = None,
) -> Recording:
    """Open the recording at ``path`` without unrolling it.

    ``settings`` holds keys of its sidecar and of its plug-in's parameters, in place of those of the ``recipe``. Raises
    :class:`EndoctError` where the recording, its sidecar, the recipe or a setting cannot be used.
    """
    files = state_of(path)  # taken before any of it is read
    recognised = recognise(path, modality)
    manifest = recognised.manifest
    overrides, parameters = split(with_recipe(recipe, manifest.name, settings or {}), manifest)
    return Recording(path, files, manifest, recognised.open(overrides), parameters)


def _travel_by_default(acquisition: Acquisition) -> Mapping[str, str]:
    """Return which way the instrument was taken to have moved, where nothing but a default says so."""
    by_default = "travel" not in acquisition.model_fields_set and acquisition.travel != "unknown"
    return {TRAVEL_BY_DEFAULT: acquisition.travel} if by_default else {}


def unroll_recording(recording: Recording, stages: Stages, label: str = "") -> Unrolled:
    """Survey, unroll and settle a recording.

    ``label`` tells apart the stages of two recordings. Raises :class:`EndoctError` where it shows no bore wall, or its
    files were changed since it was opened.
    """
    manifest, stream, parameters = recording.manifest, recording.stream, recording.parameters
    title = f"{label} {manifest.name}".strip()
    implementation = manifest.load()
    with (
        in_background(partial(digests, recording.path)) as inputs,
        _read_once(implementation, stream, parameters) as frames,
    ):
        with stages.stage(f"survey {title}") as advance:
            calibration = implementation.survey(Watched(frames, advance), parameters)
        give_back()
        with stages.stage(f"unroll {title}") as advance:
            strips = thread_map(partial(implementation.unroll, calibration=calibration), Watched(frames, advance))
            blended = assemble(
                strips,
                calibration,
                manifest,
                provenance={
                    "parameters": parameters.model_dump(mode="json"),
                    "acquisition": stream.acquisition.model_dump(mode="json", exclude_none=True),
                    **_travel_by_default(stream.acquisition),
                    "versions": versions(),
                },
            )
        if hasattr(implementation, "add_depth"):
            with stages.stage(f"depth {title}") as advance:
                parallax = cast(ParallaxModality[Any, Any], implementation)
                deep = parallax.add_depth(blended, Watched(frames, advance), calibration, parameters)
                blended = with_depth_against_light(deep)
        with stages.stage(f"settle {title}"):
            settled = implementation.settle(blended, calibration)
        panorama = replace(
            settled,
            axial_scale=stream.acquisition.axial_scale,
            provenance={**settled.provenance, "inputs": inputs.result()},
        )
    give_back()
    check_unchanged(recording.path, recording.files)
    if not panorama.valid.any():
        raise NotSeen(
            f"nothing of the wall could be seen in {recording.path}",
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
    return Unrolled(recording, panorama, calibration)


def _read_once(
    implementation: Modality[Any, Any], stream: FrameStream, parameters: Any
) -> AbstractContextManager[FrameStream]:
    """Give ``stream``, or what the plug-in keeps of its frames, where it offers that."""
    if not hasattr(implementation, "reading_once"):
        return nullcontext(stream)
    return cast(ReadingOnce[Any, Any], implementation).reading_once(stream, parameters)
