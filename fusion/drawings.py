"""Outlines and labels drawn in other programs, as masks on the samples of a panorama.

- a label or mask image, PNG, TIFF, …, also as napari saves a labels layer: what is not zero is cell;
- a Zarr array of labels, or an OME-Zarr image or label group, whose finest level is read;
- ``.csv`` of a napari shapes layer: polygons, rectangles, ellipses, in (row, column) of the panorama's samples;
- ``.roi`` and ``.zip`` of Fiji's (ImageJ's) ROI manager: polygons, freehands, rectangles, ovals, in its (x, y).

Outlines may run over the seam of θ: columns beyond the last go on at the first.
"""

import csv
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from skimage.draw import polygon

from endoct.modalities.recording import open_stack
from endoct.stitching.arrays import Coordinates, Mask
from endoct.stitching.errors import EndoctError

OUTLINE_SUFFIXES = (".csv", ".roi", ".zip")
_STORE_FILES = ("zarr.json", ".zarray", ".zgroup")
_NAPARI_COLUMNS = ("index", "shape-type", "vertex-index", "axis-0", "axis-1")
_CLOSED = ("polygon", "rectangle", "ellipse")
_ELLIPSE_POINTS = 72


def read_drawing(path: Path, shape: tuple[int, int] | None) -> Mask:
    """Return the cells drawn in ``path``, bool (n_z, n_theta).

    ``shape`` is that of the panorama drawn on, which outlines need and images have themselves. Raises
    :class:`EndoctError` where the file cannot be read or shows no cells.
    """
    if path.is_dir():
        cell = _stored(path)
    else:
        cell = _image(path) if path.suffix.lower() not in OUTLINE_SUFFIXES else _filled(path, shape)
    if not cell.any() or cell.all():
        raise EndoctError(f"the mask {path} shows no cells", found="one and the same value everywhere")
    return cell


def is_label_store(path: Path) -> bool:
    """Say whether ``path`` is a Zarr store with one plane of whole numbers or truth values, as labels are."""
    if not any((path / name).is_file() for name in _STORE_FILES):
        return False
    try:
        labels = _finest(path)
    except EndoctError:
        return False
    return labels.dtype.kind in "uib" and sum(length > 1 for length in labels.shape) == 2


def _stored(path: Path) -> Mask:
    if not any((path / name).is_file() for name in _STORE_FILES):
        raise EndoctError(
            f"{path} is no mask",
            found="a folder",
            expected="one image drawn over a panorama, PNG or TIFF, or a Zarr store of labels",
        )
    labels = _finest(path)
    if labels.ndim < 2 or any(length != 1 for length in labels.shape[:-2]):
        raise EndoctError(f"{path} is no mask", found=f"an array of shape {labels.shape}", expected="one plane, z × θ")
    return np.asarray(np.asarray(labels[...]).reshape(labels.shape[-2:]) != 0)


def _finest(path: Path) -> Any:  # zarr.Array, whose type does not say that it can be indexed
    """Return the array at ``path``, or of the OME-Zarr group there the one of the finest level."""
    try:
        node = zarr.open(path, mode="r")
        if isinstance(node, zarr.Array):
            return node
        told: Any = node.attrs.get("ome", node.attrs)
        return node[told["multiscales"][0]["datasets"][0]["path"]]
    except (OSError, ValueError, KeyError, TypeError, IndexError) as error:
        raise EndoctError(
            f"{path} holds no labels",
            found=str(error) or type(error).__name__,
            expected="a Zarr array, or an OME-Zarr group with its levels listed",
            remedy="name the array or the labels/NAME group in it",
        ) from error


def _image(path: Path) -> Mask:
    stack = open_stack(path)
    if len(stack) != 1:
        raise EndoctError(f"{path} is no mask", found=f"{len(stack)} images", expected="one")
    samples = stack[0]
    return np.asarray(samples != 0 if samples.ndim == 2 else np.any(samples != 0, axis=2))


