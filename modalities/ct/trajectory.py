"""A straight way through a patient: the bore's coordinates along it, and its files as markups of 3D Slicer.

Markups are read from ``.mrk.json`` or the older ``.fcsv``, and written as ``.mrk.json``.
"""

import csv
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
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
_SAID = {"entry": re.compile(r"entry|entrance|(?:e|ep|start|begin)$"), "target": re.compile(r"target|(?:t|tp|end)$")}
"""A word of a label that begins so says which end of the bore its point is."""
_WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")
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
_FLAGS = ("vis", "sel", "lock")
_FCSV_STATUS = {"0": "undefined", "1": "preview", "2": PLACED, "3": "missing"}
"""Slicer 5 writes the status as a number behind these columns, and then whether the point was made by itself."""


@dataclass(frozen=True)
class Trajectory:
    """From ``entry_mm`` to ``target_mm``, both LPS. Raises :class:`EndoctError` where these are the same place.

    ``note``: how a file told them apart, a sentence, where its labels do not.
    """

    entry_mm: Point
    target_mm: Point
    note: str = field(default="", compare=False, kw_only=True)

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

    One line with two control points, or one list of two points, each of them placed. Labels decide which is the entry;
    where they say nothing, the first one is, with a note. Raises :class:`EndoctError` for anything else, where labels
    contradict each other, and where the file does not say what its coordinates mean.
    """
    of_json = read_start(path, 64).removeprefix(b"\xef\xbb\xbf").lstrip()[:1] in (b"{", b"[")
    points, convention = _of_json(path) if of_json else _of_fcsv(path)
    in_order, note = _from_entry(points, path)
    for end, point in zip(ENDS, in_order, strict=True):
        if point.status != PLACED:
            raise EndoctError(
                f"the {end} of {path} is not placed",
                found=f"a point with the status '{point.status}'"[:80],
                expected=f"'{PLACED}'",
                remedy="place it in 3D Slicer and save the line again",
            )
    entry, target = (_place(point, convention, path) for point in in_order)
    return Trajectory(entry, target, note=note), convention


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


def _from_entry(points: Sequence[_Control], path: Path) -> tuple[Sequence[_Control], str]:
    """Return the two points, the entry first, and a note where not both of their labels say so."""
    first, second = (_end_of(point.label) for point in points)
    if first and first == second:
        raise EndoctError(
            f"both points of {path} are the {first} by their labels",
            found=" and ".join(repr(point.label[:40]) for point in points),
            expected="an entry and a target",
            remedy="name them so in 3D Slicer, and save the list again",
        )
    turned = first == "target" or second == "entry"
    if first and second:
        note = ""
    elif first or second:
        note = f"Of {path.name} one label alone says what its point is, the {first or second}; the other is the other."
    else:
        note = f"No label in {path.name} says which point is the entry: the first was taken for it."
    return points[::-1] if turned else points, note


def _end_of(label: str) -> str:
    """Return the end of a bore that a label names, empty where it names none, or both."""
    words = [word.lower() for word in _WORD.findall(label)]
    ends = [end for end, said in _SAID.items() if any(said.match(word) for word in words)]
    return ends[0] if len(ends) == 1 else ""


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
        turn = [float(of[part]) for part in _TURN if part in of]  # a quaternion, or in Slicer 4 an angle and its axis
        is_turn = any(abs(np.linalg.norm(part) - 1) < 1e-3 for part in (turn, turn[1:]))
        if (any(turn) and not is_turn) or any(of.get(flag, "").strip() not in ("", "0", "1") for flag in _FLAGS):
            raise ValueError("shifted columns: a number is missing, or has a comma of its own")
    except (KeyError, ValueError) as error:
        raise EndoctError(f"a point in {path} has no place", expected="three numbers, mm") from error
    after = row[len(names) :]
    status = of.get("positionstatus", after[0] if after else "").strip()
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
    numbers = [v for v in point.position if isinstance(v, int | float) and not isinstance(v, bool)]
    if len(point.position) != 3 or len(numbers) != 3 or not all(abs(value) <= FARTHEST_MM for value in numbers):
        raise EndoctError(f"a point in {path} has no place", expected="three numbers, mm")
    x, y, z = (float(sign * value) for sign, value in zip(SIGNS[convention], numbers, strict=True))
    return x, y, z
