"""What is known per frame or slice, as a table for spreadsheets and statistics."""

import csv
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from endoct.base.errors import EndoctError
from endoct.base.files.files import spreadsheet_text
from endoct.stitching.per_frame import PerFrame
from endoct.stitching.store import read_outline
from endoct.workbench.exporting.source import Exportable
from endoct.workbench.requests import ExportRequest
from endoct.workbench.running.progress import Stages


def write_quality(source: Exportable, path: Path, request: ExportRequest, stages: Stages) -> dict[str, object]:
    """Write one row a frame, by ascending z: geometry and quality of one side; units stand in the headings.

    Flags are true or false, unknown numbers empty. Raises :class:`EndoctError` where a side has to be chosen, or has
    nothing per frame.
    """
    del stages
    side = _side(source, request.side)
    outline = read_outline(source.panoramas[side])
    lengths = {one.values.shape[:1] for one in outline.per_frame.values()}
    if len(lengths) > 1 or lengths & {(), (0,)}:
        damaged = f"the numbers per {outline.frame_dim} in {source.panoramas[side]} are damaged"
        raise EndoctError(damaged, found=f"{sorted(lengths)} of them", expected="as many of each kind")
    place = f"{outline.frame_dim}_z_mm"
    first = sorted(outline.per_frame, key=lambda name: (name != place, name != f"{outline.frame_dim}_index", name))
    columns = dict(_columns({name: outline.per_frame[name] for name in first}))
    if not columns:
        raise EndoctError(f"{source.path} has nothing per frame", found=f"{side}, a mask perhaps")
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([spreadsheet_text(heading) for heading in columns])
        writer.writerows(zip(*columns.values(), strict=True))
    return {"side": side, "rows": len(next(iter(columns.values()))), "columns": list(columns)}


def _side(source: Exportable, side: str | None) -> str:
    sides = tuple(source.panoramas)
    if not sides:
        raise EndoctError(f"{source.path} has nothing per frame", expected="a panorama, or a comparison of such")
    if side is None and len(sides) > 1:
        raise EndoctError(
            f"{source.path} has two sides", expected=" or ".join(sides), remedy=f"choose one with side='{sides[0]}'"
        )
    if side is not None and side not in sides:
        raise EndoctError(f"{source.path} has no such side", found=side, expected=" or ".join(sides))
    return side or sides[0]


def _columns(values: Mapping[str, PerFrame]) -> Iterator[tuple[str, list[str]]]:
    """Yield (heading, texts) of every column; numbers of several axes take several, counted from 1."""
    for name, one in values.items():
        heading = name if not one.unit or name.endswith(f"_{one.unit.lower()}") else f"{name} ({one.unit})"
        flat = one.values.reshape(len(one.values), -1)
        for k in range(flat.shape[1]):
            yield heading if one.values.ndim == 1 else f"{heading} {k + 1}", [_text(value) for value in flat[:, k]]


def _text(value: np.generic) -> str:
    if isinstance(value, np.bool_):
        return "true" if value else "false"
    return "" if isinstance(value, np.floating) and np.isnan(value) else str(value.item())
