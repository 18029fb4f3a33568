"""Outlines drawn in other programs, filled on the samples of a panorama; they may run over the seam of θ.

- The ``.csv`` of a napari shapes layer: polygons, rectangles, ellipses, in (row, column) of the panorama's samples.
- The ``.roi`` and ``.zip`` of Fiji's (ImageJ's) ROI manager: polygons, freehands, rectangles, ovals, and areas composed
  of several, in its (x, y).
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
from endoct.base.files.files import read_small
from endoct.base.files.npy import open_zip

OUTLINE_SUFFIXES = (".csv", ".roi", ".zip")
_NAPARI_COLUMNS = ("index", "shape-type", "vertex-index", "axis-0", "axis-1")
_CLOSED = ("polygon", "rectangle", "ellipse")
_ELLIPSE_POINTS = 72
_MOST_BYTES = 64_000_000
"""A file of outlines may have this size at most, expanded."""
_MOST_OUTLINES = 10_000
_FARTHEST_TURNS, _MOST_TURNS = 8, 3
"""An outline may begin some turns away, but hardly run around the bore."""
_FARTHEST_ROW = 1e6
_MOST_TESTS = 2e10
"""Every sample around an outline is held against every corner: a minute for so many."""
_MOST_OF_PATH = 1_000_000
_POINTS_OF = {0: 1, 1: 1, 2: 2, 3: 3, 4: 0}
"""Points that a segment of an area of Java takes: move, line, quadratic and cubic curve, close (``PathIterator``)."""
_CURVE = np.linspace(0, 1, 17)[1:, np.newaxis]


def filled(path: Path, shape: tuple[int, int] | None) -> Mask:
    """Return the samples inside the outlines in ``path``, bool (n_z, n_theta).

    Raises :class:`EndoctError` where the file cannot be read, an outline cannot be used, or no ``shape`` is given.
    """
    if shape is None:
        raise EndoctError(
            f"nothing says where the outlines in {path} lie",
            expected="a panorama that they were drawn on",
            remedy="compare that panorama, or save the drawing as a label image with a sidecar",
        )
    if not path.is_file():
        raise EndoctError(f"{path} does not exist", remedy="check the path")
    cell = np.zeros(shape, np.bool_)
    count = n_tests = 0
    for area in _napari(path) if path.suffix.lower() == ".csv" else _fiji(path):
        count += len(area)
        if count > _MOST_OUTLINES:
            raise EndoctError(f"{path} has too many outlines", expected=f"{_MOST_OUTLINES} at most")
        with refusing(f"an outline in {path} cannot be used"):
            inside = fill(area[0], shape)
            for outline in area[1:]:
                inside ^= fill(outline, shape)
            cell |= inside
            n_tests += sum(_tests(outline, shape) for outline in area)
            _check_tests(n_tests)
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
    _check_tests(_tests(outline, shape))
    unrolled = np.zeros((n_z, turns * n_theta), np.bool_)
    unrolled[polygon(outline[:, 0], outline[:, 1] - turns_before * n_theta, unrolled.shape)] = True
    return np.asarray(unrolled.reshape(n_z, turns, n_theta).any(axis=1))


def _tests(outline: Coordinates, shape: tuple[int, int]) -> int:
    """Return how many pairs of a sample and a corner there are in filling ``outline``, which is finite."""
    rows, columns = np.clip(outline[:, 0], 0, shape[0]), outline[:, 1]
    return int(len(outline) * (np.ptp(rows) + 1) * (np.ptp(columns) + 1))


def _check_tests(n_tests: int) -> None:
    if n_tests > _MOST_TESTS:
        raise EndoctError(
            "outlines would take minutes to fill",
            found=f"{n_tests:.2g} pairs of a corner and a sample around it",
            expected=f"{_MOST_TESTS:.2g} at most",
            remedy="draw them with fewer corners, or save a label image",
        )


def _napari(path: Path) -> Iterator[list[Coordinates]]:
    """Yield the outlines in the CSV of a napari shapes layer, each an area of its own."""
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
        yield [_shape(f"shape {index[:20]} in {path}", vertices)]


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


def _fiji(path: Path) -> Iterator[list[Coordinates]]:
    """Yield the areas of ImageJ's regions of interest; pixel (0, 0) reaches from corner (0, 0) to (1, 1).

    What lies inside an odd number of an area's outlines belongs to it, so that it may have holes.
    """
    try:
        import roifile
    except ImportError as error:
        raise EndoctError(
            f"{path} needs a library that is not installed", found="no roifile", remedy="pip install 'endoct[fiji]'"
        ) from error
    # an EndoctError says what is wrong with a file; the library that reads it need not say so as well
    logging.getLogger("roifile").addHandler(logging.NullHandler())
    for data in _regions(path):
        with refusing(f"{path} holds no regions of ImageJ", remedy="save them again"):
            roi: Any = roifile.ImagejRoi.frombytes(data)
            if (kind := _not_filled(roi)) is not None:
                raise EndoctError(
                    f"'{roi.name[:40]}' in {path} encloses nothing",
                    found=kind,
                    expected="a polygon, freehand, rectangle, oval, or an area composed of these",
                    remedy="remove it, or draw it as one of these",
                )
            area = _subpaths(roi.multi_coordinates) if roi.composite else [_outline(roi)]
            area = [np.asarray(outline, dtype=np.float64)[:, ::-1] - 0.5 for outline in area]
        yield area


def _not_filled(roi: Any) -> str | None:
    """Return what a region of ImageJ is, where its points are not the corners of an area; None where they are."""
    import roifile

    kinds = roifile.ROI_TYPE
    if roi.roitype not in (kinds.POLYGON, kinds.FREEHAND, kinds.TRACED, kinds.RECT, kinds.OVAL):
        return str(kinds(roi.roitype).name.lower())
    if roi.subtype in (roifile.ROI_SUBTYPE.TEXT, roifile.ROI_SUBTYPE.IMAGE):
        return f"{roifile.ROI_SUBTYPE(roi.subtype).name.lower()} in a rectangle"
    if roi.options & roifile.ROI_OPTIONS.SPLINE_FIT:
        return "a curve fitted to its points"
    if roi.roitype == kinds.RECT and roi.rounded_rect_arc_size > 0:
        return "a rectangle with round corners"
    return None


def _outline(roi: Any) -> NDArray[Any]:
    """Return the outline of a region, (n, 2) as (x, y); rectangles and ovals as finely as they were drawn."""
    if roi.subpixelrect:
        roi.left, roi.top, roi.right, roi.bottom = roi.xd, roi.yd, roi.xd + roi.widthd, roi.yd + roi.heightd
    return np.asarray(roi.coordinates())


def _subpaths(stored: NDArray[Any]) -> list[NDArray[Any]]:
    """Return the closed outlines of a composed area, (n, 2) as (x, y).

    ``stored`` is a path as ImageJ's ``ShapeRoi`` has it: the kind of each segment, then its points. Raises
    ``ValueError`` where it is none; outlines of fewer than three points enclose nothing, and are left out.
    """
    if stored.size > _MOST_OF_PATH:
        raise ValueError(f"a path of {stored.size} numbers")
    path = stored.tolist()
    outlines: list[list[NDArray[Any]]] = []
    at = 0
    while at < len(path):
        kind, end = path[at], at + 1 + 2 * _POINTS_OF.get(int(path[at]), 0)
        points = np.asarray(path[at + 1 : end]).reshape(-1, 2)
        if kind not in _POINTS_OF or end > len(path) or (kind and not outlines):
            raise ValueError(f"a path with a segment of kind {kind:g}")
        if kind == 0:
            outlines.append([points])
        elif kind == 1:
            outlines[-1].append(points)
        elif kind in (2, 3):
            outlines[-1].append(_curve(np.vstack([outlines[-1][-1][-1:], points])))
        at = end
    drawn = [np.vstack(outline) for outline in outlines]
    if not (drawn := [outline for outline in drawn if len(outline) > 2]):
        raise ValueError("an area without outlines")
    return drawn


def _curve(control: NDArray[Any]) -> NDArray[Any]:
    """Return points along a Bézier curve, without its first; ``control``: three points, or four, as (x, y)."""
    between = control[:, np.newaxis]
    while len(between) > 1:  # de Casteljau, at all places at once
        between = between[:-1] + (between[1:] - between[:-1]) * _CURVE
    return np.asarray(between[0])


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
