"""A folder that is open: the recordings, CTs and plans that lie in it, looked for by a thread, and their pairs.

A recording is known by its content, as `endoct info` knows it. What endoct wrote is no input, but for specimens.
"""

import os
import threading
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from endoct.base.errors import EndoctError
from endoct.base.files.files import exists, inside, leads_below, path_text, read_start
from endoct.modalities.acquisition import SIDECAR_NAME, sidecar_path
from endoct.modalities.ct.ct_volume import is_volume
from endoct.modalities.ct.trajectory import is_plan
from endoct.modalities.reading.recording import gives_frames
from endoct.modalities.recognition import recognise
from endoct.modalities.registry import manifests
from endoct.workbench.kinds import KINDS, is_mask, places_in
from endoct.workbench.page.wall import NoSuchTile
from endoct.workbench.pipeline.information import describe_recording
from endoct.workbench.pipeline.unread import MOST_ASKED, Unread, accompanies
from endoct.workbench.running.interruption import stop_at_the_end
from endoct.workbench.running.outputs import POSE, SPECIMEN

FoundKind = Literal["recording", "volume", "plan", "pose"]
MOST_INPUTS = 1000
MOST_IN_FOLDER = 10_000
"""More files of a folder are looked at only where a sidecar says that they are a recording."""
MOST_FILES = 40
"""Files of a folder that are looked at one by one, where the folder as a whole is no recording."""
VOLUME_SUFFIXES = (".nrrd", ".nhdr", ".nii", ".nii.gz", ".mha", ".mhd")
PLAN_SUFFIX = ".mrk.json"


@dataclass(frozen=True)
class Input:
    """What a command can read: ``name`` is its path below the folder with "/", ``facts`` what `endoct info` says.

    ``fault`` says why it cannot be read, "" where it can.
    """

    name: str
    path: Path
    kind: FoundKind
    facts: dict[str, Any] = field(default_factory=dict)
    fault: str = ""

    @property
    def modality(self) -> str:
        """The plug-in that reads a recording, "" of anything else."""
        return str(self.facts.get("modality", ""))

    @property
    def parent(self) -> str:
        """The folder it lies in, as ``name`` has it."""
        return self.name.rpartition("/")[0]

    def changed_since(self, result: Path) -> bool:
        """Whether a file of it, or its sidecar, is younger than ``result``."""
        files = [self.path, sidecar_path(self.path)]
        with suppress(OSError):  # gone, or somebody else's
            files += [Path(each.path) for each in os.scandir(self.path)] if self.path.is_dir() else []
            made_ns = result.stat().st_mtime_ns
            return any(file.is_file() and file.stat().st_mtime_ns > made_ns for file in files)
        return False

    def to_json(self) -> dict[str, Any]:
        """Return the input for the page."""
        return {"name": path_text(self.name), "kind": self.kind, "facts": self.facts, "fault": self.fault}


class Study:
    """The folder ``folder`` and what was found in it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder.resolve()
        self._inputs: dict[str, Input] = {}
        self._lock = threading.Lock()
        self._looking: threading.Thread | None = None
        self._fault = ""
        self._unread = Unread()

    def look(self) -> None:
        """Begin to look through the folder, unless that is under way."""
        with self._lock:
            if self._looking is None or not self._looking.is_alive():
                self._looking = threading.Thread(target=self._look)  # no daemon: see Reader.start
                self._looking.start()

    def inputs(self) -> tuple[Input, ...]:
        """Return what was found so far, by name."""
        with self._lock:
            return tuple(sorted(self._inputs.values(), key=lambda each: each.name))

    def input(self, name: str) -> Input:
        """Return what was found under ``name``, or is found there now. Raises :class:`NoSuchTile` where nothing is."""
        with self._lock:
            if name in self._inputs:
                return self._inputs[name]
        recording = None
        with suppress(EndoctError, OSError, ValueError):  # no file can have such a name
            path = self.folder if name == "." else inside(self.folder, name, "a recording")
            recording = _recording(self.folder, path) if leads_below(self.folder, path) else None
        if recording is None:
            raise NoSuchTile(
                "there is no such recording in the folder", found=name[:80], remedy="look through it again"
            )
        with self._lock:
            return self._inputs.setdefault(name, recording)

    def renew(self, name: str) -> Input:
        """Look at one input again, as its sidecar was changed, and return what it is now."""
        before = self.input(name)
        now = _recording(self.folder, before.path) or before
        with self._lock:
            self._inputs[name] = now
        return now

    def named_by(self, files: Iterable[str], result: Path) -> list[Input]:
        """Return the recordings to which ``files`` belong, as the ``result`` below this folder names them."""
        recordings = [each for each in self.inputs() if each.kind == "recording"]
        names = {name for file in map(Path, files) for name in (file, file.parent)}
        for at in self._where_it_ran(result):
            paths = {at / name for name in names}
            if found := [recording for recording in recordings if recording.path in paths]:
                return found
        return []

    def input_of(self, path: str, result: Path) -> Input | None:
        """Return what a command that wrote ``result`` was given as ``path``, if it lies in this folder."""
        places = [at / path for at in self._where_it_ran(result)]
        by_path = {each.path: each for each in self.inputs()}
        return next((by_path[place] for place in places if place in by_path), None)

    def _where_it_ran(self, result: Path) -> tuple[Path, ...]:
        """Return where the command of ``result`` may have run: the page's run here, in a terminal somewhere above."""
        return (self.folder, result, *result.parents)

    def pairs(self) -> list[tuple[Input, Input]]:
        """Return the recordings of two instruments that lie alone in one folder, by the instruments' names."""
        by_parent: dict[str, dict[str, list[Input]]] = {}
        for each in self.inputs():
            if each.kind == "recording" and not each.fault:
                by_parent.setdefault(each.parent, {}).setdefault(each.modality, []).append(each)
        alone = [found for found in by_parent.values() if all(len(each) == 1 for each in found.values())]
        pairs = (tuple(found[name][0] for name in sorted(found)) for found in alone)
        return [(pair[0], pair[1]) for pair in pairs if len(pair) == 2]

    def to_json(self) -> dict[str, Any]:
        """Return the study for the page; ``looking``: more may be found."""
        looking = self._looking is not None and self._looking.is_alive()
        return {
            "folder": path_text(self.folder),
            "looking": looking,
            "fault": self._fault,
            "inputs": [each.to_json() for each in self.inputs()],
            "unread": self._unread.to_json(),
            "pairs": [[path_text(a.name), path_text(b.name)] for a, b in self.pairs()],
        }

    def _look(self) -> None:
        fault, names, unread = "", set(), Unread()
        try:
            for each in inputs_in(self.folder, unread):
                stop_at_the_end()
                names.add(each.name)
                with self._lock:
                    self._inputs[each.name] = each
                if len(names) >= MOST_INPUTS:
                    fault = f"There is more in this folder: {MOST_INPUTS} inputs are listed at most."
                    break
        except (EndoctError, OSError) as error:
            fault = str(error)
        with self._lock:
            self._fault, self._unread = fault, unread
            self._inputs = {name: each for name, each in self._inputs.items() if name in names}


