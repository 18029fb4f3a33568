"""Pictures of single frames on disk: one ``.npz`` each, readable with NumPy alone.

A file holds ``image``, ``metadata`` (JSON) and ``curve_0``, ``curve_1``, …, in the order of the metadata's
``curves``; ``seen_z_mm`` and ``seen_xy`` where it is known in which pixels places of the wall are seen.
"""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import plain_name
from endoct.base.files.npy import read_npz, write_npz
from endoct.modalities.contract import Picture, Seen

PICTURES = "pictures"
"""The folder of pictures in an output."""
MOST_PICTURES = 1000
MOST_SIDE = 20_000
MOST_ROWS = 100

_Place = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]


class _Metadata(BaseModel):
    """What a file says of its picture."""

    model_config = ConfigDict(strict=True, frozen=True)

    side: str
    place: int = Field(ge=0, le=1_000_000)
    order: int = Field(ge=0, le=1000)
    name: str
    title: str = Field(max_length=1000)
    x_label: str = Field(max_length=1000)
    y_label: str = Field(max_length=1000)
    x_extent: tuple[_Place, _Place]
    y_extent: tuple[_Place, _Place]
    curves: tuple[str, ...] = Field(max_length=100)
    about: str = Field(default="", max_length=1000)
    seen: bool = False


def save_pictures(folder: Path, side: str, frame_label: str, pictures: Sequence[Picture]) -> None:
    """Write ``pictures`` of one frame of ``side`` into ``folder`` as ``<side>-<frame_label>-<name>.npz``.

    ``frame_label`` is the frame's place in the order of ascending z, in digits. Raises :class:`EndoctError` where a
    picture has a name that no file can have, or is none that :func:`load_pictures` would read.
    """
    plain_name(side, "a side")
    plain_name(frame_label, "a frame")
    folder.mkdir(parents=True, exist_ok=True)
    for order, picture in enumerate(pictures):
        plain_name(picture.name, "a picture")
        metadata = {
            "side": side,
            "place": int(frame_label),
            "order": order,
            "name": picture.name,
            "title": picture.title,
            "x_label": picture.x_label,
            "y_label": picture.y_label,
            "x_extent": [float(v) for v in picture.x_extent],
            "y_extent": [float(v) for v in picture.y_extent],
            "curves": list(picture.curves),
            "about": picture.about,
            "seen": picture.seen is not None,
        }
        arrays: dict[str, Any] = {
            f"curve_{k}": _curve(np.asarray(curve, np.float64)) for k, curve in enumerate(picture.curves.values())
        }
        if picture.seen is not None:
            # a hundredth of a pixel of any picture
            arrays |= {"seen_z_mm": picture.seen.z_mm, "seen_xy": np.asarray(picture.seen.xy, np.float32)}
        arrays |= {"image": _image(np.asarray(picture.image)), "metadata": np.array(json.dumps(metadata))}
        write_npz(folder / f"{side}-{frame_label}-{picture.name}.npz", arrays)


def pictured_places(folder: Path, side: str) -> tuple[int, ...]:
    """Return of which frames of ``side`` pictures lie in ``folder``, by their places in the order of ascending z."""
    found = (re.match(rf"{re.escape(side)}-(\d{{1,7}})-", path.name) for path in folder.glob("*.npz"))
    return tuple(sorted({int(match[1]) for match in found if match}))


def load_pictures(
    folder: Path, side: str | None = None, place: int | None = None
) -> dict[str, dict[int, tuple[Picture, ...]]]:
    """Return what :func:`save_pictures` wrote: by side, then by the frame's place in the order of ascending z.

    Of all, or only of one frame, at ``place``, of one ``side``. A folder that does not exist holds no pictures. Raises
    :class:`EndoctError` where a file cannot be read.
    """
    loaded: list[tuple[str, int, int, Picture]] = []
    paths = sorted(folder.glob("*.npz" if side is None else f"{plain_name(side, 'a side')}-{place:04d}-*.npz"))
    if len(paths) > MOST_PICTURES:
        raise EndoctError(f"{folder} has too many pictures", found=str(len(paths)), expected=f"{MOST_PICTURES} at most")
    for path in paths:
        with refusing(f"the picture {path} cannot be read", remedy="run the comparison again"):
            arrays = read_npz(path)
            metadata = _Metadata.model_validate_json(str(arrays["metadata"]))
            picture = Picture(
                name=metadata.name,
                title=metadata.title,
                image=_image(arrays["image"]),
                x_label=metadata.x_label,
                y_label=metadata.y_label,
                x_extent=metadata.x_extent,
                y_extent=metadata.y_extent,
                curves={label: _curve(arrays[f"curve_{k}"]) for k, label in enumerate(metadata.curves)},
                about=metadata.about,
                seen=_seen(arrays["seen_z_mm"], arrays["seen_xy"]) if metadata.seen else None,
            )
        plain_name(metadata.name, f"the picture {path}")
        loaded.append((plain_name(metadata.side, f"a side in {path}"), metadata.place, metadata.order, picture))
    pictures: dict[str, dict[int, tuple[Picture, ...]]] = {}
    for side, place, _, picture in sorted(loaded, key=lambda entry: entry[:3]):
        of_side = pictures.setdefault(side, {})
        of_side[place] = (*of_side.get(place, ()), picture)
    return pictures


def _image(samples: NDArray[Any]) -> NDArray[Any]:
    colours = samples.ndim == 3 and samples.shape[2] == 3
    fits = samples.size > 0 and max(samples.shape) <= MOST_SIDE
    if samples.dtype.kind not in "buf" or not (samples.ndim == 2 or colours) or not fits:
        expected = f"(row, column) or (row, column, 3), at most {MOST_SIDE} a side"
        raise EndoctError("it holds no image", found=f"{samples.dtype} {samples.shape}", expected=expected)
    return samples


def _curve(points: NDArray[Any]) -> Coordinates:
    if points.dtype.kind != "f" or points.ndim != 2 or points.shape[1] != 2:
        raise EndoctError("a curve cannot be used", found=f"{points.dtype} {points.shape}", expected="(n, 2) floats")
    return np.asarray(points, dtype=np.float64)


def _seen(z_mm: NDArray[Any], xy: NDArray[Any]) -> Seen:
    fits = z_mm.ndim == 1 and xy.ndim == 3 and xy.shape[::2] == (z_mm.size, 2) and z_mm.size > 0 and xy.size > 0
    if not (fits and z_mm.dtype.kind == xy.dtype.kind == "f" and z_mm.size <= MOST_ROWS and xy.shape[1] <= MOST_SIDE):
        raise EndoctError("its places cannot be used", found=f"{xy.dtype} {xy.shape}", expected="(n_z, n_theta, 2)")
    if not np.isfinite(z_mm).all() or np.isinf(xy).any() or (np.diff(z_mm) <= 0).any():
        raise EndoctError("its places cannot be used", found="numbers that are no places", expected="ascending z")
    return Seen(np.asarray(z_mm, np.float64), np.asarray(xy, np.float64))
