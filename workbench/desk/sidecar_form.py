"""A recording's sidecar as a form: every key with its unit, its bounds, what the files state, and its value.

A saved form changes the keys that were changed and nothing else: comments and the order of a sidecar stay.

What a form changes is drawn at once: a few neighbouring frames are surveyed as it has them, and one is pictured. That
is done in a process of its own, so that the page answers meanwhile, and a fault in a plug-in ends nothing else.
"""

import threading
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import numpy as np
import tomlkit
from pydantic.fields import FieldInfo

from endoct.base.compute.worker_process import WorkerProcess, worker_process
from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import exists, is_folder, read_small, sha256_of, text_of
from endoct.base.files.output import new_output
from endoct.modalities.acquisition import (
    Acquisition,
    check_values,
    cited_keys,
    field_limits,
    table_model,
    unit_of,
    validate,
)
from endoct.modalities.contract import Frame, FrameStream, Manifest, Picture
from endoct.modalities.recognition import Recognised, missing_keys, recognise
from endoct.workbench.page.recorded import picture_json
from endoct.workbench.pipeline.sidecar_template import toml_value
from endoct.workbench.running.outputs import SIDECAR

KeyKind = Literal["number", "choice", "text", "toml"]
LONGEST = 100_000
"""Characters of a value: positions of many frames."""
NEIGHBOURS = 7
"""Frames that are surveyed: enough for what a plug-in takes from neighbours, few enough for a second."""
LONGEST_S = 180.0
"""How long a frame is waited for: the first of its kind compiles."""
MOST_AT_ONCE = 3
"""Previews under way or waiting: each takes a thread that other requests need."""