def inputs_in(folder: Path, unread: Unread) -> Iterator[Input]:
    """Yield what commands can read in ``folder``, itself included.

    ``unread`` gets the files that nothing reads; those beside frames are among the facts of their recording. Raises
    :class:`EndoctError` where there is more than anybody could look through.
    """
    for place in places_in(folder):
        name = place.path.relative_to(folder).as_posix()
        # names that are no text cannot be asked for again
        place.folders[:] = [path for path in place.folders if path_text(path.name) == path.name]
        files = [path for path in place.files if path_text(path.name) == path.name]
        if place.output == POSE:
            yield Input(name, place.path, "pose")
        if place.output is not None and (not (row := KINDS.get(place.output)) or not row.has_recordings):
            place.folders.clear()
        elif len(files) > MOST_IN_FOLDER and not exists(place.path / SIDECAR_NAME):
            why = f"not looked at: {len(files)} files lie in its folder, and no {SIDECAR_NAME}"
            for path in files:
                unread.add(path.relative_to(folder).as_posix(), path, why)
        elif files and not exists(place.path / SIDECAR_NAME) and is_volume(place.path):
            yield Input(name, place.path, "volume")
        elif (recording := _recording(folder, place.path)) is not None:
            place.folders.clear()
            yield recording
        else:
            yield from _single_files(folder, files, unread)
        if place.output == SPECIMEN:
            place.folders[:] = [path for path in place.folders if path.name != "truth"]


def _recording(folder: Path, path: Path) -> Input | None:
    """Return the recording at ``path``; None where there is none."""
    name = path.relative_to(folder).as_posix()
    try:
        recognised = recognise(path)
    except EndoctError as error:
        has_sidecar = path.is_dir() and exists(path / SIDECAR_NAME)
        return Input(name, path, "recording", fault=str(error)) if has_sidecar else None
    try:
        return Input(name, path, "recording", describe_recording(recognised))
    except EndoctError as error:
        return Input(name, path, "recording", fault=str(error))


def _single_files(folder: Path, files: list[Path], unread: Unread) -> Iterator[Input]:
    suffixes = {suffix for manifest in manifests().values() for suffix in manifest.suffixes}
    looked_at = 0
    for asked, path in enumerate(files):
        lower, name = path.name.lower(), path.relative_to(folder).as_posix()
        if accompanies(path):
            continue
        if lower.endswith(PLAN_SUFFIX) and is_plan(path):
            yield Input(name, path, "plan")
        elif lower.endswith(VOLUME_SUFFIXES) and is_volume(path):
            yield Input(name, path, "volume")
        elif looked_at >= MOST_FILES or asked >= MOST_ASKED:
            unread.add(name, path, f"not looked at: {len(files)} files lie in its folder")
        elif path.suffix.lower() in suffixes or gives_frames(path):
            looked_at += 1
            if (recording := _recording(folder, path)) is not None:
                yield recording
            elif not _is_mask(path):
                unread.add(name, path)
        elif not _is_mask(path):
            unread.add(name, path)


def _is_mask(path: Path) -> bool:
    """Whether a file is a mask drawn by hand, which is no input of its own; a table is one where it lists shapes."""
    try:
        return is_mask(path) and (path.suffix.lower() != ".csv" or b"shape-type" in read_start(path, 200))
    except (EndoctError, OSError):
        return False
