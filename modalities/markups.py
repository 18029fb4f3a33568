"""A trajectory as 3D Slicer's markups file, ``.mrk.json``: read, and written."""

import json
import math
from pathlib import Path
from typing import Any

from endoct.modalities.ct_volume import SIGNS, Convention
from endoct.modalities.trajectory import Point, Trajectory
from endoct.stitching.errors import EndoctError
from endoct.stitching.json_values import a_list, an_object, read_object

ENDS = ("entry", "target")
EXPECTED = "a line of 3D Slicer, or a list of two points, saved as .mrk.json: first the entry, then the target"
FARTHEST_MM = 1e5
_SCHEMA = (
    "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/"
    "markups-schema-v1.0.3.json#"
)
_CONVENTIONS: dict[object, Convention] = {"LPS": "lps", "RAS": "ras"}


def read_line(path: Path) -> tuple[Trajectory, Convention]:
    """Return the trajectory that a markups file holds, and the convention of the file's own numbers.

    One line with two control points, or one list of two points. Points labelled "entry" and "target" are these, in
    whatever order; else the first one is the entry. Raises :class:`EndoctError` for anything else, and where the file
    does not say what its coordinates mean.
    """
    markups = a_list(read_object(path), "markups", str(path))
    if len(markups) != 1:
        raise EndoctError(f"{path} holds no trajectory", found=f"{len(markups)} markups", expected=EXPECTED)
    markup = an_object(markups[0], f"the markup in {path}")
    points = [an_object(one, f"a point in {path}") for one in a_list(markup, "controlPoints", str(path))]
    if markup.get("type") not in ("Line", "Fiducial") or len(points) != 2:
        found = f"{len(points)} points of a {str(markup.get('type'))[:40]}"
        raise EndoctError(f"{path} holds no trajectory", found=found, expected=EXPECTED)
    stated = markup.get("coordinateSystem")
    convention = _CONVENTIONS.get(stated) if isinstance(stated, str) else None
    if convention is None:
        raise EndoctError(
            f"{path} does not say whether its coordinates are RAS or LPS",
            found=f"coordinateSystem {stated!r}"[:60],
            expected="'LPS' or 'RAS'",
            remedy="save it with 3D Slicer 5",
        )
    if set(_units(markup.get("coordinateUnits", "mm"))) != {"mm"}:
        raise EndoctError(f"{path} is not in mm", found=f"{markup['coordinateUnits']!r}"[:60])
    labels = [str(point.get("label", "")).strip().lower() for point in points]
    if labels == list(reversed(ENDS)):
        points.reverse()
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
            {"id": str(number), "label": end, "position": list(place), "positionStatus": "defined"}
            for number, (end, place) in enumerate(ends, 1)
        ],
        "display": {"visibility": True, "propertiesLabelVisibility": True, "pointLabelsVisibility": True},
        "name": name,
    }
    text = json.dumps({"@schema": _SCHEMA, "markups": [markup]}, indent=1)
    path.write_text(text + "\n", encoding="utf-8", newline="\n")


def _units(stated: object) -> list[object]:
    return list(stated) if isinstance(stated, list) else [stated]


def _place(point: dict[str, Any], convention: Convention, path: Path) -> Point:
    position = a_list(point, "position", f"a point in {path}")
    whole = len(position) == 3 and all(
        isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= FARTHEST_MM
        for value in position
    )
    if not whole or not all(math.isfinite(value) for value in position):
        raise EndoctError(f"a point in {path} has no place", expected="three numbers, mm")
    x, y, z = (sign * float(value) for sign, value in zip(SIGNS[convention], position, strict=True))
    return x, y, z
