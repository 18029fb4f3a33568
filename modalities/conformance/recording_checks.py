"""Checks of what a plug-in says of itself, and of how it reads recordings."""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import entry_points
from pathlib import Path
from typing import get_args

import numpy as np

from endoct.base.errors import EndoctError
from endoct.modalities.acquisition import Acquisition
from endoct.modalities.conformance.subject import (
    NotConforming,
    Subject,
    demand,
    only_endoct_errors,
    pickled,
    refusal_allowed,
    same,
)
from endoct.modalities.contract import Channel, FrameStream, Sniff

HEAVY = ("torch", "cv2")
"""A manifest must not import these."""

LONGEST_S = 120.0
"""Importing a manifest takes a second, on a busy machine some."""

OPENING_SLACK_BYTES = 16 * 2**20
"""Opening may take this much memory besides the first frame and its conversions."""


def manifest_is_complete(subject: Subject) -> None:
    """Every field of the manifest says something, and every key of the sidecar says why it matters."""
    manifest = subject.manifest
    for field in ("name", "frame_dim"):
        value = getattr(manifest, field)
        demand(re.fullmatch(r"[a-z][a-z0-9_]*", value), f"{field} is {value!r}, not a lower-case identifier")
    demand(manifest.title.strip(), "the title is empty")
    demand(manifest.suffixes, "no suffix is named")
    for suffix in manifest.suffixes:
        demand(suffix.startswith(".") and suffix == suffix.lower(), f"suffix {suffix!r} is not like '.tif'")
    unknown = manifest.provides - set(get_args(Channel))
    demand(manifest.provides and not unknown, f"provides {sorted(manifest.provides)}")
    demand(issubclass(manifest.acquisition, Acquisition), "the sidecar's model is not derived from Acquisition")
    for key, about in manifest.acquisition.model_fields.items():
        demand(about.description, f"the sidecar key '{key}' has no description")


def manifest_is_light(subject: Subject) -> None:
    """Importing the manifest loads neither torch nor OpenCV."""
    entries = entry_points(group="endoct.modalities", name=subject.manifest.name)
    modules = sorted({entry.module for entry in entries} | {subject.manifest.acquisition.__module__})
    script = f"import sys, {', '.join(modules)}; print(*sys.modules.keys() & {set(HEAVY)})"
    try:
        run = subprocess.run(
            [sys.executable, "-c", script],
            capture_output=True,
            text=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
            check=False,
            timeout=LONGEST_S,
        )
    except subprocess.TimeoutExpired as error:
        raise NotConforming(f"importing {', '.join(modules)} has no end within {LONGEST_S:g} s") from error
    demand(run.returncode == 0, f"{', '.join(modules)} cannot be imported: {run.stderr.strip()[-300:]}")
    demand(not run.stdout.strip(), f"importing {', '.join(modules)} loads {run.stdout.strip()}")


def sniff_claims_its_own(subject: Subject) -> None:
    """The plug-in claims the recording, without reading it all."""
    _sniffed(subject, subject.recording)  # libraries and compiled code that are loaded at first do not count
    with _little_memory(subject, "sniffing"):
        sniff = _sniffed(subject, subject.recording)
    demand(sniff.claims, f"{subject.recording} is declined: {sniff.reason}")


