"""Outlines and labels drawn in other programs, as masks on the samples of a panorama.

- A label or mask image, PNG, TIFF, …, also as napari saves a labels layer. What is not zero is cell; on a transparent
  ground, what is opaque.
- A Zarr array of labels, or an OME-Zarr image or label group. Its finest level is read.
- The ``.csv`` of a napari shapes layer: polygons, rectangles, ellipses, in (row, column) of the panorama's samples.
- The ``.roi`` and ``.zip`` of Fiji's (ImageJ's) ROI manager: polygons, freehands, rectangles, ovals, in its (x, y).

Outlines may run over the seam of θ: columns beyond the last go on at the first.
"""

import csv
import io
import logging
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skimage.draw import polygon

from endoct.base.arrays import Coordinates, Mask
from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import inside, read_small, read_start
from endoct.base.files.json_values import an_object, read_object
from endoct.base.files.npy import open_zip
from endoct.base.zarr.zarr_metadata import LABELS, Declared, declared
from endoct.base.zarr.zarr_store import check_array, read_array
from endoct.modalities.reading.recording import open_stack

OUTLINE_SUFFIXES = (".csv", ".roi", ".zip")
_STORE_FILES = ("zarr.json", ".zarray", ".zgroup")
_NAPARI_COLUMNS = ("index", "shape-type", "vertex-index", "axis-0", "axis-1")
_CLOSED = ("polygon", "rectangle", "ellipse")
_ELLIPSE_POINTS = 72
_MOST_BYTES = 64_000_000
"""A file of outlines may have this size at most, expanded."""
_MOST_OUTLINES = 10_000
_FARTHEST_TURNS, _MOST_TURNS = 8, 3
"""An outline may begin some turns away, but hardly run around the bore."""
_FARTHEST_ROW = 1e6


