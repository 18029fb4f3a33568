"""Which plug-ins are installed, and which of them reads a path."""

from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from shlex import quote
from typing import Any, get_args

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import exists, plain_name
from endoct.modalities.acquisition import SIDECAR_NAME, abridged, overridden, read_keys, sidecar_path, validate
from endoct.modalities.contract import Certainty, FrameStream, Manifest, Sniff, import_cause
from endoct.modalities.device import Device
from endoct.modalities.reading.recording import refusal_of, stated_by
from endoct.modalities.stated import stated_keys

GROUP = "endoct.modalities"
SUREST_FIRST: tuple[Certainty, ...] = get_args(Certainty)


@cache
def manifests() -> Mapping[str, Manifest]:
    """Return every installed plug-in's manifest by name. Raises :class:`EndoctError` for a broken one."""
    by_name: dict[str, Manifest] = {}
    for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name):
        try:
            manifest = entry.load()
        except (Exception, SystemExit) as error:  # a stranger's module may raise anything
            raise EndoctError(
                f"the modality '{entry.name}' cannot be imported",
                found=import_cause(error),
                remedy=f"reinstall or remove the package that registers {entry.value}",
            ) from error
        if not isinstance(manifest, Manifest) or manifest.name != entry.name or manifest.name in by_name:
            raise EndoctError(
                f"the entry point '{entry.name}' ({entry.value}) is no modality",
                expected=f"one Manifest of the name '{entry.name}'",
                remedy="correct or remove the package that registers it",
            )
        plain_name(manifest.name, f"a modality ({entry.value})")
        plain_name(manifest.frame_dim, f"what the modality '{manifest.name}' calls a frame")
        by_name[manifest.name] = manifest
    return by_name


def manifest_for(path: Path, modality: str | None = None) -> Manifest:
    """Return the plug-in that reads ``path``: the one asked for, else the sidecar's, else the one its files state.

    Where nothing says it, it is the plug-in that claims ``path`` with the greatest certainty.

    Raises :class:`EndoctError` where there is none, or two claim it and are equally sure.
    """
    if not exists(path):
        raise EndoctError(f"{path} does not exist", remedy="check the path")
    name = modality or read_keys(path).get("modality")
    if name is not None and not isinstance(name, str):
        raise EndoctError(f"'modality' in {sidecar_path(path)} is no name", found=abridged(name), expected="a text")
    if name is None and (stated := stated_by(path).keys.get("modality")) in manifests():
        name = stated
    if name is not None:
        if name not in manifests():
            raise EndoctError(f"unknown modality '{name[:80]}'", expected=f"one of {', '.join(manifests())}")
        return manifests()[name]
    verdicts = {name: sniffed(path, manifest) for name, manifest in manifests().items()}
    claimed = {name: SUREST_FIRST.index(verdict.certainty) for name, verdict in verdicts.items() if verdict.claims}
    claims = [name for name, rank in claimed.items() if rank == min(claimed.values())]
    if len(claims) == 1:
        return manifests()[claims[0]]
    if claims:
        raise EndoctError(
            f"{path} could be {' or '.join(claims)}",
            remedy=f"say which with modality='NAME', or with 'modality' in {sidecar_path(path)}",
        )
    if (refusal := refusal_of(path)) is not None:
        raise refusal
    inside: list[str] = []
    with suppress(OSError):
        inside = sorted(str(sidecar.parent) for sidecar in path.glob(f"*/{SIDECAR_NAME}"))
    raise EndoctError(
        f"no modality reads {path}",
        found=", ".join(f"{name}: {verdict.reason}" for name, verdict in verdicts.items()),
        remedy=f"name one of {', '.join(inside)}"
        if inside
        else "see `endoct modalities` for what can be read; where you know what it is, say so with modality='NAME'",
    )


def load_ahead(path: Path, modality: str | None) -> None:
    """Load the plug-in that reads ``path``, where there is one: in a process that has nothing else to do yet."""
    with suppress(EndoctError):  # whoever opens the recording says what is wrong with it
        manifest_for(path, modality).load()


def open_recording(
    path: Path,
    *,
    modality: str | None = None,
    overrides: Mapping[str, Any] | None = None,
    device: Device = "cpu",
) -> tuple[Manifest, FrameStream]:
    """Open ``path`` with its plug-in; ``overrides`` replace keys of the sidecar ("table.key": one of a table).

    ``device`` is where frames are computed, as far as the plug-in can do that elsewhere than on the CPU.

    Raises :class:`EndoctError` where the recording or its sidecar cannot be used.
    """
    manifest = manifest_for(path, modality)
    overrides = dict(overrides or {})
    stated = stated_keys(path, manifest.acquisition).keys
    keys = overridden({**stated, **read_keys(path), "modality": manifest.name}, overrides)
    sidecar = sidecar_path(path)
    if not exists(sidecar) and not overrides and not stated:
        raise EndoctError(
            f"{path} has no {SIDECAR_NAME}",
            expected=f"it at {sidecar}",
            remedy=f"write one to fill in with `endoct info {quote(str(path))} --write-sidecar`",
        )
    acquisition = validate(manifest.acquisition, keys, str(sidecar), settings=overrides)
    with refusing(f"{path} cannot be read by the modality '{manifest.name}'"):
        return manifest, manifest.load(device).open(path, acquisition)


def sniffed(path: Path, manifest: Manifest) -> Sniff:
    """Return what one plug-in says of ``path``. Raises :class:`EndoctError` for whatever it raises."""
    with refusing(f"the modality '{manifest.name}' cannot say whether it reads {path}"):
        return manifest.load().sniff(path)
