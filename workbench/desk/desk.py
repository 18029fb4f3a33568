"""What the page of `endoct open` can do: open folders, list what lies in them, edit sidecars, and queue commands.

What may be read and written is what lies in the folders that were opened. A name in a request is looked up among what
was found there; a path in a form has to lead below the folder.
"""

import hashlib
import os
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.parse import quote

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import entries, exists, is_folder, leads_below, path_text, read_small
from endoct.modalities.acquisition import sidecar_path
from endoct.modalities.recognition import recognise
from endoct.workbench.desk.forms import Command, arguments_of, form_of
from endoct.workbench.desk.runs import command_line
from endoct.workbench.desk.sidecar_form import Previewer, SidecarForm, sidecar_form
from endoct.workbench.desk.state import State
from endoct.workbench.desk.study import Study
from endoct.workbench.kinds import output_at
from endoct.workbench.page.collection import ListedOutput, address_of, thumbnail
from endoct.workbench.page.notes import read_note, write_note
from endoct.workbench.page.serving import Collection
from endoct.workbench.page.wall import NoSuchTile
from endoct.workbench.pipeline.information import picture_of
from endoct.workbench.running.outputs import POSE, SUMMARY

REPORT_BYTES = 200_000_000
MOST_LISTED = 2000
"""Folders that are listed of a folder."""


class OpenFolder:
    """A folder that was opened: what lies in it, its results, and the pages of these, all below ``address``."""

    def __init__(self, folder: Path, root: str) -> None:
        self.study = Study(folder)
        self.key = key_of(self.study.folder)
        self.address = f"{root}/f/{self.key}/"
        self.results = Collection(self.study.folder, above=self.address, pages=f"{self.address}at", runs=True)

    @property
    def folder(self) -> Path:
        """Where it lies."""
        return self.study.folder

    def results_json(self) -> dict[str, Any]:
        """Look into the folder again and return its results for the page."""
        version, entries = self.results.look()
        return {"entries": [self._entry(each, number, version) for number, each in enumerate(entries)]}

    def thumbnail(self, version: str, number: int) -> bytes:
        """Return a PNG of a result by its place in that version of the list."""
        return thumbnail(self.results.entry(version, number))

    def report(self, name: str) -> bytes:
        """Return the report of a pose or a summary, which have no page.

        Raises :class:`NoSuchTile` where there is none.
        """
        place = self.folder / name
        path = place / "report.html"
        there = leads_below(self.folder, place) and exists(place) and output_at(place) in (POSE, SUMMARY)
        if not there or path.is_symlink() or not path.is_file():
            raise NoSuchTile("there is no such report", found=name[:80])
        return read_small(path, REPORT_BYTES)

    def note(self, posted: Mapping[str, Any]) -> dict[str, str]:
        """Save a posted note on a result and return it.

        Raises :class:`NoSuchTile` where there is no such result, and :class:`EndoctError` where it cannot be saved.
        """
        self.results.ensure_looked()
        entry = self.results.called(posted.get("name"))
        if entry is None or not is_folder(entry.path) or not leads_below(self.folder, entry.path):
            raise NoSuchTile("there is no such result", found=repr(posted.get("name"))[:80])
        return {"note": write_note(entry.path, posted.get("text"), posted.get("was"))}

    def _entry(self, entry: ListedOutput, number: int, version: str) -> dict[str, Any]:
        compared = self.study.named_by(entry.inputs, entry.path)
        has_report = entry.row.name == SUMMARY and not entry.fault
        address = f"report?name={quote(os.fsencode(entry.name))}" if has_report else ""
        as_they_are = "kind", "level", "headline", "jaccard", "interval", "written", "fault"
        return {
            **{name: getattr(entry, name) for name in as_they_are},
            "name": path_text(entry.name),
            "about": entry.what,
            "doubts": [doubt.what for doubt in entry.doubts],
            "steps": [self._step(step, entry.path) for step in entry.steps],
            "of": [path_text(each.name) for each in compared],
            "changed": any(each.changed_since(entry.path / "result.json") for each in compared),
            "note": read_note(entry.path),
            "address": address_of(entry, self.results.pages) if entry.can_be_opened else address,
            "thumbnail": "" if entry.fault else f"thumbnails/{version}/{number}.png",
        }

    def _step(self, step: Mapping[str, Any], result: Path) -> dict[str, Any]:
        """Return a step for the page, with paths as its forms have them."""
        values = dict(step.get("values", {}))
        values |= {name: self._name_of(values[name], result) for name in {"a", "b", "session"} & values.keys()}
        return {**step, "recording": self._name_of(step["recording"], result)} | ({"values": values} if values else {})

    def _name_of(self, path: str, result: Path) -> str:
        """Return a path that a command was given as one below the folder, where it leads there; else as it is."""
        if path and (given := self.study.input_of(path, result)):
            return path_text(given.name)
        place = self.folder / path
        return place.relative_to(self.folder).as_posix() if path and place.is_relative_to(self.folder) else path


