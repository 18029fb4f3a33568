"""What a path is, what its sidecar lacks, which modalities are installed, and a picture of a recording.

The picture is of a recording before anything is done to it: its first, middle and last frame side by side.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from shlex import quote
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.base.errors import EndoctError
from endoct.base.files.files import exists, path_text
from endoct.base.files.output import new_output
from endoct.fusion.files.result_file import read_result
from endoct.modalities.acquisition import sidecar_path
from endoct.modalities.contract import FrameStream, Manifest, Preview
from endoct.modalities.reading.numbering import notes_on_gaps
from endoct.modalities.reading.remarks import NONE, Remarks, remarks_of
from endoct.modalities.recognition import Recognised, recognise
from endoct.modalities.registry import manifests
from endoct.stitching.store import load_panorama
from endoct.workbench.kinds import KINDS, PLAN, RECORDING, VOLUME, output_at, reader
from endoct.workbench.pipeline.sidecar_template import missing_lines
from endoct.workbench.pipeline.unread import texts_in, unread_next_to
from endoct.workbench.running.outputs import THUMBNAIL

_KEY_WIDTH = 18
SIDE_PX = 480
"""Each frame of the picture has at most this height or width."""
MOST_UNEVEN = 2.0
"""How much longer than the other one side of a frame may be; a turn of 14 000 A-scans is drawn narrower."""
GAP_PX = 6
DARKEST, BRIGHTEST = 0.5, 99.5
"""Percentiles of the samples that become black and white."""


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
    kind = output_at(path)
    if kind is None and modality is None and not exists(sidecar_path(path)):
        kind = next((name for name in (PLAN, VOLUME) if KINDS[name].is_at(path)), None)
    row = KINDS.get(kind or RECORDING)
    if row is None or not row.described:
        return describe_recording(recognise(path, modality))
    return reader(row.described)(path)  # type: ignore[no-any-return]


def describe_comparison(path: Path) -> dict[str, object]:
    """Return what a comparison found. Raises :class:`EndoctError` where it cannot be read."""
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


def describe_panorama(path: Path) -> dict[str, object]:
    """Return what a panorama holds. Raises :class:`EndoctError` where it is damaged."""
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


def in_lines(facts: Mapping[str, object]) -> Iterator[str]:
    """Yield what :func:`describe` returned for people: a key and a value on each line."""
    for key, value in facts.items():
        if key == "missing" and "lines" in facts:
            continue  # the lines say it, too
        for number, text in enumerate(texts_of(value)):
            yield f"{'' if number else key:<{_KEY_WIDTH}}{text}"


def texts_of(value: object) -> list[str]:
    """Return a value of JSON as lines for people."""
    if isinstance(value, Mapping) and {"code", "what"} <= value.keys():  # a doubt
        return [f"{value['what']} ({value['code']})"]
    if isinstance(value, Mapping) and {"count", "files"} == value.keys():
        more = value["count"] - len(value["files"])
        return [f"{each['name']}: {each['why']}" for each in value["files"]] + [f"and {more} more"] * (more > 0)
    if isinstance(value, Mapping):
        return [f"{key}: {text}" for key, each in value.items() for text in texts_of(each)] or ["none"]
    if isinstance(value, list) and not all(isinstance(each, int | float) for each in value):
        return [text for each in value for text in texts_of(each)] or ["none"]
    if isinstance(value, list):
        return [", ".join(f"{each:g}" for each in value) or "none"]
    if isinstance(value, bool) or value is None:
        return [{True: "yes", False: "no", None: "none"}[value]]
    return [f"{value:g}" if isinstance(value, float) else str(value)]


def describe_recording(recognised: Recognised) -> dict[str, object]:
    """Return what a recording is, and the state of its sidecar. Raises :class:`EndoctError` where it cannot be used."""
    manifest, keys, stated = recognised.manifest, recognised.keys, recognised.stated
    fields, missing, needs = manifest.acquisition.model_fields, recognised.missing, recognised.needs
    is_complete = all(key in keys for key, field in fields.items() if field.is_required())
    stream = recognised.open() if is_complete else None
    previewed = recognised.sniff.preview
    facts: dict[str, object] = {"kind": "recording", "modality": manifest.name, "title": manifest.title}
    facts |= {"certainty": recognised.certainty, "seen": recognised.sniff.reason}
    if recognised.format:
        facts["format"] = recognised.format
    facts |= _size(manifest, previewed, stream, keys)
    if stated.keys:
        facts["stated"] = {"by": stated.by, **stated.keys}
    if stream is not None:
        facts["sidecar"] = stream.acquisition.model_dump(mode="json", exclude_none=True)
    if missing:
        lines = missing_lines(manifest.acquisition, keys, needs)
        lines = lines if recognised.says_modality else [f'modality = "{manifest.name}"', *lines]
        facts |= {"missing": missing, "lines": lines}
    remarks = (NONE if previewed is None else previewed.remarks) + remarks_of(stream)
    if stream is not None:
        remarks += Remarks(notes_on_gaps(stream.acquisition.positions_mm))
    facts |= {"doubts": [doubt.to_json() for doubt in remarks.doubts], "notes": list(remarks.notes)}
    if recognised.path.is_dir() and (unread := unread_next_to(recognised.path, manifest, texts_in(keys))).count:
        facts["unread"] = unread.to_json()
    return facts | {"next": _next(recognised)}


def _size(
    manifest: Manifest, preview: Preview | None, stream: FrameStream | None, keys: Mapping[str, Any]
) -> dict[str, object]:
    """Return how many frames there are, their axes in words, and what that is in mm and s, as far as it is known."""
    if preview is not None:
        n_frames, size, dtype = preview.n_frames, preview.size, preview.dtype
    elif stream is not None:
        samples = stream[0].samples
        n_frames, size, dtype = len(stream), f"{' × '.join(map(str, samples.shape))} samples", str(samples.dtype)
    else:
        return {}
    frames = f"{n_frames} {manifest.frame_dim}{'' if n_frames == 1 else 's'}"
    facts: dict[str, object] = {"frames": n_frames, "axes": f"{size}, {frames}", "dtype": dtype}
    pictures = () if preview is None else preview.pictures
    if pictures and (measures := manifest.acquisition.measures(keys, n_frames, pictures[0].shape)):
        facts["measures"] = measures
    return facts


def _next(recognised: Recognised) -> str:
    """Return what to do next with a recording."""
    if not recognised.missing:
        return f"endoct unroll {quote(path_text(recognised.path))} -o PANORAMA.zarr"
    if exists(recognised.sidecar):
        return f"fill in what is missing in {path_text(recognised.sidecar)}"
    asked = f" --modality {recognised.asked}" if recognised.asked else ""
    return f"endoct info {quote(path_text(recognised.path))}{asked} --write-sidecar"


def write_thumbnail(recognised: Recognised, path: Path) -> None:
    """Write the picture of a recording as a PNG. Raises :class:`EndoctError` where it has none, or ``path`` exists."""
    if path.suffix.lower() != ".png":
        raise EndoctError(f"a thumbnail is a PNG, which {path} is not", expected="FILE.png")
    if path.exists():
        raise EndoctError(f"{path} exists already", remedy="choose another file")
    png = picture_of(recognised)
    with new_output(path, THUMBNAIL, inputs=[recognised.path]) as scratch:
        scratch.write_bytes(png)


def picture_of(recognised: Recognised) -> bytes:
    """Return a PNG of the first, the middle and the last frame of a recording as its files hold them.

    Raises :class:`EndoctError` where it cannot be read, or its plug-in gives no pictures.
    """
    preview = recognised.sniff.preview
    if preview is None or not preview.pictures:
        raise EndoctError(f"the plug-in that reads {recognised.path} gives no pictures before it is opened")
    picture = side_by_side(preview.pictures)
    return cv2.imencode(".png", picture[..., ::-1] if picture.ndim == 3 else picture)[1].tobytes()


def side_by_side(pictures: tuple[NDArray[Any], ...]) -> NDArray[np.uint8]:
    """Return pictures of one shape next to each other, uint8 (row, column) or (row, column, RGB), on one grey scale."""
    low, high = np.percentile([np.percentile(picture, (DARKEST, BRIGHTEST)) for picture in pictures], (0, 100))
    rows, columns = pictures[0].shape[:2]
    scale = min(1.0, SIDE_PX / min(max(rows, columns), MOST_UNEVEN * min(rows, columns)))
    size = min(SIDE_PX, max(1, round(columns * scale))), min(SIDE_PX, max(1, round(rows * scale)))
    small = []
    for picture in pictures:
        grey = np.clip((picture.astype(np.float32) - low) * (255 / max(high - low, 1e-9)), 0, 255)
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
        small += [grey, np.full((grey.shape[0], GAP_PX, *grey.shape[2:]), 255, np.float32)]
    return np.asarray(np.concatenate(small[:-1], axis=1).round(), dtype=np.uint8)
