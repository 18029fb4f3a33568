"""A recording at the door: which plug-in reads it and why, which keys are known by whom, and what is missing.

Then it opens. Each question is answered once: a sidecar is read once, and a plug-in asked once what it knows of files.
"""

from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from shlex import quote
from typing import Any

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import exists
from endoct.modalities.acquisition import (
    SIDECAR_NAME,
    Acquisition,
    cited_keys,
    overridden,
    read_toml,
    sidecar_path,
    validate,
)
from endoct.modalities.contract import FrameStream, Manifest, Sniff
from endoct.modalities.reading.format import Stated
from endoct.modalities.reading.recording import format_of
from endoct.modalities.registry import reader_of, sniffed
from endoct.modalities.stated import stated_keys

STATED = "stated"
CONTRADICTED = "stated, but it does not look like one"


@dataclass(frozen=True)
class Recognised:
    """What there is to know of the recording at ``path`` before its frames are read; ``asked``: the plug-in asked for.

    Each property raises :class:`EndoctError` where what it needs cannot be read.
    """

    path: Path
    asked: str | None = None

    @cached_property
    def sidecar(self) -> Path:
        """Where its sidecar lies, or would lie."""
        return sidecar_path(self.path)

    @cached_property
    def own(self) -> Mapping[str, Any]:
        """The keys in the sidecar itself; none where there is no sidecar."""
        return read_toml(self.sidecar) if exists(self.sidecar) else {}

    @cached_property
    def cited(self) -> Mapping[str, Any]:
        """The keys of the calibration that the sidecar cites."""
        return cited_keys(self.sidecar, self.own)

    @cached_property
    def stated(self) -> Stated:
        """The keys that the recording's own files state, and which files."""
        return stated_keys(self.path, self.manifest.acquisition)

    @property
    def sidecar_keys(self) -> Mapping[str, Any]:
        """The sidecar's own keys, and those that it cites."""
        return {**self.own, **self.cited}

    @cached_property
    def keys(self) -> Mapping[str, Any]:
        """All that is known: the sidecar's keys win over those that the files state."""
        return {**self.stated.keys, **self.sidecar_keys, "modality": self.manifest.name}

    @cached_property
    def _reader(self) -> tuple[Manifest, Sniff | None]:
        return reader_of(self.path, lambda: self.asked or self.sidecar_keys.get("modality"))

    @property
    def manifest(self) -> Manifest:
        """The plug-in that reads it."""
        return self._reader[0]

    @cached_property
    def sniff(self) -> Sniff:
        """What the plug-in says of the files."""
        manifest, said = self._reader
        return sniffed(self.path, manifest) if said is None else said

    @property
    def certainty(self) -> str:
        """How sure it is that this is the recording's modality; where somebody said so it is no guess."""
        if self.asked is None and not self.says_modality:
            return self.sniff.certainty
        return STATED if self.sniff.claims else CONTRADICTED

    @property
    def says_modality(self) -> bool:
        """Whether its sidecar or its files say which plug-in reads it."""
        return "modality" in self.sidecar_keys or "modality" in self.stated.keys

    @property
    def needs(self) -> tuple[str, ...]:
        """Keys that this recording needs, though others do not."""
        return self.sniff.needs

    @property
    def missing(self) -> dict[str, str]:
        """What nobody states though it is needed, as :func:`missing_keys` has it."""
        return missing_keys(self.manifest.acquisition, self.keys, self.needs)

    @property
    def format(self) -> str:
        """What it is stored as, in words; "" where nothing says that."""
        raw = f"raw samples, as the sidecar's {' and '.join(self.needs)} describes them" if self.needs else ""
        return format_of(self.path) or raw

    def acquisition(self, overrides: Mapping[str, Any] | None = None) -> Acquisition:
        """Return the checked sidecar, keys of it replaced by ``overrides`` ("table.key": one of a table).

        Raises :class:`EndoctError` where nothing says how it was acquired, or for the first key that cannot be used.
        """
        overrides = dict(overrides or {})
        keys = overridden(self.keys, overrides)
        if not overrides and not self.stated.keys and not exists(self.sidecar):
            raise EndoctError(
                f"{self.path} has no {SIDECAR_NAME}",
                expected=f"it at {self.sidecar}",
                remedy=f"write one to fill in with `endoct info {quote(str(self.path))} --write-sidecar`",
            )
        return validate(self.manifest.acquisition, keys, str(self.sidecar), settings=overrides)

    def open(self, overrides: Mapping[str, Any] | None = None) -> FrameStream:
        """Return its frames. ``overrides`` and what is raised are those of :meth:`acquisition`."""
        acquisition = self.acquisition(overrides)
        with refusing(f"{self.path} cannot be read by the modality '{self.manifest.name}'"):
            return self.manifest.load().open(self.path, acquisition)


def recognise(path: Path, modality: str | None = None) -> Recognised:
    """Return the recording at ``path``, read by the plug-in ``modality`` or by the one that claims it.

    Raises :class:`EndoctError` where no plug-in reads it, or two do.
    """
    recognised = Recognised(path, modality)
    recognised.manifest  # noqa: B018 - refused here, not where something is first asked of it
    return recognised


def open_recording(
    path: Path, *, modality: str | None = None, overrides: Mapping[str, Any] | None = None
) -> tuple[Manifest, FrameStream]:
    """Return the plug-in that reads ``path``, and its frames as :meth:`Recognised.open` does."""
    recognised = recognise(path, modality)
    return recognised.manifest, recognised.open(overrides)


def load_ahead(path: Path, modality: str | None) -> None:
    """Load the plug-in that reads ``path``, where there is one: in a process that has nothing else to do yet."""
    with suppress(EndoctError):  # whoever opens the recording says what is wrong with it
        recognise(path, modality).manifest.load()


def missing_keys(acquisition: type[Acquisition], keys: Collection[str], needs: Collection[str] = ()) -> dict[str, str]:
    """Return what ``keys`` lack of what a recording needs, with why it matters; ``needs`` are keys it needs as well.

    By key; where one of several keys will do, by "one of a, b, or c with d".
    """
    missing = {
        key: field.description or "required"
        for key, field in acquisition.model_fields.items()
        if (field.is_required() or key in needs) and key not in keys
    }
    return missing | {str(one_of): one_of.why for one_of in acquisition.alternatives if not one_of.is_met(keys)}