@dataclass(frozen=True)
class SidecarForm:
    """The sidecar of a recording, as its form begins; ``digest`` is that of the file, None where there is none yet."""

    recognised: Recognised
    digest: str | None

    @property
    def manifest(self) -> Manifest:
        """The plug-in that says which keys there are."""
        return self.recognised.manifest

    def to_json(self) -> dict[str, Any]:
        """Return the form for the page."""
        return {
            "sidecar": str(self.recognised.sidecar),
            "modality": self.manifest.name,
            "title": self.manifest.title,
            "stated_by": self.recognised.stated.by,
            "digest": self.digest,
            "fields": list(self._fields()),
            "missing": self.missing({}),
        }

    def drafted(self, texts: Mapping[str, object]) -> dict[str, Any]:
        """Return the sidecar's own keys as a form with ``texts`` by key has them; an empty text leaves a key out.

        Raises :class:`EndoctError` for a key that is not known, and for a text that is no value of its kind.
        """
        fields = self.manifest.acquisition.model_fields
        keys: dict[str, Any] = {key: value for key, value in self.recognised.own.items() if key not in texts}
        for key, text in texts.items():
            if key not in fields or not isinstance(text, str) or len(text) > LONGEST:
                raise EndoctError(f"'{str(key)[:40]}' is no key of '{self.manifest.name}', or has no value")
            if text.strip():
                keys[key] = _value(key, fields[key], text.strip())
        return keys | {"modality": self.manifest.name}

    def missing(self, texts: Mapping[str, object]) -> dict[str, str]:
        """Return what is still missing with ``texts``, and why it matters, by key."""
        return missing_keys(self.manifest.acquisition, self._all(self.drafted(texts)), self.recognised.needs)

    def acquisition(self, texts: Mapping[str, object]) -> Acquisition:
        """Return the checked sidecar with ``texts``. Raises :class:`EndoctError` for the first fault of it."""
        return validate(self.manifest.acquisition, self._all(self.drafted(texts)), "the form")

    def save(self, texts: Mapping[str, object], based_on: str | None) -> None:
        """Write the keys that ``texts`` change into the sidecar; its other lines stay as they are.

        ``based_on`` is the digest of the sidecar that the form was made of, None where there was none. Raises
        :class:`EndoctError` where a value cannot be used, or the file was changed meanwhile.
        """
        path, keys = self.recognised.sidecar, self.drafted(texts)
        self._check_values(keys)
        self._check_alone(path)
        if digest_of(path) != based_on:
            raise EndoctError(
                f"{path} was changed meanwhile, by another window or an editor perhaps",
                remedy="note what you entered and load the page anew",
            )
        with refusing(f"{path} cannot be changed", remedy="edit it by hand"):
            document = tomlkit.parse(text_of(read_small(path))) if based_on else tomlkit.document()
            for key in [key for key in document if key not in keys]:
                document.remove(key)
            for key, value in keys.items():
                if key not in document or document[key] != value:
                    document[key] = tomlkit.value(toml_value(key, value)) if isinstance(value, list) else value
            text = tomlkit.dumps(document)
            if tomllib.loads(text) != keys:
                raise EndoctError("its values would change")
        is_new = based_on is None
        with new_output(path, SIDECAR, overwrite=not is_new, is_ours=lambda p: sha256_of(p) == based_on) as out:
            out.write_bytes(text.encode())  # with the ends of lines that it has

    def _all(self, own: Mapping[str, Any]) -> dict[str, Any]:
        return {**self.recognised.stated.keys, **cited_keys(self.recognised.sidecar, own), **own}

    def _check_values(self, own: Mapping[str, Any]) -> None:
        """Raise :class:`EndoctError` for a value that cannot be used; keys may still be missing."""
        model, keys = self.manifest.acquisition, self._all(own)
        if not missing_keys(model, keys, self.recognised.needs):
            validate(model, keys, "the form")
            return
        check_values(model, keys, "the form")  # what is there has to be right, whatever is still to come

    def _check_alone(self, sidecar: Path) -> None:
        """Raise :class:`EndoctError` where the sidecar describes another recording in the same folder."""
        described = self.recognised.own.get("modality", self.manifest.name)
        if not is_folder(self.recognised.path) and described != self.manifest.name:
            raise EndoctError(
                f"{sidecar} describes a recording of '{described}', and not {self.recognised.path.name}",
                expected="one recording in a folder",
                remedy="put each recording into a folder of its own",
            )

    def _fields(self) -> Iterator[dict[str, Any]]:
        model, given = self.manifest.acquisition, self.recognised
        by_source = {"value": given.own, "stated": given.stated.keys, "cited": given.cited}
        one_of = {key: alternative.why for alternative in model.alternatives for key in alternative.keys}
        for key, field in model.model_fields.items():
            if key == "modality":
                continue
            low, high = field_limits(model, [key])
            default = field.get_default()
            yield {
                "key": key,
                "kind": _kind(field),
                "unit": unit_of(key),
                "about": field.description or "",
                "choices": [*_choices(field)],
                "low": low,
                "high": high,
                "required": field.is_required() or key in self.recognised.needs,
                "one_of": one_of.get(key, ""),
                **{source: _text(keys[key]) if key in keys else "" for source, keys in by_source.items()},
                "default": "" if field.is_required() or default is None else _text(default),
            }


def sidecar_form(recording: Path, modality: str | None = None) -> SidecarForm:
    """Return the form of a recording's sidecar, which need not be there yet.

    Raises :class:`EndoctError` where nothing says which plug-in reads the recording, or its sidecar cannot be read.
    """
    recognised = recognise(recording, modality)
    return SidecarForm(recognised, digest_of(recognised.sidecar))


def digest_of(path: Path) -> str | None:
    """Return the sha256 of a file, None where there is none."""
    return sha256_of(path) if exists(path) else None


def _kind(field: FieldInfo) -> KeyKind:
    if _choices(field):
        return "choice"
    if table_model(field) is not None:
        return "toml"
    kinds = set(get_args(field.annotation)) or {field.annotation}
    if kinds & {int, float}:
        return "number"
    return "text" if str in kinds else "toml"


def _choices(field: FieldInfo) -> tuple[str, ...]:
    hints = (field.annotation, *get_args(field.annotation))
    return next((get_args(hint) for hint in hints if get_origin(hint) is Literal), ())


