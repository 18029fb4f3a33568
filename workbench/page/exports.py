"""A result as a file for another program, asked for on its page: what `endoct export` writes, by the same function.

A second process writes it, so that what that takes of memory is given back. The file is downloaded, or stays beside
the result; it gets its name here, and nothing that exists is replaced.
"""

import shlex
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, get_args

from starlette.background import BackgroundTask
from starlette.responses import FileResponse

from endoct.base.errors import EndoctError
from endoct.base.files.contents import kind_of
from endoct.base.files.json_values import object_in
from endoct.base.files.scratch import TemporaryFolder
from endoct.workbench.exporting.formats import FORMATS, Format
from endoct.workbench.exporting.source import Exportable, open_for_export
from endoct.workbench.page.presence import Origin
from endoct.workbench.page.sessions import POSTED
from endoct.workbench.requests import ExportRequest, OmeVersion
from endoct.workbench.running.refusals import with_flags
from endoct.workbench.running.scheduler import Named, scheduler

ABOUT = {
    "color": "colour", "side": "side", "vertex_mm": "distance of vertices, mm", "voxel_mm": "size of voxels, mm",
    "version": "version of OME-Zarr", "inverse": "from A to B",
}  # fmt: skip
"""What the page calls the options of formats."""
NO, YES = "no", "yes"


@dataclass(frozen=True, eq=False)
class Exports:
    """What can be exported of the output at ``origin``; one file at a time is written."""

    origin: Origin
    _lock: threading.Lock = field(default_factory=threading.Lock, repr=False)

    def listed(self) -> dict[str, Any]:
        """Return for the page every format, what opens it and its options; ``refused``: why there is none of it.

        ``beside`` is the folder where a file may stay, "" where that is a part of another output.
        """
        source, beside = open_for_export(self.origin.folder), self._place()
        formats = [
            {
                "name": one.name,
                "suffix": one.suffixes[0],
                "opens": one.opens,
                "refused": _refused(one, source),
                "is_folder": one.is_folder,
                "options": [_option(name, one, source) for name in one.options],
            }
            for one in FORMATS.values()
        ]
        return {"formats": formats, "beside": "" if beside is None else str(beside)}

    def command(self, data: bytes) -> dict[str, str]:
        """Return the command line that a posted export stands for. Raises :class:`EndoctError` for nonsense."""
        request = self._request(data)
        given = [(name, value) for name in ABOUT if (value := getattr(request, name)) is not None]
        words = [f"--{name.replace('_', '-')}" + ("" if value is True else f"={value}") for name, value in given]
        parts = ["endoct", "export", request.path, "--to", request.to, *words, "-o", request.output]
        return {"command": shlex.join(map(str, parts))}

    def save(self, data: bytes) -> dict[str, str]:
        """Write a posted export beside the result and return where. Raises :class:`EndoctError` where it cannot be."""
        if self._place() is None:
            raise EndoctError(
                "nothing may be written there", found="a part of another output", remedy="download the file"
            )
        request = self._request(data)
        self._write(request)
        return {"saved": str(request.output)}

    def download(self, data: bytes) -> FileResponse:
        """Return a posted export as a file to send, which goes when it is sent.

        Raises :class:`EndoctError` where it cannot be written, or is a folder.
        """
        request = self._request(data)
        if FORMATS[request.to].is_folder:  # type: ignore[index]
            raise EndoctError(f"{request.to} is a folder", remedy="save it beside the result")
        folder = TemporaryFolder("export")
        made = Path(folder.name) / Path(request.output).name
        try:
            self._write(replace(request, output=made))
        except BaseException:
            folder.cleanup()
            raise
        headers = {"cache-control": "no-store"}
        done = BackgroundTask(folder.cleanup)
        return FileResponse(made, 200, headers, "application/octet-stream", done, made.name)

    def _write(self, request: ExportRequest) -> None:
        if not self._lock.acquire(blocking=False):
            raise EndoctError("another file is being exported", remedy="wait until that is done")
        try:
            with scheduler() as second:
                second.begin(Named("endoct.workbench.exporting.export:export"), request).result()
        except EndoctError as error:
            raise with_flags(error) from error
        finally:
            self._lock.release()

    def _request(self, data: bytes) -> ExportRequest:
        """Return what was posted. Raises :class:`EndoctError` for nonsense, :class:`Gone` where the output is gone."""
        self.origin.check_present()
        posted = object_in(data, POSTED)
        name, options = posted.get("format"), posted.get("options")
        if not isinstance(name, str) or name not in FORMATS:
            raise EndoctError("there is no such format", found=repr(name)[:40], expected=", ".join(FORMATS))
        chosen = FORMATS[name]
        if not isinstance(options, Mapping) or not all(key in chosen.options for key in options):
            raise EndoctError(f"{name} has other options", found=repr(options)[:80], expected=", ".join(chosen.options))
        folder = self.origin.folder.resolve()
        values = {key: _value(key, text) for key, text in options.items() if text != ""}
        return ExportRequest(folder, _free(folder, chosen.suffixes[0]), to=chosen.name, progress=False, **values)

    def _place(self) -> Path | None:
        """Return the folder of the result; None where a file in it would change another output."""
        parents = self.origin.folder.resolve().parents
        return None if any(kind_of(above) for above in parents) else parents[0]


def _free(folder: Path, suffix: str) -> Path:
    """Return a path beside ``folder`` where there is nothing."""
    stem, number = folder.name.removesuffix(".zarr"), 1
    while (path := folder.with_name(f"{stem}{'' if number == 1 else f'-{number}'}{suffix}")).exists():
        number += 1
    return path


def _refused(one: Format, source: Exportable) -> str:
    """Return why there is nothing to write in a format, "" where there is."""
    lacking = {
        "nrrd": "" if source.volume else "only of a panorama unrolled with --volume",
        "itk-transform": "" if source.alignment else "only of two sides that are aligned",
        "labels": "" if source.labels else "only of a comparison",
        "csv": "" if source.panoramas else "nothing is known per frame",
        "dicom": "" if find_spec("highdicom") else "needs highdicom: pip install 'endoct[dicom]'",
    }
    return lacking.get("nrrd" if one.name == "nifti" else one.name, "")


def _option(name: str, one: Format, source: Exportable) -> dict[str, Any]:
    """Return an option with what it can be, first what it is unless said otherwise; None: a number."""
    choices: dict[str, list[str]] = {
        "color": ["", *source.sides, "relief"],
        "side": [*source.panoramas] if one.name == "csv" else ["", *source.sides],
        "version": ["", *get_args(OmeVersion)],
        "inverse": [NO, YES],
    }
    return {"name": name, "about": ABOUT[name], "choices": choices.get(name)}


def _value(name: str, text: object) -> Any:
    """Return the value of an option that was posted as text. Raises :class:`EndoctError` for nonsense."""
    if name == "inverse" and text in (NO, YES):
        return True if text == YES else None
    if isinstance(text, str) and len(text) <= 100 and text.isprintable() and name != "inverse":
        if not name.endswith("_mm"):
            return text
        try:
            return float(text)
        except ValueError:
            pass
    raise EndoctError(f"'{ABOUT[name]}' cannot be used", found=repr(text)[:80])
