"""Pictures of single frames on disk: one ``.npz`` each, readable with NumPy alone.

A file holds ``image``, ``metadata`` (JSON) and ``curve_0``, ``curve_1``, …, in the order of the metadata's
``curves``.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from endoct.modalities.contract import Picture
from endoct.stitching.errors import EndoctError


def save_pictures(folder: Path, side: str, frame_label: str, pictures: Sequence[Picture]) -> None:
    """Write ``pictures`` of one frame of ``side`` into ``folder`` as ``<side>-<frame_label>-<name>.npz``.

    ``frame_label`` is the frame's place in the order of ascending z, in digits.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for order, picture in enumerate(pictures):
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
        }
        arrays: dict[str, Any] = {
            f"curve_{k}": np.asarray(curve, np.float64) for k, curve in enumerate(picture.curves.values())
        }
        np.savez_compressed(
            folder / f"{side}-{frame_label}-{picture.name}.npz",
            image=picture.image,
            metadata=np.array(json.dumps(metadata, ensure_ascii=False)),
            **arrays,
        )


def load_pictures(folder: Path) -> dict[str, dict[int, tuple[Picture, ...]]]:
    """Return what :func:`save_pictures` wrote: by side, then by the frame's place in the order of ascending z.

    A folder that does not exist holds no pictures. Raises :class:`EndoctError` where a file cannot be read.
    """
    found: list[tuple[str, int, int, Picture]] = []
    for path in sorted(folder.glob("*.npz")):
        try:
            with np.load(path, allow_pickle=False) as file:
                metadata = json.loads(str(file["metadata"]))
                picture = Picture(
                    name=metadata["name"],
                    title=metadata["title"],
                    image=file["image"],
                    x_label=metadata["x_label"],
                    y_label=metadata["y_label"],
                    x_extent=tuple(metadata["x_extent"]),
                    y_extent=tuple(metadata["y_extent"]),
                    curves={label: file[f"curve_{k}"] for k, label in enumerate(metadata["curves"])},
                )
        except (OSError, ValueError, KeyError) as error:
            raise EndoctError(
                f"the picture {path} cannot be read", found=str(error), remedy="run the comparison again"
            ) from error
        found.append((metadata["side"], metadata["place"], metadata["order"], picture))
    pictures: dict[str, dict[int, tuple[Picture, ...]]] = {}
    for side, place, _, picture in sorted(found, key=lambda entry: entry[:3]):
        of_side = pictures.setdefault(side, {})
        of_side[place] = (*of_side.get(place, ()), picture)
    return pictures
