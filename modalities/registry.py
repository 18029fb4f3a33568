"""Which plug-ins are installed, and which of them reads a path."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import get_args

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import exists, plain_name
from endoct.modalities.acquisition import SIDECAR_NAME, abridged, sidecar_path
from endoct.modalities.contract import Certainty, Manifest, Sniff, import_cause
from endoct.modalities.reading.recording import refusal_of, stated_by

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


def reader_of(path: Path, stated: Callable[[], object]) -> tuple[Manifest, Sniff | None]:
    """Return the plug-in that reads ``path``, and what it says of that, if it was asked.

    It is the one that ``stated`` names, else the one that the path's own files state. Where nothing says it, it is the
    plug-in that claims ``path`` with the greatest certainty. Raises :class:`EndoctError` where there is none, or two
    claim it and are equally sure.
    """
    if not exists(path):
        raise EndoctError(f"{path} does not exist", remedy="check the path")
    name = stated()
    if name is not None and not isinstance(name, str):
        raise EndoctError(f"'modality' in {sidecar_path(path)} is no name", found=abridged(name), expected="a text")
    if name is None and (said := stated_by(path).keys.get("modality")) in manifests():
        name = said
    if name is not None:
        if name not in manifests():
            raise EndoctError(f"unknown modality '{name[:80]}'", expected=f"one of {', '.join(manifests())}")
        return manifests()[name], None
    verdicts = {name: sniffed(path, manifest) for name, manifest in manifests().items()}
    claimed = {name: SUREST_FIRST.index(verdict.certainty) for name, verdict in verdicts.items() if verdict.claims}
    claims = [name for name, rank in claimed.items() if rank == min(claimed.values())]
    if len(claims) == 1:
        return manifests()[claims[0]], verdicts[claims[0]]
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


def sniffed(path: Path, manifest: Manifest) -> Sniff:
    """Return what one plug-in says of ``path``. Raises :class:`EndoctError` for whatever it raises."""
    with refusing(f"the modality '{manifest.name}' cannot say whether it reads {path}"):
        return manifest.load().sniff(path)