def _value(key: str, field: FieldInfo, text: str) -> Any:
    """Return the value that a text of the form stands for."""
    if _kind(field) in ("choice", "text"):
        return text
    try:
        (value,) = tomllib.loads(f"value = {text}").values()  # a text of several lines could bring further keys
        return value
    except (ValueError, RecursionError):
        expected = "a number, with a point" if _kind(field) == "number" else "a value as TOML has it"
        raise EndoctError(f"'{key}' cannot be used", found=text[:80], expected=expected) from None


def _text(value: object) -> str:
    """Return a value as the form has it, on one line: texts as they are, others as TOML."""
    if isinstance(value, str):
        return value
    try:
        text = toml_value("", value)
        return f"{{{text[2:-2]}}}" if isinstance(value, Mapping) else text
    except EndoctError:
        return str(value)


class Previewer:
    """Draws drafts in a process that starts with the first of them and ends with :meth:`close`."""

    def __init__(self) -> None:
        self._process: WorkerProcess | None = None
        self._stack = ExitStack()
        self._lock = threading.Lock()
        self._room = threading.BoundedSemaphore(MOST_AT_ONCE)

    def preview(
        self, recording: Path, modality: str | None, texts: Mapping[str, object], share: float
    ) -> dict[str, Any]:
        """Return what :func:`drawn` does. Raises :class:`EndoctError` where many wait for theirs already."""
        if not self._room.acquire(blocking=False):
            raise EndoctError("other frames are being drawn", remedy="wait for them, then change anything here")
        try:
            return self._drawn(recording, modality, texts, share)
        finally:
            self._room.release()

    def _drawn(
        self, recording: Path, modality: str | None, texts: Mapping[str, object], share: float
    ) -> dict[str, Any]:
        with self._lock:
            if self._process is None:
                self._process = self._stack.enter_context(worker_process())
            try:
                return self._process.call(drawn, recording, modality, dict(texts), share).result(LONGEST_S)
            except TimeoutError as error:
                self.close()
                raise EndoctError("the frame cannot be drawn", found=f"no end after {LONGEST_S:g} s") from error
            except MemoryError:
                self.close()  # it gives back what it holds, or has ended
                raise
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
    return {**said, "pictures": [picture_json(each, None) for each in pictures or _as_recorded(form.recognised)]}


def _pictured(plugin: Any, stream: FrameStream, frame: int) -> tuple[Picture, ...]:
    first = min(max(0, frame - NEIGHBOURS // 2), max(0, len(stream) - NEIGHBOURS))
    part = _Part(stream, tuple(range(first, min(len(stream), first + NEIGHBOURS))))
    calibration = plugin.survey(part, plugin.parameters())
    pictures: tuple[Picture, ...] = plugin.illustrate(part[frame - first], calibration)
    return pictures


def _as_recorded(recognised: Recognised) -> Sequence[Picture]:
    preview = recognised.sniff.preview
    if preview is None or not preview.pictures:
        return ()
    image = np.asarray(preview.pictures[len(preview.pictures) // 2])
    rows, columns = image.shape[:2]
    every = max(1, -(-max(rows, columns) // 1000))
    ends = (0.0, columns - 1.0), (0.0, rows - 1.0)
    # samples along a beam and beams are no lengths of one kind, as a camera's pixels are
    unit = "" if "depth" in recognised.manifest.provides else " (px)"
    axes = f"column{unit}", f"row{unit}"
    return [Picture("recorded", "as its file holds it", image[::every, ::every], *axes, *ends)]


@dataclass(frozen=True)
class _Part:
    """Some frames of a stream, as a stream of their own."""

    stream: FrameStream
    frames: tuple[int, ...]

    @property
    def acquisition(self) -> Acquisition:
        """The sidecar, with the positions of these frames."""
        whole = self.stream.acquisition
        if whole.positions_mm is None:
            return whole
        positions_mm = tuple(whole.positions_mm[frame] for frame in self.frames)
        return whole.model_copy(update={"positions_mm": positions_mm})

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, index: int) -> Frame:
        return replace(self.stream[self.frames[index]], index=index)
