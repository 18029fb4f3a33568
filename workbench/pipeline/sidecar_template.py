"""What of a sidecar is still missing, as lines to fill in, and the sidecar as a template that begins with them."""

import json
import re
import tomllib
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

from pydantic.fields import FieldInfo

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import read_small
from endoct.base.files.output import new_output
from endoct.modalities.acquisition import Acquisition, table_model, unit_of
from endoct.modalities.recognition import Recognised, missing_keys
from endoct.modalities.registry import manifests
from endoct.workbench.running.outputs import SIDECAR

_FIRST_LINE = "# What the files of ", " do not say themselves. Leave out what is not known."
_NEEDED, _STATED, _FURTHER = (
    "# Needed:",
    "# Stated by the files; a key here would replace it:",
    "# Where they are known:",
)
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_STATED_LINE = re.compile(r"# \w+ = .*  # by .*")


def missing_lines(acquisition: type[Acquisition], keys: Collection[str], needs: Collection[str] = ()) -> list[str]:
    """Return the lines of TOML to add to a sidecar with ``keys``, values left out, each with its unit and what it is.

    Keys of which one will do are comments.
    """
    fields = acquisition.model_fields
    lines = [_to_fill_in(key, fields[key]) for key in missing_keys(acquisition, keys, needs) if key in fields]
    for one_of in acquisition.alternatives:
        if not one_of.is_met(keys):
            lines.append(f"# one of these lines gives {one_of.why}:")
            lines += [f"# {_to_fill_in(key, fields[key])}" for key in one_of.keys if key not in keys]
    return lines


def write_sidecar_template(recognised: Recognised, *, overwrite: bool) -> tuple[Path, dict[str, str]]:
    """Write an ``acquisition.toml`` to fill in; return its path and what it lacks.

    What is needed comes first, then what the files state, as comments, then what else may be known. Keys that an
    existing sidecar has are kept. Raises :class:`EndoctError` where a sidecar exists and ``overwrite`` is not set, or
    the sidecar is no such template or holds comments of the user's own.
    """
    sidecar, acquisition, missing = recognised.sidecar, recognised.manifest.acquisition, recognised.missing
    if sidecar.exists() and not overwrite:
        raise EndoctError(f"{sidecar} exists already", remedy="edit it, or lay its keys out anew with overwrite=True")
    kept = {**recognised.own, "modality": recognised.manifest.name}
    if unknown := sorted(kept.keys() - acquisition.model_fields.keys()):
        raise EndoctError(
            f"'{unknown[0]}' in {sidecar} is no key of '{recognised.manifest.name}'",
            expected=", ".join(acquisition.model_fields),
            remedy="correct or remove it first: it would be lost",
        )
    lines = [f"{_FIRST_LINE[0]}{recognised.path.name}{_FIRST_LINE[1]}", ""]
    lines += _sections(recognised, kept)
    text = "\n".join(lines)
    with refusing(f"{sidecar} cannot be laid out anew", remedy="edit it by hand"):
        if tomllib.loads(text) != kept:
            raise ValueError("its values would change")
    with new_output(sidecar, SIDECAR, overwrite=overwrite, is_ours=_is_template) as scratch:
        scratch.write_text(text, encoding="utf-8")
    return sidecar, missing


def _sections(recognised: Recognised, kept: Mapping[str, object]) -> Iterator[str]:
    """Yield the lines of a template below its first: what is kept, needed, stated, and further keys."""
    acquisition, stated, known = recognised.manifest.acquisition, recognised.stated, recognised.keys
    fields = acquisition.model_fields
    open_ = [one_of for one_of in acquisition.alternatives if not one_of.is_met(known)]
    needed = {key for key, field in fields.items() if field.is_required() or key in recognised.needs}
    needed |= {key for one_of in open_ for key in one_of.keys}
    of_stated = [key for key in stated.keys if key not in kept]
    further = [key for key in fields if key not in needed and key not in known]
    for key in (key for key in fields if key in kept):
        yield from (f"# {_about(fields[key])}", _line(key, fields[key], kept), "")
    if lacking := [key for key in fields if key in needed and key not in known]:
        yield from (_NEEDED, "")
        for key in lacking:
            yield from (f"# {_about(fields[key])}{_alternative(key, acquisition)}", _line(key, fields[key], {}), "")
    if of_stated:
        yield _STATED
        yield from (f"# {key} = {toml_value(key, stated.keys[key])}  # by {stated.by}" for key in of_stated)
        yield ""
    if further:
        yield from (_FURTHER, "")
        for key in further:
            yield from (f"# {_about(fields[key])}", _line(key, fields[key], {}), "")


def _is_template(sidecar: Path) -> bool:
    """Say whether a sidecar is a template, filled in perhaps, without a comment of the user's own: keys are kept."""
    lines = read_small(sidecar).decode("utf-8", "replace").splitlines()
    comments = {_NEEDED, _STATED, _FURTHER} | {
        line
        for acquisition in (manifest.acquisition for manifest in manifests().values())
        for key, field in acquisition.model_fields.items()
        for about in [f"# {_about(field)}"]
        for line in (about, about + _alternative(key, acquisition), _line(key, field, {}).rstrip())
    }
    begins = bool(lines) and lines[0].startswith(_FIRST_LINE[0]) and lines[0].endswith(_FIRST_LINE[1])
    return begins and all(
        "#" not in line or line.rstrip() in comments or _STATED_LINE.fullmatch(line) for line in lines[1:]
    )


def _about(field: FieldInfo) -> str:
    return f"{field.description}" + (" (required)" if field.is_required() else "")


def _alternative(key: str, acquisition: type[Acquisition]) -> str:
    for one_of in acquisition.alternatives:
        if key in one_of.keys:
            return f" (this, or another key that gives {one_of.why}, is needed)"
    return ""


def _to_fill_in(key: str, field: FieldInfo) -> str:
    unit = unit_of(key)
    return f"{_line(key, field, {}).removeprefix('# ').rstrip()}  # {f'{unit}: ' if unit else ''}{field.description}"


def _line(key: str, field: FieldInfo, kept: Mapping[str, object]) -> str:
    if key in kept:
        return f"{key} = {toml_value(key, kept[key])}"
    if (table := table_model(field)) is not None:
        required = [f"{name} = …" for name, within in table.model_fields.items() if within.is_required()]
        return f"# {key} = {{ {', '.join(required)} }}"
    default = field.get_default()
    return f"# {key} = " + ("" if field.is_required() or default is None else json.dumps(default))


def toml_value(key: str, value: object) -> str:
    """Return the value of ``key`` as TOML has it, on one line. Raises :class:`EndoctError` for a date.

    A library that edits TOML takes minutes to write the positions of many frames.
    """
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_name(name)} = {toml_value(key, inner)}" for name, inner in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(toml_value(key, inner) for inner in value) + "]"
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, str | int):
        return json.dumps(value, ensure_ascii=False)
    raise EndoctError(f"the sidecar's '{key}' cannot be carried over", remedy="edit the sidecar by hand")


def _name(key: str) -> str:
    return key if _BARE.fullmatch(key) else json.dumps(key, ensure_ascii=False)
