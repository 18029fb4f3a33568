"""OME-Zarr: a folder, after NGFF 0.4 on Zarr 2 and 0.5 on Zarr 3 (ngff.openmicroscopy.org).

``multiscales`` names the axes, with units, and lists one image at several resolutions, each with its scale; the finest
is read. A frame is a plane along z or t, whichever has several; y are rows, x columns. A converter of Bio-Formats
(bioformats2raw, layout 3) puts images into groups 0, 1, … below. The traps:

- missing chunks are the fill value, as writers leave out what is black, but a frame without any was not copied;
- scales without a unit mean nothing;
- a store may hold links, codecs and sizes of any kind.
"""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import check_array_size, exists, inside
from endoct.base.files.json_values import read_object
from endoct.base.zarr.zarr_metadata import LABELS, Allowed, Declared, declared
from endoct.base.zarr.zarr_store import DAMAGED, check_chunk
from endoct.modalities.reading.format import Files, Format, Frames, Stated
from endoct.modalities.reading.physical_sizes import MM, SECONDS, Steps, in_units

PICTURES = Allowed(LABELS.types - {"bool"} | {"float32", "float64"}, LABELS.codecs)
VERSIONS = {"0.4": 2, "0.5": 3}
"""Each version of the format is on one of Zarr."""
MOST_CHUNKS_A_FRAME = 2_000
"""A turn of 14 000 A-scans has 1752 of 64 × 64 samples; many more take seconds to look at."""
PLAIN = "export it as TIFF, one page a frame"


@dataclass(frozen=True)
class _Image:
    """The finest array of an image; ``axes`` by name; ``steps`` that the file states."""

    array: Declared
    axes: tuple[str, ...]
    frames: str
    steps: Steps

    @property
    def n_frames(self) -> int:
        return self.array.shape[self.axes.index(self.frames)] if self.frames in self.axes else 1