def read_drawing(path: Path, shape: tuple[int, int] | None) -> Mask:
    """Return the cells drawn in ``path``, bool (n_z, n_theta).

    ``shape`` is that of the panorama drawn on; outlines need it, images have one themselves. Raises
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
    """Whether ``path`` is a Zarr store with one plane of whole numbers or truth values, as labels are."""
    if not any((path / name).is_file() for name in _STORE_FILES):
        return False
    try:
        labels = _finest(path)
    except EndoctError:
        return False
    return sum(length > 1 for length in labels.shape) == 2


def _stored(path: Path) -> Mask:
    if not any((path / name).is_file() for name in _STORE_FILES):
        raise EndoctError(
            f"{path} is no mask",
            found="a folder",
            expected="one image drawn over a panorama, PNG or TIFF, or a Zarr store of labels",
        )
    labels = _finest(path)
    if len(labels.shape) < 2 or any(length != 1 for length in labels.shape[:-2]) or 0 in labels.shape:
        raise EndoctError(f"{path} is no mask", found=f"an array of shape {labels.shape}", expected="one plane, z × θ")
    check_array(labels, whole=False)
    return np.asarray(read_array(labels).reshape(labels.shape[-2:]) != 0)


def _finest(path: Path) -> Declared:
    """Return the array at ``path``, or that of the finest level of the OME-Zarr group there."""
    with refusing(
        f"{path} holds no labels",
        expected="a Zarr array, or an OME-Zarr group with its levels listed",
        remedy="name the array or the labels/NAME group in it",
    ):
        third = (path / "zarr.json").is_file()
        if not third and (path / ".zarray").is_file():
            return declared(path, LABELS)
        stored = read_object(path / ("zarr.json" if third else ".zattrs"))
        if third and stored.get("node_type") == "array":
            return declared(path, LABELS)
        attributes = an_object(stored.get("attributes", {}), "its attributes") if third else stored
        listed = an_object(attributes.get("ome", attributes), "'ome'")["multiscales"][0]["datasets"][0]["path"]
        finest = inside(path, listed, f"the finest level of {path}")
        folders = [finest, *finest.parents]
        if any(folder.is_symlink() for folder in folders[: folders.index(path)]):
            raise EndoctError(f"{finest} cannot be part of a store", found="a link", expected="files and folders")
        return declared(finest, LABELS)


def _image(path: Path) -> Mask:
    if read_start(path, 3) == b"\xff\xd8\xff":
        raise EndoctError(
            f"the mask {path} does not say what is cell",
            found="a JPEG, whose losses leave black samples that are not zero",
            expected="PNG or TIFF",
            remedy="draw it in a format without losses",
        )
    stack = open_stack(path)
    if len(stack) != 1:
        raise EndoctError(f"{path} is no mask", found=f"{len(stack)} images", expected="one")
    samples = stack.stored(0)
    if samples.dtype.kind == "f" and not np.isfinite(samples).all():
        raise EndoctError(f"the mask {path} is not finite", found="NaN or infinity", expected="numbers")
    if stack.palette is not None:
        return _numbered(samples, stack.palette, path)
    if samples.ndim == 2:
        return np.asarray(samples != 0)
    has_opacity = samples.shape[2] in (2, 4)
    colours, opacity = (samples[..., :-1], samples[..., -1]) if has_opacity else (samples, None)
    drawn = np.any(colours != 0, axis=2)
    if opacity is None or (opacity != 0).all():
        return np.asarray(drawn)
    return _opaque(drawn, opacity != 0, path)


def _opaque(drawn: Mask, opaque: Mask, path: Path) -> Mask:
    """Return what is drawn on a transparent ground, whatever its colour."""
    black = opaque & ~drawn
    if black.any() and (opaque & drawn).any():
        raise EndoctError(
            f"the mask {path} does not say what is cell",
            found="transparent samples, black ones and others",
            expected="cells on a ground that is either transparent or black",
            remedy="save it without transparency, cells white on black",
        )
    return opaque


def _numbered(labels: NDArray[Any], palette: NDArray[Any], path: Path) -> Mask:
    """Return where labels are not 0.

    Raises :class:`EndoctError` where their colours say that another label is the ground.
    """
    black = palette.reshape(len(palette), -1).max(axis=1) == 0
    if not black[0] and black[labels].any():
        raise EndoctError(
            f"the mask {path} does not say what is cell",
            found="a palette in which 0 is not black, and another number is",
            expected="0, or black, where there is no cell",
            remedy="save it as grey values, cells white on black",
        )
    return np.asarray(labels != 0)


def _filled(path: Path, shape: tuple[int, int] | None) -> Mask:
    if shape is None:
        raise EndoctError(
            f"nothing says where the outlines in {path} lie",
            expected="a panorama that they were drawn on",
            remedy="compare that panorama, or save the drawing as a label image with a sidecar",
        )
    if not path.is_file():
        raise EndoctError(f"{path} does not exist", remedy="check the path")
    cell = np.zeros(shape, np.bool_)
    for count, outline in enumerate(_napari(path) if path.suffix.lower() == ".csv" else _fiji(path)):
        if count == _MOST_OUTLINES:
            raise EndoctError(f"{path} has too many outlines", expected=f"{_MOST_OUTLINES} at most")
        with refusing(f"an outline in {path} cannot be used"):
            cell |= fill(outline, shape)
    return cell


def fill(outline: Coordinates, shape: tuple[int, int]) -> Mask:
    """Return the samples inside a closed ``outline``, float64 (n, 2) as (row, column), on the circle of columns.

    Raises :class:`EndoctError` where it is no outline, not finite, or reaches farther than a few turns.
    """
    n_z, n_theta = shape
    if outline.ndim != 2 or outline.shape[1] != 2 or len(outline) < 3:
        raise EndoctError("an outline encloses nothing", found=f"{len(outline)} points", expected="three at least")
    farthest = np.abs(outline).max(axis=0)
    if not np.isfinite(outline).all() or farthest[0] > _FARTHEST_ROW or farthest[1] > _FARTHEST_TURNS * n_theta:
        raise EndoctError(
            "an outline lies far outside the panorama",
            found=f"row {farthest[0]:g}, column {farthest[1]:g}",
            expected=f"numbers, columns within {_FARTHEST_TURNS} turns of {n_theta}",
        )
    turns_before = int(np.floor(outline[:, 1].min() / n_theta))
    turns = int(np.floor(outline[:, 1].max() / n_theta)) - turns_before + 1
    if turns > _MOST_TURNS:
        raise EndoctError("an outline runs around the bore", found=f"{turns} turns", expected=f"{_MOST_TURNS} at most")
    unrolled = np.zeros((n_z, turns * n_theta), np.bool_)
    unrolled[polygon(outline[:, 0], outline[:, 1] - turns_before * n_theta, unrolled.shape)] = True
    return np.asarray(unrolled.reshape(n_z, turns, n_theta).any(axis=1))


def _napari(path: Path) -> Iterator[Coordinates]:
    """Yield the outlines in the CSV of a napari shapes layer."""
    data = read_small(path, _MOST_BYTES)
    with refusing(f"{path} cannot be read", remedy="save the shapes layer again"):
        reader = csv.DictReader(io.StringIO(data.decode("utf-8-sig"), newline=""))
        columns = list(reader.fieldnames or ())
        if not set(_NAPARI_COLUMNS) <= set(columns) or "axis-2" in columns:
            raise _no_shapes(path, columns)
        shapes: dict[str, list[tuple[str, float, float]]] = {}
        for row in reader:
            index, kind, _, z, theta = (row[name] for name in _NAPARI_COLUMNS)
            if index is None or kind is None:
                raise EndoctError(f"{path} cannot be read", found=f"a row without its shape, line {reader.line_num}")
            try:
                shapes.setdefault(index, []).append((kind, float(z), float(theta)))
            except (TypeError, ValueError) as error:
                raise EndoctError(f"shape {index[:20]} in {path} cannot be read", found=str(error)) from error
    if not shapes:
        raise _no_shapes(path, [])
    for index, vertices in shapes.items():
        yield _shape(f"shape {index[:20]} in {path}", vertices)


def _no_shapes(path: Path, columns: list[str]) -> EndoctError:
    return EndoctError(
        f"{path} is no napari shapes layer on a panorama",
        found=", ".join(name for name in columns if name)[:200] or "no rows",
        expected=", ".join(_NAPARI_COLUMNS),
        remedy="draw on the panorama alone and save the shapes layer as CSV",
    )


def _shape(name: str, vertices: list[tuple[str, float, float]]) -> Coordinates:
    kind = vertices[0][0]
    if kind not in _CLOSED:
        raise EndoctError(f"{name} encloses nothing", found=kind[:40], expected=", ".join(_CLOSED), remedy="remove it")
    points = np.array([(row, column) for _, row, column in vertices])
    if not all(math.isfinite(value) for value in points.ravel()):
        raise EndoctError(f"{name} cannot be used", found="NaN or infinity", expected="numbers")
    if len(points) < 3 or (kind == "ellipse" and len(points) != 4):
        expected = "four corners" if kind == "ellipse" else "three at least"
        raise EndoctError(f"{name} encloses nothing", found=f"{len(points)} points", expected=expected)
    return _ellipse(points) if kind == "ellipse" else points


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
    # an EndoctError says what is wrong with a file; the library that reads it need not say so as well
    logging.getLogger("roifile").addHandler(logging.NullHandler())
    kinds = roifile.ROI_TYPE
    for data in _regions(path):
        with refusing(f"{path} holds no regions of ImageJ", remedy="save them again"):
            roi: Any = roifile.ImagejRoi.frombytes(data)
            if roi.roitype not in (kinds.POLYGON, kinds.FREEHAND, kinds.TRACED, kinds.RECT, kinds.OVAL):
                raise EndoctError(
                    f"'{roi.name[:40]}' in {path} encloses nothing",
                    found=kinds(roi.roitype).name.lower(),
                    expected="a polygon, freehand, rectangle or oval",
                    remedy="remove it",
                )
            outline = np.asarray(roi.coordinates(), dtype=np.float64)[:, ::-1] - 0.5
        yield outline


def _regions(path: Path) -> Iterator[bytes]:
    """Yield the bytes of one region, or of all in a ZIP file."""
    if path.suffix.lower() != ".zip":
        yield read_small(path, _MOST_BYTES)
        return
    none = f"{path} holds no regions of ImageJ"
    with open_zip(path, _MOST_OUTLINES, _MOST_BYTES, none) as members:
        regions = [members.read(name) for name in members.namelist() if name.lower().endswith(".roi")]
    if not regions:
        raise EndoctError(none, found="no .roi in it", remedy="save them again")
    yield from regions