class Desk:
    """The folders that are open, the queue, and the forms of the ``commands``; all below the address ``root``."""

    def __init__(self, state: State, commands: Mapping[str, Command]) -> None:
        self.state = state
        self.root = f"/{state.token}"
        self.forms = {name: form_of(name, command) for name, command in commands.items()}
        self.previewer = Previewer()
        self._folders: dict[str, OpenFolder] = {}
        self._lock = threading.Lock()

    def open(self, folder: Path) -> OpenFolder:
        """Open a folder and return it. Raises :class:`EndoctError` where there is none."""
        if not is_folder(folder):
            raise EndoctError(f"{folder} cannot be opened", found="no folder", remedy="check the path")
        opened = OpenFolder(folder, self.root)
        with self._lock:
            kept = self._folders.setdefault(opened.key, opened)
            self.state.remember(kept.folder)
        kept.study.look()
        return kept

    def folder(self, key: str) -> OpenFolder:
        """Return the open folder of an address; one that was opened lately is opened again.

        Raises :class:`NoSuchTile` where there is none.
        """
        if key not in self._folders:
            recent = next((each.folder for each in self.state.recent() if key_of(each.folder) == key), None)
            if recent is None:
                raise NoSuchTile("that folder is not open", remedy="open it on the start page")
            return self.open(recent)
        return self._folders[key]

    def recent_json(self) -> list[dict[str, str]]:
        """Return the folders that were opened lately, for the page."""
        return [
            {
                "folder": path_text(each.folder),
                "opened": each.opened,
                "address": f"{self.root}/f/{key_of(each.folder)}/",
            }
            for each in self.state.recent()
        ]

    def listed(self, text: str) -> dict[str, Any]:
        """Return the folders in the folder ``text``, the user's home where it is empty, to choose one to open.

        Raises :class:`EndoctError` where it cannot be listed.
        """
        folder = whole_path(text or str(Path.home()))
        if not is_folder(folder):
            raise EndoctError(f"{folder} cannot be listed", found="no folder", expected="the whole path of one")
        names = [path.name for path in entries(folder) if is_folder(path) and path_text(path) == str(path)]
        return {"folder": str(folder), "above": str(folder.parent), "names": sorted(names)[:MOST_LISTED]}

    def command(self, folder: OpenFolder, posted: Mapping[str, Any]) -> dict[str, str]:
        """Return the command line that a posted form stands for, as a person would type it.

        Raises :class:`EndoctError` where it stands for none.
        """
        return {"command": command_line(self._arguments(folder, posted))}

    def run(self, folder: OpenFolder, posted: Mapping[str, Any]) -> dict[str, str]:
        """Queue the command that a posted form stands for, and return the name of the run.

        Raises :class:`EndoctError` where it stands for none, or cannot be queued.
        """
        return {"name": self.state.queue.add(self._arguments(folder, posted), folder.folder)}

    def sidecar(self, folder: OpenFolder, name: str, modality: str | None) -> dict[str, Any]:
        """Return the form of a recording's sidecar. Raises :class:`EndoctError` where there can be none."""
        return _form(folder, name, modality).to_json()

    def save_sidecar(self, folder: OpenFolder, posted: Mapping[str, Any]) -> dict[str, Any]:
        """Save a posted sidecar and return what the recording is now.

        Raises :class:`EndoctError` where it cannot be used, or was changed meanwhile.
        """
        name, modality, texts = _posted_sidecar(posted)
        based_on = posted.get("based_on")
        _form(folder, name, modality).save(texts, based_on if isinstance(based_on, str) else None)
        return folder.study.renew(name).to_json()

    def preview(self, folder: OpenFolder, posted: Mapping[str, Any]) -> dict[str, Any]:
        """Return what a frame looks like as a posted sidecar has it. Raises :class:`EndoctError` for nonsense."""
        name, modality, texts = _posted_sidecar(posted)
        share = posted.get("share", 0.5)
        share = float(share) if isinstance(share, int | float) and 0 <= share <= 1 else 0.5
        return self.previewer.preview(folder.study.input(name).path, modality, texts, share)

    def picture(self, folder: OpenFolder, name: str) -> bytes:
        """Return a PNG of some frames of a recording. Raises :class:`EndoctError` where there is none."""
        return picture_of(recognise(folder.study.input(name).path))

    def _arguments(self, folder: OpenFolder, posted: Mapping[str, Any]) -> tuple[str, ...]:
        name, values = posted.get("command"), posted.get("values")
        if not isinstance(name, str) or name not in self.forms or not isinstance(values, dict):
            raise EndoctError("there is no such command", found=repr(name)[:40], expected=", ".join(self.forms))
        return arguments_of(self.forms[name], values, folder.folder)


def whole_path(text: object) -> Path:
    """Return the folder that a whole path names; "~" is the user's home. Raises :class:`EndoctError` for others."""
    with refusing(f"{text} cannot be opened", expected="the whole path of a folder"):
        path = Path(text if isinstance(text, str) else "").expanduser()
        if not path.is_absolute() or not str(path).isprintable():
            raise EndoctError(f"{text} cannot be opened", expected="the whole path of a folder")
        return path.resolve()


def _form(folder: OpenFolder, name: str, modality: str | None) -> SidecarForm:
    """Return the form of a sidecar. Raises :class:`EndoctError` where that lies elsewhere, by a link."""
    recording = folder.study.input(name).path
    sidecar = sidecar_path(recording)
    if sidecar.is_symlink() or not leads_below(folder.folder, sidecar):
        raise EndoctError(f"{sidecar} is a link", remedy="edit the file that it leads to, or put a copy in its place")
    return sidecar_form(recording, modality)


def key_of(folder: Path) -> str:
    """Return the part of an address that stands for ``folder``."""
    return hashlib.sha256(os.fsencode(folder)).hexdigest()[:16]


def _posted_sidecar(posted: Mapping[str, Any]) -> tuple[str, str | None, Mapping[str, object]]:
    name, modality, texts = posted.get("name"), posted.get("modality"), posted.get("texts")
    if not isinstance(name, str) or not isinstance(texts, dict) or not isinstance(modality, str | None):
        raise EndoctError("that is no sidecar", expected="name, modality and texts")
    return name, modality or None, texts