@dataclass(frozen=True, eq=False)
class _ReadPlanes:
    """Reads one plane; picklable, safe among threads. Each chunk is checked before Zarr decodes it."""

    image: _Image

    def __call__(self, index: int) -> NDArray[Any]:
        """Return one frame, (row, column)."""

        image, array = self.image, self.image.array
        chunks = [
            [index // size] if axis == image.frames else range(-(-length // size))
            for axis, length, size in zip(image.axes, array.shape, array.chunk, strict=True)
        ]
        found = 0
        with refusing(f"frame {index} of {array.folder} cannot be read", remedy=DAMAGED):
            folder = array.folder.resolve()
            for place in itertools.product(*chunks):
                prefix, separator = array.key
                name = separator.join([*([prefix] if prefix else []), *map(str, place)])
                if not exists(folder / name) and not (folder / name).is_symlink():
                    continue
                if (folder / name).is_symlink() or (folder / name).resolve() != folder / name:
                    raise EndoctError(f"{folder / name} cannot be part of a store", found="a link", remedy=DAMAGED)
                check_chunk(array, name)
                found += 1
            if not found:
                raise EndoctError(
                    f"frame {index} of {array.folder} is not there", found="none of its chunks", remedy=DAMAGED
                )
            at = tuple(index if axis == image.frames else slice(None) if axis in "yx" else 0 for axis in image.axes)
            stored: Any = zarr.open_array(array.folder, mode="r", zarr_format=3 if array.zarr_format == 3 else 2)
            plane = np.asarray(stored[at])
        if image.axes.index("y") > image.axes.index("x"):
            plane = plane.T
        return np.ascontiguousarray(plane, plane.dtype.newbyteorder("="))


def _claims(path: Path) -> bool:
    try:
        _image_group(path)
    except (EndoctError, OSError):
        return False
    return True


def _open(files: Files) -> Frames:
    image = _image(files[0])
    return Frames(image.n_frames, _ReadPlanes(image), remarks=image.steps.remarks)


def _states(files: Files) -> Stated:
    return _image(files[0]).steps.stated(f"the multiscales of {files[0].name}")


def _attributes(group: Path) -> dict[str, Any] | None:
    """Return the attributes of a group of Zarr 3 or 2 in which OME's lie; None where there is none."""
    if exists(group / "zarr.json"):
        found = read_object(group / "zarr.json").get("attributes")
        within = found.get("ome") if isinstance(found, dict) else None
        return within if isinstance(within, dict) else None
    return read_object(group / ".zattrs") if exists(group / ".zattrs") else None


def _image_group(path: Path) -> tuple[Path, dict[str, Any]]:
    """Return the group that holds the image, with its attributes. Raises :class:`EndoctError` where not one does."""
    for group in (path, path / "0"):
        attributes = _attributes(group) or {}
        if "multiscales" in attributes:
            return group, attributes
        if "bioformats2raw.layout" not in attributes or exists(path / "1"):
            break
    raise EndoctError(f"{path} is no OME-Zarr image", remedy=DAMAGED)


def _image(path: Path) -> _Image:
    group, attributes = _image_group(path)
    with refusing(f"the multiscales of {path} cannot be used", remedy=PLAIN):
        listed = attributes["multiscales"]
        if len(listed) != 1:
            raise EndoctError(f"{path} holds several images", found=f"{len(listed)} multiscales", remedy=PLAIN)
        version = str(attributes.get("version") or listed[0].get("version") or "")
        if version not in VERSIONS:
            raise EndoctError(
                f"{path} is not read", found=f"OME-Zarr {version[:20] or 'of no stated version'}", expected="0.4 or 0.5"
            )
        axes = tuple(str(axis["name"]) for axis in listed[0]["axes"])
        units = {str(axis["name"]): axis.get("unit") for axis in listed[0]["axes"]}
        level = listed[0]["datasets"][0]  # the finest comes first, by the standard
        scale = _scale(listed[0], len(axes)) * _scale(level, len(axes))
        folder = inside(group, level["path"], f"a level of {path}")
    array = _checked(path, declared(folder, PICTURES), axes, VERSIONS[version])
    steps = {axis: (float(step), units[axis]) for axis, step in zip(axes, scale, strict=True)}
    several = [axis for axis in "tz" if axis in axes and array.shape[axes.index(axis)] > 1]
    frames = several[0] if several else "z"
    frame_mm = in_units(*steps["z"], MM) if frames == "z" in steps else None
    frame_s = in_units(*steps["t"], SECONDS) if frames == "t" else None
    return _Image(array, axes, frames, Steps(in_units(*steps["y"], MM), frame_mm, frame_s))


def _scale(of: Mapping[str, Any], n_axes: int) -> NDArray[np.float64]:
    """Return the scale of every axis, 1 where none is stated."""
    for transformation in of.get("coordinateTransformations", []):
        if transformation.get("type") == "scale":
            scale = np.array(transformation["scale"], np.float64)
            if scale.shape != (n_axes,):
                raise ValueError(f"a scale of {scale.size} axes for {n_axes}")
            return scale
    return np.ones(n_axes)


def _checked(path: Path, array: Declared, axes: tuple[str, ...], zarr_format: int) -> Declared:
    """Return ``array`` if it is one of frames. Raises :class:`EndoctError` where it is not, or is too large."""
    several = [axis for axis, length in zip(axes, array.shape, strict=False) if length > 1 and axis not in "yx"]
    if (
        len(axes) != len(array.shape)
        or len(set(axes)) < len(axes)
        or not {"y", "x"} <= set(axes) <= set("tczyx")
        or len(several) > 1
        or "c" in several
        or 0 in array.shape
        or array.zarr_format != zarr_format
    ):
        raise EndoctError(
            f"{path} has the wrong dimensions",
            found=", ".join(f"{axis[:20]} = {n}" for axis, n in zip(axes, array.shape, strict=False))[:200]
            + ("" if array.zarr_format == zarr_format else f" in Zarr {array.zarr_format}"),
            expected="frames along z or t, one channel",
            remedy=PLAIN,
        )
    frame = [length if axis in "yx" else 1 for axis, length in zip(axes, array.shape, strict=True)]
    n_chunks = [-(-n // size) for n, size in zip(frame, array.chunk, strict=True)]
    for shape in (frame, array.chunk, [n * size for n, size in zip(n_chunks, array.chunk, strict=True)]):
        check_array_size(shape, array.itemsize, f"a frame of {path}")
    if np.prod(n_chunks, dtype=float) > MOST_CHUNKS_A_FRAME:
        raise EndoctError(f"{path} has too many chunks", expected=f"{MOST_CHUNKS_A_FRAME} a frame at most")
    return array


OME_ZARR = Format("OME-Zarr", _claims, _open, _states, is_folder=True)