def _filled(path: Path, shape: tuple[int, int] | None) -> Mask:
    if shape is None:
        raise EndoctError(
            f"nothing says where the outlines in {path} lie",
            expected="a panorama that they were drawn on",
            remedy="compare that panorama, or save the drawing as a label image with a sidecar",
        )
    if not path.is_file():
        raise EndoctError(f"{path} does not exist", remedy="check the path")
    outlines = list(_napari(path) if path.suffix.lower() == ".csv" else _fiji(path))
    cell = np.zeros(shape, np.bool_)
    for outline in outlines:
        cell |= fill(outline, shape)
    return cell


def fill(outline: Coordinates, shape: tuple[int, int]) -> Mask:
    """Return the samples inside a closed ``outline``, float64 (n, 2) as (row, column), on the circle of columns."""
    n_z, n_theta = shape
    turns_before = int(np.floor(outline[:, 1].min() / n_theta))
    turns = int(np.floor(outline[:, 1].max() / n_theta)) - turns_before + 1
    unrolled = np.zeros((n_z, turns * n_theta), np.bool_)
    unrolled[polygon(outline[:, 0], outline[:, 1] - turns_before * n_theta, unrolled.shape)] = True
    return np.asarray(unrolled.reshape(n_z, turns, n_theta).any(axis=1))


def _napari(path: Path) -> Iterator[Coordinates]:
    """Yield the outlines in the CSV of a napari shapes layer."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise EndoctError(f"{path} cannot be read", found=str(error), remedy="save the shapes layer again") from error
    if not rows or not set(_NAPARI_COLUMNS) <= set(rows[0]) or "axis-2" in rows[0]:
        raise EndoctError(
            f"{path} is no napari shapes layer on a panorama",
            found=", ".join(name for name in rows[0] if name) if rows else "no rows",
            expected=", ".join(_NAPARI_COLUMNS),
            remedy="draw on the panorama alone and save the shapes layer as CSV",
        )
    shapes: dict[str, list[dict[str, str]]] = {}
    for row in rows:
        shapes.setdefault(row["index"], []).append(row)
    for index, vertices in shapes.items():
        kind = vertices[0]["shape-type"]
        if kind not in _CLOSED:
            raise EndoctError(
                f"shape {index} in {path} encloses nothing", found=kind, expected=", ".join(_CLOSED), remedy="remove it"
            )
        try:
            points = np.array([[float(v["axis-0"]), float(v["axis-1"])] for v in vertices])
        except (TypeError, ValueError) as error:
            raise EndoctError(f"shape {index} in {path} cannot be read", found=str(error)) from error
        yield _ellipse(points) if kind == "ellipse" else points


def _ellipse(corners: Coordinates) -> Coordinates:
    """Return the ellipse that touches the sides of a parallelogram, float64 (4, 2) in order, in their middles."""
    centre = corners.mean(axis=0)
    one, other = (corners[1] - corners[0]) / 2, (corners[3] - corners[0]) / 2
    turn = np.linspace(0, 2 * np.pi, _ELLIPSE_POINTS, endpoint=False)[:, np.newaxis]
    return np.asarray(centre + np.cos(turn) * one + np.sin(turn) * other)


def _fiji(path: Path) -> Iterator[Coordinates]:
    """Yield the outlines of ImageJ's regions of interest; pixel (0, 0) reaches from corner (0, 0) to (1, 1)."""
    try:
        import roifile
    except ImportError as error:
        raise EndoctError(
            f"{path} needs a library that is not installed", found="no roifile", remedy="pip install 'endoct[fiji]'"
        ) from error
    try:
        read: Any = roifile.roiread(path)
    except (OSError, ValueError, zipfile.BadZipFile, IndexError) as error:
        raise EndoctError(f"{path} holds no regions of ImageJ", found=str(error), remedy="save them again") from error
    for roi in read if isinstance(read, list) else [read]:
        kinds = roifile.ROI_TYPE
        if roi.roitype not in (kinds.POLYGON, kinds.FREEHAND, kinds.TRACED, kinds.RECT, kinds.OVAL):
            raise EndoctError(
                f"'{roi.name}' in {path} encloses nothing",
                found=kinds(roi.roitype).name.lower(),
                expected="a polygon, freehand, rectangle or oval",
                remedy="remove it",
            )
        yield np.asarray(roi.coordinates(), dtype=np.float64)[:, ::-1] - 0.5
