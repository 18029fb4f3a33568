"""What a path is, what its sidecar lacks, and which modalities are installed."""

import json
import tomllib
from pathlib import Path

from pydantic.fields import FieldInfo

from endoct.fusion.files.result_file import read_result
from endoct.modalities.acquisition import read_keys, read_toml, sidecar_path, validate
from endoct.modalities.contract import Manifest
from endoct.modalities.registry import manifest_for, manifests, open_recording
from endoct.stitching.errors import EndoctError, refusing
from endoct.stitching.files import read_small
from endoct.stitching.output import new_output
from endoct.stitching.store import is_panorama, load_panorama
from endoct.workbench.running.kinds import SIDECAR

_FIRST_LINE = "# What the files of ", " do not say themselves. Leave out what is not known."


def installed_modalities() -> list[dict[str, object]]:
    """Return name, title, what it provides and reads, of every installed modality."""
    return [
        {
            "name": manifest.name,
            "title": manifest.title,
            "provides": sorted(manifest.provides),
            "suffixes": list(manifest.suffixes),
            "sidecar_keys": list(manifest.acquisition.model_fields),
        }
        for manifest in manifests().values()
    ]


def describe(path: Path, modality: str | None = None) -> dict[str, object]:
    """Return what ``path`` is: a comparison, a panorama or a recording with its sidecar's state.

    Raises :class:`EndoctError` where it is none of them.
    """
    if (path / "result.json").is_file():
        result = read_result(path)
        return {
            "kind": "comparison",
            "sides": list(result.sides),
            "aligned": result.aligned,
            "reason": result.reason,
            "jaccard": result.jaccard,
            "dice": result.dice,
            "doubts": [doubt.to_json() for doubt in result.doubts],
        }
    if is_panorama(path):
        panorama = load_panorama(path)
        return {
            "kind": "panorama",
            "modality": panorama.modality,
            "rows": panorama.grid.n_z,
            "columns": panorama.grid.n_theta,
            "z_mm": [float(panorama.z_mm[0]), float(panorama.z_mm[-1])],
            "depth": panorama.depth_mm is not None,
            "valid_fraction": float(panorama.valid.mean()),
            "doubts": [doubt.to_json() for doubt in panorama.doubts],
            "notes": list(panorama.notes),
        }
    manifest = manifest_for(path, modality)
    keys = read_keys(path) | {"modality": manifest.name}
    if missing := _missing(manifest, keys):
        return {
            "kind": "recording",
            "modality": manifest.name,
            "missing": missing,
            "remedy": f"endoct info {path} --write-sidecar",
        }
    validate(manifest.acquisition, keys, str(sidecar_path(path)))
    _, stream = open_recording(path, modality=manifest.name)
    first = stream[0].samples
    return {
        "kind": "recording",
        "modality": manifest.name,
        "title": manifest.title,
        "frames": len(stream),
        "frame_shape": list(first.shape),
        "dtype": str(first.dtype),
        "sidecar": stream.acquisition.model_dump(mode="json", exclude_none=True),
    }


def write_sidecar_template(path: Path, modality: str | None, *, overwrite: bool) -> tuple[Path, dict[str, str]]:
    """Write an ``acquisition.toml`` to fill in; return its path and the keys still missing, with why they matter.

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
        lines += [f"# {_about(field)}", _line(key, field, kept), ""]
    text = "\n".join(lines)
    with refusing(f"{sidecar} cannot be laid out anew", remedy="edit it by hand"):
        if tomllib.loads(text) != kept:
            raise ValueError("its values would change")
    with new_output(sidecar, SIDECAR, overwrite=overwrite, is_ours=_is_template) as scratch:
        scratch.write_text(text, encoding="utf-8")
    return sidecar, _missing(manifest, kept)


def _is_template(sidecar: Path) -> bool:
    """Say whether a sidecar is a template, filled in perhaps, without a comment of the user's own: keys are kept."""
    lines = read_small(sidecar).decode("utf-8", "replace").splitlines()
    fields = [field for manifest in manifests().values() for field in manifest.acquisition.model_fields.items()]
    comments = {
        line for key, field in fields for line in (f"# {_about(field)}", _line(key, field, {}).rstrip())
    }  # fmt: skip
    begins = bool(lines) and lines[0].startswith(_FIRST_LINE[0]) and lines[0].endswith(_FIRST_LINE[1])
    return begins and all("#" not in line or line.rstrip() in comments for line in lines[1:])


def _about(field: FieldInfo) -> str:
    return f"{field.description}" + (" (required)" if field.is_required() else "")


def _missing(manifest: Manifest, keys: dict[str, object]) -> dict[str, str]:
    fields = manifest.acquisition.model_fields
    return {k: f.description or "required" for k, f in fields.items() if f.is_required() and k not in keys}


def _line(key: str, field: FieldInfo, kept: dict[str, object]) -> str:
    if key in kept and isinstance(kept[key], str | int | float | bool | list):
        return f"{key} = {json.dumps(kept[key], ensure_ascii=False)}"
    if key in kept:
        raise EndoctError(f"the sidecar's '{key}' cannot be carried over", remedy="edit the sidecar by hand")
    default = field.get_default()
    return f"# {key} = " + ("" if field.is_required() or default is None else json.dumps(default))
