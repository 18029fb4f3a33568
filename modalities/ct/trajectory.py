"""A straight way through a patient: the bore's coordinates along it, and its files as markups of 3D Slicer.

Markups are read from ``.mrk.json`` or the older ``.fcsv``, and written as ``.mrk.json``.
"""

import csv
import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import read_small, read_start
from endoct.base.files.json_values import a_list, an_object, read_object
from endoct.modalities.ct.stored import SIGNS, Convention

Point = tuple[float, float, float]
LEAST_LENGTH_MM = 1.0
NEARLY_ALONG = np.cos(np.radians(10))
ENDS = ("entry", "target")
EXPECTED = "a line of 3D Slicer, or a list of two points, saved as .mrk.json or .fcsv: first the entry, then the target"
FARTHEST_MM = 1e5
PLACED = "defined"
"""A point that somebody placed has this status."""
_SCHEMA = (
    "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/"
    "markups-schema-v1.0.3.json#"
)
_CONVENTIONS: dict[object, Convention] = {"LPS": "lps", "RAS": "ras"}
_OF_FCSV: dict[str, Convention] = {"lps": "lps", "ras": "ras", "0": "ras", "1": "lps"}
"""The header's CoordinateSystem is a name from Slicer 4.11 on, and was a number before."""
_FCSV_COLUMNS = ("id", "x", "y", "z", "ow", "ox", "oy", "oz", "vis", "sel", "lock", "label", "desc", "associatednodeid")
_TURN = ("ow", "ox", "oy", "oz")
_FCSV_STATUS = {"0": "undefined", "1": "preview", "2": PLACED, "3": "missing"}
"""Slicer 5 writes the status as a number, after these columns and one more."""


@dataclass(frozen=True)
class Trajectory:
    """From ``entry_mm`` to ``target_mm``, both LPS. Raises :class:`EndoctError` where these are the same place."""

    entry_mm: Point
    target_mm: Point

    def __post_init__(self) -> None:
        if not self.length_mm >= LEAST_LENGTH_MM:
            raise EndoctError("entry and target are the same place", found=f"{self.length_mm:.3g} mm apart")

    @property
    def length_mm(self) -> float:
        """Distance from entry to target."""
        return float(np.linalg.norm(np.subtract(self.target_mm, self.entry_mm)))

    @property
    def to_lps(self) -> Coordinates:
        """The transform (4, 4) of the bore frame at the entry, z towards the target, to LPS."""
        return axes_at(np.array(self.entry_mm), np.subtract(self.target_mm, self.entry_mm))


def as_point(place: Coordinates) -> Point:
    """Return x, y and z of an array (3,) as numbers of Python."""
    x, y, z = (float(value) for value in place)
    return x, y, z


