"""The sidecar as a template to fill in, and what of it is still missing."""

import json
import tomllib
from collections.abc import Collection, Mapping
from pathlib import Path

from pydantic.fields import FieldInfo

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import read_small
from endoct.base.files.output import new_output
from endoct.modalities.acquisition import Acquisition, read_toml, sidecar_path, table_model
from endoct.modalities.registry import manifest_for, manifests
from endoct.workbench.running.kinds import SIDECAR

_FIRST_LINE = "# What the files of ", " do not say themselves. Leave out what is not known."


def missing_keys(acquisition: type[Acquisition], keys: Collection[str]) -> dict[str, str]:
    """Return what ``keys`` lack of what a recording needs, with why it matters.

    By key; where one of several keys will do, by "one of a, b, or c with d".
    """
    fields = acquisition.model_fields
    missing = {k: f.description or "required" for k, f in fields.items() if f.is_required() and k not in keys}
    return missing | {str(one_of): one_of.why for one_of in acquisition.alternatives if not one_of.is_met(keys)}


def write_sidecar_template(path: Path, modality: str | None, *, overwrite: bool) -> tuple[Path, dict[str, str]]:
    """Write an ``acquisition.toml`` to fill in; return its path and what it lacks, as :func:`missing_keys` does.

    Keys that an existing sidecar has are kept. Raises :class:`EndoctError` where one exists and ``overwrite`` is
    not set, or it is no such template or holds comments of the user's own, or nothing says which modality it is.
    """
    manifest = manifest_for(path, modality)
    sidecar = sidecar_path(path)
    if sidecar.exists() and not overwrite:
        raise EndoctError(f"{sidecar} exists already", remedy="edit it, or lay its keys out anew with overwrite=True")
    kept = (read_toml(sidecar) if sidecar.exists() else {}) | {"modality": manifest.name}
    fields = manifest.acquisition.model_fields
    if unknown := sorted(kept.keys() - fields.keys()):
        raise EndoctError(
            f"'{unknown[0]}' in {sidecar} is no key of '{manifest.name}'",
            expected=", ".join(fields),
            remedy="correct or remove it first: it would be lost",
        )
    lines = [f"{_FIRST_LINE[0]}{path.name}{_FIRST_LINE[1]}", ""]
    for key, field in manifest.acquisition.model_fields.items():
        lines += [f"# {_about(field)}{_alternative(key, manifest.acquisition)}", _line(key, field, kept), ""]
    text = "\n".join(lines)
    with refusing(f"{sidecar} cannot be laid out anew", remedy="edit it by hand"):
        if tomllib.loads(text) != kept:
            raise ValueError("its values would change")
    with new_output(sidecar, SIDECAR, overwrite=overwrite, is_ours=_is_template) as scratch:
        scratch.write_text(text, encoding="utf-8")
    return sidecar, missing_keys(manifest.acquisition, kept)


def _is_template(sidecar: Path) -> bool:
    """Say whether a sidecar is a template, filled in perhaps, without a comment of the user's own: keys are kept."""
    lines = read_small(sidecar).decode("utf-8", "replace").splitlines()
    comments = {
        line
        for acquisition in (manifest.acquisition for manifest in manifests().values())
        for key, field in acquisition.model_fields.items()
        for about in [f"# {_about(field)}"]
        for line in (about, about + _alternative(key, acquisition), _line(key, field, {}).rstrip())
    }
    begins = bool(lines) and lines[0].startswith(_FIRST_LINE[0]) and lines[0].endswith(_FIRST_LINE[1])
    return begins and all("#" not in line or line.rstrip() in comments for line in lines[1:])


def _about(field: FieldInfo) -> str:
    return f"{field.description}" + (" (required)" if field.is_required() else "")


def _alternative(key: str, acquisition: type[Acquisition]) -> str:
    for one_of in acquisition.alternatives:
        if any(key in group for group in one_of.groups):
            return f" (this, or another key that gives {one_of.why}, is needed)"
    return ""


def _line(key: str, field: FieldInfo, kept: dict[str, object]) -> str:
    if key in kept:
        return f"{key} = {_value(key, kept[key])}"
    if (table := table_model(field)) is not None:
        required = [f"{name} = …" for name, within in table.model_fields.items() if within.is_required()]
        return f"# {key} = {{ {', '.join(required)} }}"
    default = field.get_default()
    return f"# {key} = " + ("" if field.is_required() or default is None else json.dumps(default))


def _value(key: str, value: object) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{name} = {_value(key, inner)}" for name, inner in value.items()) + " }"
    if isinstance(value, str | int | float | bool | list):
        return json.dumps(value, ensure_ascii=False)
    raise EndoctError(f"the sidecar's '{key}' cannot be carried over", remedy="edit the sidecar by hand")
