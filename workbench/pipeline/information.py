"""What a path is, what its sidecar lacks, and which modalities are installed."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from endoct.fusion.files.result_file import read_result
from endoct.modalities.acquisition import read_keys, sidecar_path, validate
from endoct.modalities.contract import FrameStream, Manifest, Preview, Sniff
from endoct.modalities.folders import exists
from endoct.modalities.numbering import notes_on_gaps
from endoct.modalities.registry import manifest_for, manifests, open_recording, sniffed
from endoct.modalities.remarks import NONE, Remarks, remarks_of
from endoct.stitching.digests import path_text
from endoct.stitching.store import is_panorama, load_panorama
from endoct.workbench.pipeline.sidecar_template import missing_keys
from endoct.workbench.pipeline.volumes import describe_volume, is_volume_or_plan

_KEY_WIDTH = 18
STATED = "stated"
CONTRADICTED = "stated, but it does not look like one"


@dataclass(frozen=True)
class Recognised:
    """Which plug-in reads a recording, and what it says of that; ``stated``: somebody said which, it is no guess."""

    manifest: Manifest
    sniff: Sniff
    stated: bool

    @property
    def certainty(self) -> str:
        """How sure it is that this is the recording's modality."""
        if self.stated:
            return STATED if self.sniff.claims else CONTRADICTED
        return self.sniff.certainty


def recognise(path: Path, modality: str | None = None) -> Recognised:
    """Return which plug-in reads ``path``, and why. Raises :class:`EndoctError` where there is none or two do."""
    manifest = manifest_for(path, modality)
    stated = modality is not None or "modality" in read_keys(path)
    return Recognised(manifest, sniffed(path, manifest), stated)


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
    """Return what ``path`` is: a comparison, panorama, CT, label map or plan, or a recording with its sidecar's state.

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
    if modality is None and not exists(sidecar_path(path)) and is_volume_or_plan(path):
        return describe_volume(path)
    return _recording(path, modality)


def in_lines(facts: Mapping[str, object]) -> Iterator[str]:
    """Yield what :func:`describe` returned for people: a key and a value on each line."""
    for key, value in facts.items():
        for number, text in enumerate(texts_of(value)):
            yield f"{'' if number else key:<{_KEY_WIDTH}}{text}"


def texts_of(value: object) -> list[str]:
    """Return a value of JSON as lines for people."""
    if isinstance(value, Mapping) and {"code", "what"} <= value.keys():  # a doubt
        return [f"{value['what']} ({value['code']})"]
    if isinstance(value, Mapping):
        return [f"{key}: {text}" for key, each in value.items() for text in texts_of(each)] or ["none"]
    if isinstance(value, list) and not all(isinstance(each, int | float) for each in value):
        return [text for each in value for text in texts_of(each)] or ["none"]
    if isinstance(value, list):
        return [", ".join(f"{each:g}" for each in value) or "none"]
    if isinstance(value, bool) or value is None:
        return [{True: "yes", False: "no", None: "none"}[value]]
    return [f"{value:g}" if isinstance(value, float) else str(value)]


def _recording(path: Path, modality: str | None) -> dict[str, object]:
    recognised = recognise(path, modality)
    manifest, sidecar = recognised.manifest, sidecar_path(path)
    keys = read_keys(path) | {"modality": manifest.name}
    missing = missing_keys(manifest.acquisition, keys)
    stream: FrameStream | None = None
    if all(key in keys for key, field in manifest.acquisition.model_fields.items() if field.is_required()):
        validate(manifest.acquisition, keys, str(sidecar))
        _, stream = open_recording(path, modality=manifest.name)
    facts: dict[str, object] = {"kind": "recording", "modality": manifest.name, "title": manifest.title}
    facts |= _size(manifest, recognised.sniff.preview, stream)
    facts |= {"certainty": recognised.certainty, "seen": recognised.sniff.reason}
    if stream is not None:
        facts["sidecar"] = stream.acquisition.model_dump(mode="json", exclude_none=True)
    if missing:
        facts["missing"] = missing
    previewed = recognised.sniff.preview
    remarks = (NONE if previewed is None else previewed.remarks) + remarks_of(stream)
    if stream is not None:
        remarks += Remarks(notes_on_gaps(stream.acquisition.positions_mm))
    facts |= {"doubts": [doubt.to_json() for doubt in remarks.doubts], "notes": list(remarks.notes)}
    return facts | {"next": _next(path, sidecar, bool(missing), modality)}


def _size(manifest: Manifest, preview: Preview | None, stream: FrameStream | None) -> dict[str, object]:
    """Return how many frames there are, and their axes in words, as far as that is known."""
    if preview is not None:
        n_frames, size, dtype = preview.n_frames, preview.size, preview.dtype
    elif stream is not None:
        samples = stream[0].samples
        n_frames, size, dtype = len(stream), f"{' × '.join(map(str, samples.shape))} samples", str(samples.dtype)
    else:
        return {}
    frames = f"{n_frames} {manifest.frame_dim}{'' if n_frames == 1 else 's'}"
    return {"frames": n_frames, "axes": f"{size}, {frames}", "dtype": dtype}


def _next(path: Path, sidecar: Path, missing: bool, modality: str | None) -> str:
    """Return what to do next with a recording."""
    if not missing:
        return f"endoct unroll {path_text(path)} -o PANORAMA.zarr"
    if exists(sidecar):
        return f"fill in what is missing in {path_text(sidecar)}"
    asked = f" --modality {modality}" if modality else ""
    return f"endoct info {path_text(path)}{asked} --write-sidecar"