def axes_at(origin_mm: Coordinates, inward: Coordinates) -> Coordinates:
    """Return the transform (4, 4) of a bore frame at ``origin_mm`` whose z runs ``inward``, in LPS.

    θ = 0 is towards the head; where the bore runs within 10° of that, to the front.
    """
    z = inward / max(float(np.linalg.norm(inward)), 1e-12)
    towards = np.array([0.0, 0.0, 1.0]) if abs(z[2]) < NEARLY_ALONG else np.array([0.0, -1.0, 0.0])
    x = towards - (towards @ z) * z
    x /= np.linalg.norm(x)
    to_world = np.eye(4)
    to_world[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    to_world[:3, 3] = origin_mm
    return to_world


@dataclass(frozen=True)
class _Control:
    """A control point as a file has it."""

    label: str
    position: Sequence[object]
    status: str


def is_plan(path: Path) -> bool:
    """Say whether a file is, by its content, markups of 3D Slicer."""
    start = read_start(path, 4096).removeprefix(b"\xef\xbb\xbf").lstrip()
    return b"arkups fiducial file" in start or (start.startswith(b"{") and b'"markups' in start)


def read_line(path: Path) -> tuple[Trajectory, Convention]:
    """Return the trajectory that a markups file holds, and the convention of the file's own numbers.

    One line with two control points, or one list of two points, each of them placed. Points labelled "entry" and
    "target" are these, in whatever order; else the first one is the entry. Raises :class:`EndoctError` for anything
    else, and where the file does not say what its coordinates mean.
    """
    of_json = read_start(path, 64).removeprefix(b"\xef\xbb\xbf").lstrip()[:1] in (b"{", b"[")
    points, convention = _of_json(path) if of_json else _of_fcsv(path)
    labels = [point.label.strip().lower() for point in points]
    if labels == list(reversed(ENDS)):
        points = points[::-1]
    for end, point in zip(ENDS, points, strict=True):
        if point.status != PLACED:
            raise EndoctError(
                f"the {end} of {path} is not placed",
                found=f"a point with the status '{point.status}'"[:80],
                expected=f"'{PLACED}'",
                remedy="place it in 3D Slicer and save the line again",
            )
    entry, target = (_place(point, convention, path) for point in points)
    return Trajectory(entry, target), convention


def write_line(line: Trajectory, name: str, path: Path) -> None:
    """Write ``line`` as markups of 3D Slicer, a line called ``name``, LPS."""
    ends = zip(ENDS, (line.entry_mm, line.target_mm), strict=True)
    markup = {
        "type": "Line",
        "coordinateSystem": "LPS",
        "coordinateUnits": "mm",
        "locked": True,
        "labelFormat": "%N-%d",
        "controlPoints": [
            {"id": str(number), "label": end, "position": list(place), "positionStatus": PLACED}
            for number, (end, place) in enumerate(ends, 1)
        ],
        "display": {"visibility": True, "propertiesLabelVisibility": True, "pointLabelsVisibility": True},
        "name": name,
    }
    text = json.dumps({"@schema": _SCHEMA, "markups": [markup]}, indent=1)
    path.write_text(text + "\n", encoding="utf-8", newline="\n")


def _of_json(path: Path) -> tuple[list[_Control], Convention]:
    markups = a_list(read_object(path), "markups", str(path))
    if len(markups) != 1:
        raise EndoctError(f"{path} holds no trajectory", found=f"{len(markups)} markups", expected=EXPECTED)
    markup = an_object(markups[0], f"the markup in {path}")
    points = [an_object(point, f"a point in {path}") for point in a_list(markup, "controlPoints", str(path))]
    if markup.get("type") not in ("Line", "Fiducial") or len(points) != len(ENDS):
        found = f"{len(points)} points of a {str(markup.get('type'))[:40]}"
        raise EndoctError(f"{path} holds no trajectory", found=found, expected=EXPECTED)
    stated = markup.get("coordinateSystem")
    convention = _CONVENTIONS.get(stated) if isinstance(stated, str) else None
    if convention is None:
        raise _unsaid(path, f"coordinateSystem {stated!r}")
    units = markup.get("coordinateUnits", "mm")
    units = units if isinstance(units, list) else [units]
    if not units or any(unit != "mm" for unit in units):
        raise EndoctError(f"{path} is not in mm", found=f"{markup['coordinateUnits']!r}"[:60])
    return [_control(point, path) for point in points], convention


def _control(point: dict[str, Any], path: Path) -> _Control:
    return _Control(
        label=str(point.get("label", "")),
        position=a_list(point, "position", f"a point in {path}"),
        status=str(point.get("positionStatus", PLACED)),
    )


def _of_fcsv(path: Path) -> tuple[list[_Control], Convention]:
    with refusing(f"{path} cannot be read", expected=EXPECTED):
        start = read_start(path, 512)
        if b"fiducial" not in start.lower() or not start.removeprefix(b"\xef\xbb\xbf").startswith(b"#"):
            raise EndoctError(f"{path} is no JSON, and no .fcsv", expected=EXPECTED)
        lines = read_small(path).decode("utf-8-sig").splitlines()
        header = [line.lstrip("# ").strip() for line in lines if line.startswith("#")]
        stated, columns = _field(header, "CoordinateSystem"), _field(header, "columns")
        convention = _OF_FCSV.get(stated.lower())
        if convention is None:
            raise _unsaid(path, f"CoordinateSystem {stated!r}")
        names = [name.strip().lower() for name in columns.split(",")] if columns else list(_FCSV_COLUMNS)
        rows = [row for row in csv.reader(line for line in lines if not line.startswith("#")) if any(row)]
        if len(rows) != len(ENDS):
            raise EndoctError(f"{path} holds no trajectory", found=f"{len(rows)} points", expected=EXPECTED)
        return [_of_row(row, names, path) for row in rows], convention


def _of_row(row: Sequence[str], names: Sequence[str], path: Path) -> _Control:
    of = dict(zip(names, row, strict=False))
    try:
        position = [float(of[axis]) for axis in "xyz"]
        turn = sum(float(of[part]) ** 2 for part in _TURN if part in of)
        if turn and abs(turn - 1) > 1e-3:  # no rotation: a number is missing before it
            raise ValueError("shifted columns")
    except (KeyError, ValueError) as error:
        raise EndoctError(f"a point in {path} has no place", expected="three numbers, mm") from error
    after = row[len(names) :]
    status = of.get("positionstatus", after[1] if len(after) > 1 else "2").strip()
    return _Control(of.get("label", ""), position, _FCSV_STATUS.get(status, status or PLACED))


def _field(header: Sequence[str], name: str) -> str:
    found = [match[1].strip() for line in header if (match := re.match(rf"(?i){name}\s*=(.*)", line))]
    return found[0] if len(found) == 1 else ""


def _unsaid(path: Path, stated: str) -> EndoctError:
    return EndoctError(
        f"{path} does not say whether its coordinates are RAS or LPS",
        found=stated[:60],
        expected="'LPS' or 'RAS'",
        remedy="save it with 3D Slicer 5",
    )


def _place(point: _Control, convention: Convention, path: Path) -> Point:
    numbers = [value for value in point.position if isinstance(value, int | float) and not isinstance(value, bool)]
    if (
        len(point.position) != 3
        or len(numbers) != 3
        or not all(abs(value) <= FARTHEST_MM and math.isfinite(value) for value in numbers)
    ):
        raise EndoctError(f"a point in {path} has no place", expected="three numbers, mm")
    x, y, z = (sign * float(value) for sign, value in zip(SIGNS[convention], numbers, strict=True))
    return x, y, z