def sniff_declines_with_a_reason(subject: Subject) -> None:
    """What is no recording is declined with a reason, and never raises."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "empty").mkdir()
        (folder / "letters").mkdir()
        for text in (folder / "letter.txt", folder / "letters" / "letter.txt"):
            text.write_text("Dear reader, this is no recording.\n", encoding="utf-8")
        (folder / "nothing.txt").touch()
        for path in (*sorted(folder.iterdir()), folder / "missing"):
            sniff = _sniffed(subject, path)
            demand(not sniff.claims, f"{path.name} is claimed: {sniff.reason}")
            demand(sniff.reason.strip(), f"{path.name} is declined without a reason")


def opening_reads_no_samples(subject: Subject) -> None:
    """Opening holds no more than the first frame in memory."""
    with _little_memory(subject, "opening"):
        subject.open()


def stream_is_a_sequence(subject: Subject) -> None:
    """The stream is sized, indexable in any order, ends with IndexError, and gives the same frame every time."""
    stream = subject.stream
    demand(len(stream) > 0, "the stream is empty")
    demand(
        isinstance(stream.acquisition, subject.manifest.acquisition), "the stream's acquisition is no checked sidecar"
    )
    last, first, again = stream[len(stream) - 1], stream[0], stream[len(stream) - 1]
    demand((first.index, last.index) == (0, len(stream) - 1), "a frame's index is not its place in the stream")
    demand(np.isfinite([first.z_mm, last.z_mm]).all(), "a frame's z_mm is not finite")
    demand(same(last.samples, again.samples), "reading a frame twice gives different samples")
    try:
        stream[len(stream)]
    except IndexError:
        return
    raise NotConforming("indexing past the last frame does not raise IndexError")


def travel_turns_z_around(subject: Subject) -> None:
    """Frames lie inward from the mouth; a recording that travelled the other way has the same places in reverse."""
    inward, outward = (
        np.array([stream[index].z_mm for index in range(len(stream))])
        for stream in (subject.open(travel="in"), subject.open(travel="out"))
    )
    demand(inward.min() == 0 and outward.min() == 0, "the frame nearest the mouth is not at z = 0")
    demand(np.allclose(inward + outward, inward.max(), rtol=0, atol=1e-9), "travel in and out do not mirror z")


def stream_is_picklable(subject: Subject) -> None:
    """A worker process gets the same frames."""
    copy: FrameStream = pickled(subject.stream, "the stream")
    demand(len(copy) == len(subject.stream), "a pickled stream has another length")
    demand(same(copy[0].samples, subject.stream[0].samples), "a pickled stream gives other samples")


def frames_are_read_only(subject: Subject) -> None:
    """Nobody can change a frame's samples."""
    for index in subject.strips:
        demand(not subject.stream[index].samples.flags.writeable, f"frame {index} can be written to")


def bad_files_raise_endoct_errors(subject: Subject) -> None:
    """A missing, empty, foreign or truncated recording is refused with an EndoctError that fits one line."""
    acquisition = subject.stream.acquisition
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "empty").mkdir()
        unusable = [folder / "missing", folder / "empty"]
        for suffix in subject.manifest.suffixes:
            (folder / f"empty{suffix}").touch()
            (folder / f"foreign{suffix}").write_text("Dear reader, this is no recording.\n", encoding="utf-8")
            unusable += [folder / f"empty{suffix}", folder / f"foreign{suffix}"]
        for path in unusable:
            try:
                with only_endoct_errors(path.name):
                    subject.modality.open(path, acquisition)[0]
            except EndoctError as error:
                demand("\n" not in str(error), f"the error for {path.name} is longer than one line")
            else:
                raise NotConforming(f"{path.name} can be opened")
        truncated = _truncated_copy(subject.recording, folder / "truncated")
        with only_endoct_errors("a truncated recording"), refusal_allowed():
            stream = subject.modality.open(truncated, acquisition)
            for index in range(len(stream)):
                stream[index]


def _sniffed(subject: Subject, path: Path) -> Sniff:
    try:
        return subject.modality.sniff(path)
    except Exception as error:
        raise NotConforming(f"sniffing {path.name} raises {type(error).__name__}: {error}") from error


@contextmanager
def _little_memory(subject: Subject, doing: str) -> Iterator[None]:
    limit = 4 * subject.stream[0].samples.nbytes + OPENING_SLACK_BYTES
    tracemalloc.start()
    try:
        yield
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    demand(peak <= limit, f"{doing} holds {peak >> 20} MiB in memory, more than the {limit >> 20} MiB of a few frames")


def _truncated_copy(recording: Path, target: Path) -> Path:
    """Copy the recording (to ``target``, keeping a file's suffix), its largest file cut in half."""
    if recording.is_dir():
        shutil.copytree(recording, target)
        largest = max((path for path in target.rglob("*") if path.is_file()), key=lambda path: path.stat().st_size)
    else:
        target = largest = target.with_suffix(recording.suffix)
        shutil.copyfile(recording, target)
    os.truncate(largest, largest.stat().st_size // 2)
    return target
