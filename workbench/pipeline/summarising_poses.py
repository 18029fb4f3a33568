"""Many poses to one summary: a row each, and how far the two sides agree over all of them."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import path_text, read_small, spreadsheet_text
from endoct.fusion.pose.paired import FEWEST_BORES, equivalence, limits_of_agreement
from endoct.workbench.pipeline.summarising import TableRow, summarise

NAME = "pose.json"
MOST_BYTES = 16_000_000
EQUIVALENT_MM = 0.3
"""Bound that a mean difference of the two sides is tested against."""
PLACES = ("at_entry", "at_target")
ALWAYS = ("pose", "sides", "told", "reason", "doubts", "offset_at_entry_mm", "offset_at_target_mm", "angle_deg")
"""Columns that are there even where no pose was told."""


def are_poses(folders: Sequence[Path]) -> bool:
    """Say whether all of ``folders``, one at least, are poses. Raises :class:`EndoctError` where only some are."""
    of_poses = [folder for folder in folders if (folder / NAME).is_file()]
    if of_poses and len(of_poses) < len(folders):
        other = next(folder for folder in folders if folder not in of_poses)
        raise EndoctError(
            "poses are summarised with poses only",
            found=f"{other} without {NAME}",
            expected="folders written by `endoct pose`",
            remedy="summarise comparisons by themselves",
        )
    return bool(of_poses)


def summarise_any(first: Sequence[Path], second: Sequence[Path], *, repeats: bool) -> dict[str, list[TableRow]]:
    """Return the tables of poses, or else of comparisons, as :func:`~endoct.workbench.pipeline.summarising.summarise`.

    Raises :class:`EndoctError` where folders hold neither, or something is asked of poses that they do not have.
    """
    if not are_poses([*first, *second]):
        return summarise(first, second, repeats=repeats)
    if second or repeats:
        raise EndoctError("poses are summarised one by one", remedy="leave out --against and --repeats")
    return summarise_poses(first)


def summarise_poses(folders: Sequence[Path]) -> dict[str, list[TableRow]]:
    """Return the tables of a summary by name, each a list of rows.

    ``poses`` has a row a pose: whether it was told, or why not, and the codes of its doubts. Numbers follow, each with
    its interval, empty where the pose was not told. They are the offsets from the plan, the angle, the depth of each
    side's last row, the distance and margin of each structure, and the difference of the two sides.

    ``agreement`` has a row a pair of sides, a place and a direction across the bore. It gives the sides' differences
    over all poses that were told, with limits of agreement and a test of equivalence. There are no rows where the poses
    are too few.

    Raises :class:`EndoctError` where a folder is no pose.
    """
    read = [(folder, read_pose(folder)) for folder in folders]
    rows = [dict(_row(folder, pose)) for folder, pose in read]
    columns = dict.fromkeys([*ALWAYS, *(column for row in rows for column in row)])
    return {
        "poses": [{column: row.get(column) for column in columns} for row in rows],
        "agreement": list(_agreement([pose for _, pose in read])),
    }


def read_pose(folder: Path) -> dict[str, Any]:
    """Return what ``pose.json`` in ``folder`` says. Raises :class:`EndoctError` where it is none."""
    path = folder / NAME
    with refusing(f"{folder} is no pose", expected="a folder written by `endoct pose`"):
        pose: dict[str, Any] = json.loads(read_small(path, MOST_BYTES))
        dict(_row(folder, pose))
        return pose


def _row(folder: Path, pose: dict[str, Any]) -> Iterator[tuple[str, str | float | None]]:
    yield "pose", path_text(str(folder))
    yield "sides", " ".join(pose["sides"])
    yield "told", float(pose["told"])
    yield "reason", pose["reason"]
    if not pose["told"]:
        return
    yield "doubts", spreadsheet_text(" ".join(map(str, pose["doubt_codes"])))
    found, difference = pose["pose"], pose["difference"]
    for name in ("at_entry", "at_target", "beyond_target"):
        yield from _estimate(f"offset_{name}_mm", found[name]["distance_mm"])
    yield from _estimate("angle_deg", found["angle_deg"])
    for side, of_side in found["by_side"].items():
        yield from _estimate(f"depth_of_last_row_{side}_mm", of_side["last_row"]["depth_mm"])
    for structure in found["structures"]:
        name = spreadsheet_text(str(structure["name"]).replace(" ", "_"))  # a segmentation named it
        yield from _estimate(f"{name}_mm", structure["distance_mm"])
        yield f"{name}_margin_mm", float(structure["margin_mm"])
    if difference is not None:
        yield "difference_of", " less ".join(difference["of"])
        for name in PLACES:
            yield from _estimate(f"difference_{name}_mm", difference[name]["distance_mm"])
            x, y = difference[name]["across_mm"]
            yield from ((f"difference_{name}_x_mm", float(x)), (f"difference_{name}_y_mm", float(y)))
        yield from _estimate("difference_angle_deg", difference["angle_deg"])


def _estimate(name: str, estimate: dict[str, float]) -> Iterator[tuple[str, float]]:
    yield name, float(estimate["value"])
    yield f"{name}_low", float(estimate["low"])
    yield f"{name}_high", float(estimate["high"])


def _agreement(poses: Sequence[dict[str, Any]]) -> Iterator[TableRow]:
    by_sides: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for pose in poses:
        if pose["told"] and pose["difference"] is not None:
            first, second = pose["difference"]["of"]
            by_sides.setdefault((first, second), []).append(pose["difference"])
    for (first, second), differences in by_sides.items():
        if len(differences) < FEWEST_BORES:
            continue
        for place in PLACES:
            for number, direction in enumerate("xy"):
                values = np.array([difference[place]["across_mm"][number] for difference in differences])
                limits, test = asdict(limits_of_agreement(values)), equivalence(values, EQUIVALENT_MM)
                row: TableRow = {"sides": f"{first} less {second}", "place": place, "direction": direction}
                for name, value in limits.items():
                    if isinstance(value, tuple):
                        low_high = zip(("low", "high"), value, strict=True)
                        row |= {f"{name.removesuffix('_interval')}_mm_{end}": at for end, at in low_high}
                    else:
                        row[name if name == "bores" else f"{name}_mm"] = value
                yield row | {"bound_mm": test.bound, "p": test.p, "equivalent": float(test.equivalent)}
