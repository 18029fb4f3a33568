"""A folder of comparisons, panoramas and simulated specimens: what lies in it, its table, its thumbnails.

Only small files of each output are read. The table is HTML; it is there before any program runs,
which sorts and filters it. Thumbnails are the wall as strips, z to the right and θ down.
"""

import io
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray
from PIL import Image as Pillow

from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import read_small
from endoct.base.files.json_values import number, read_object
from endoct.base.zarr.zarr_store import read_arrays, read_attributes
from endoct.fusion.files.result_file import read_result
from endoct.fusion.result import Result
from endoct.stitching.store import read_doubts, read_provenance
from endoct.workbench.kinds import KINDS, SAMPLE, PathKind, places_in, reader
from endoct.workbench.page.description import LayerPart
from endoct.workbench.page.heading import RESEARCH
from endoct.workbench.page.layers import CODES
from endoct.workbench.page.opening import open_shown, written_at
from endoct.workbench.page.shown import Shown
from endoct.workbench.page.wall import OVERLAP_PX, TILE_PX, Tile
from endoct.workbench.report.html_templates import rendered
from endoct.workbench.report.next_steps import Stated, next_steps
from endoct.workbench.report.verdict import Level, recording_verdict, verdict_of
from endoct.workbench.report.wording import NOTHING, interval_text

MOST_ENTRIES = 5000
COLUMNS = (
    ("wall", ""), ("name", "name"), ("what", "sides, or how it was simulated"), ("verdict", "how far it is trusted"),
    ("Jaccard", "overlap of the cells"), ("Dice", "overlap of the cells"), ("cells agree", "how many"),
    ("doubts", "how many"), ("written", "when"),
)  # fmt: skip
PAGES = "/at"
"""Below this lie the pages of entries, by their names."""
LEVELS: dict[Level, str] = {
    "trusted": "trusted",
    "uncertain": "uncertain",
    "doubted": "doubted",
    "unaligned": "not aligned",
}
STRIP_PX, WIDEST_PX, GAP_PX = 96, 480, 6
"""Height of a strip, greatest width of all together, and gap between two."""
MOST_PLOT_BYTES = 16_000_000
MOST_PX = 2000
"""Samples of the truth that are read along either axis."""
NOT_OBSERVED = (185, 208, 242, 255)
"""Colour of what was not observed, as on the page and in figures."""
DEEP_MM = 0.8
"""Depth that a relief shows black."""
Pixels = NDArray[np.uint8]


@dataclass(frozen=True)
class ListedOutput:
    """One of a collection: where it lies, ``name`` is its path below the collection with "/", and what is known of it.

    ``what`` are its sides, or how it was simulated; the scores are None where there are none; ``cells``: how many
    agree, of how many of each side. ``steps``: what can be done about it, as JSON. ``inputs``: the files that were
    compared, as its result names them.
    ``fault`` says why it cannot be read, "" where it can.
    """

    path: Path
    name: str
    row: PathKind
    what: str = ""
    level: Level | None = None
    headline: str = ""
    jaccard: float | None = None
    interval: tuple[float, float] | None = None
    dice: float | None = None
    cells: tuple[int, int, int] | None = None
    doubts: tuple[Doubt, ...] = ()
    steps: tuple[Mapping[str, Any], ...] = ()
    written: str = ""
    inputs: tuple[str, ...] = ()
    fault: str = ""

    @property
    def kind(self) -> str:
        """What lists call it."""
        return self.row.title

    @property
    def can_be_opened(self) -> bool:
        """Whether it has a page of its own."""
        return bool(self.row.shown) and not self.fault


def entries_in(folder: Path) -> tuple[ListedOutput, ...]:
    """Return what lies in ``folder``, by name. Links are not followed; what cannot be read says so itself.

    Raises :class:`EndoctError` where there is more than anybody could look through.
    """
    found = []
    for place in places_in(folder):
        row = KINDS.get(place.output or "")
        if row is None or not row.listed or place.path == folder:
            continue
        place.folders.clear()
        found.append(_entry(folder, place.path, row))
        if len(found) > MOST_ENTRIES:
            raise EndoctError(f"{folder} holds too much to list", expected=f"{MOST_ENTRIES} comparisons at most")
    return tuple(sorted(found, key=lambda entry: entry.name))


def read_collection(folder: Path) -> tuple[ListedOutput, ...]:
    """Return what :func:`entries_in` does. Raises :class:`EndoctError` where there is nothing, too."""
    entries = entries_in(folder)
    if not entries:
        raise EndoctError(
            f"{folder} cannot be shown",
            found="no comparison, no panorama and no simulated specimen" if folder.is_dir() else "no such folder",
            expected="what `endoct compare` or `endoct unroll` wrote, or a folder with some of these",
        )
    return entries


def check_no_links(path: Path) -> None:
    """Raise :class:`EndoctError` where anything in ``path`` is a link: it could lead out of the collection."""
    for below, folders, files in os.walk(path):
        for name in (*folders, *files):
            if (Path(below) / name).is_symlink():
                raise EndoctError(f"{Path(below) / name} is a link", expected="what endoct wrote, and nothing else")


def _entry(folder: Path, path: Path, row: PathKind) -> ListedOutput:
    name = path.relative_to(folder).as_posix()
    try:
        return ListedOutput(path, name, row, **reader(row.listed)(path))
    except EndoctError as error:
        return ListedOutput(path, name, row, fault=str(error))


def listed_comparison(path: Path) -> dict[str, Any]:
    """Return what an :class:`ListedOutput` says of a comparison."""
    result = read_result(path)
    return {
        "what": " and ".join(result.sides),
        "level": (verdict := verdict_of(result)).level,
        "headline": verdict.headline,
        "jaccard": result.jaccard if result.aligned else None,
        "interval": result.overlap.jaccard_interval if result.overlap else None,
        "dice": result.dice if result.aligned else None,
        "cells": _cells(result) if result.aligned else None,
        "doubts": tuple(result.doubts),
        "steps": tuple(step.to_json(result) for step in next_steps(result, _stated(path, result))),
        "written": written_at(path / "result.json"),
        "inputs": tuple(result.inputs),
    }


def _stated(path: Path, result: Result) -> Stated:
    """Return by side the provenance of its panorama, as far as it can be read."""
    stated = {}
    for side in result.sides:
        with suppress(EndoctError):
            stated[side] = read_provenance(path / "panoramas" / f"{side}.zarr")
    return stated


def _cells(result: Result) -> tuple[int, int, int] | None:
    cells = result.scores.cells if result.scores else None
    return None if cells is None or cells.matched is None else (cells.matched, cells.of_reference, cells.of_other)


def listed_panorama(path: Path) -> dict[str, Any]:
    """Return what an :class:`ListedOutput` says of a panorama."""
    doubts = read_doubts(path)
    return {
        "what": str(read_attributes(path).get("modality", "")),
        "level": (verdict := recording_verdict(doubts)).level,
        "headline": verdict.headline,
        "doubts": doubts,
        "written": written_at(path / "zarr.json"),
    }


def listed_specimen(path: Path) -> dict[str, Any]:
    """Return what an :class:`ListedOutput` says of a simulated specimen."""
    sample = read_object(path / SAMPLE)
    bore = sample.get("bore")
    bone = bore.get("bone") if isinstance(bore, dict) else None
    said = (("preset", sample.get("preset")), ("seed", sample.get("seed")), ("bone", bone))
    what = ", ".join(f"{name} {value}" for name, value in said if isinstance(value, str | int))
    return {"what": what[:200], "written": written_at(path / SAMPLE)}


def listed_summary(path: Path) -> dict[str, Any]:
    """Return what an :class:`ListedOutput` says of a summary."""
    return {"what": "of many", "written": written_at(path / "summary.json")}


def collection_html(title: str, entries: Sequence[ListedOutput], version: str) -> Markup:
    """Return the page of a collection; ``version`` goes into the addresses of thumbnails, which browsers keep."""
    titles = [row.title for row in KINDS.values() if row.listed]
    kinds = {title: sum(entry.kind == title for entry in entries) for title in titles}
    order = list(LEVELS)
    levels = [level for level in order if any(entry.level == level for entry in entries)]
    choices = [("", "all"), *((level, LEVELS[level]) for level in levels)]
    choices += [(kind, f"{kind}s") for kind, count in kinds.items() if 0 < count < len(entries)]
    return rendered(
        "page/collection.html",
        title=title,
        kinds=kinds,
        choices=choices,
        columns=COLUMNS,
        entries=entries,
        version=version,
        address_of=address_of,
        # how far an entry is trusted: a key to sort by, and words
        level_of=lambda one: (order.index(one.level), LEVELS[one.level]) if one.level else (len(order), NOTHING),
        numbers_of=_numbers,
        research=RESEARCH,
    )


def address_of(entry: ListedOutput, pages: str = PAGES) -> str:
    """Return where the page of an entry is, below ``pages``."""
    return f"{pages}/{quote(os.fsencode(entry.name))}/"


def _numbers(entry: ListedOutput) -> Iterator[tuple[str, str, str]]:
    """Yield the numbers of an entry by column: a key to sort by, the text, and its interval."""
    yield *_number(entry.jaccard), interval_text(entry.interval).removeprefix("95 % interval ")
    yield *_number(entry.dice), ""
    if entry.cells is None:
        yield "", NOTHING, ""
    else:
        matched, of_a, of_b = entry.cells
        yield str(matched), str(matched), f"of {of_a} and {of_b}"


def _number(value: float | None) -> tuple[str, str]:
    if value is None or not math.isfinite(value):
        return "", NOTHING
    return f"{value:.9f}", f"{value:.3f}"


def thumbnail(entry: ListedOutput) -> bytes:
    """Return a PNG of what the page of ``entry`` shows first; of a simulated specimen, its true relief.

    Raises :class:`EndoctError` where it cannot be read.
    """
    check_no_links(entry.path)
    strips = reader(entry.row.pictured)(entry.path)
    widest = max(strip.width for strip in strips) + GAP_PX
    # side by side, but those of a long bore under one another
    across, down = (widest, 0) if widest * len(strips) <= WIDEST_PX else (0, STRIP_PX + GAP_PX)
    last = len(strips) - 1
    picture = Pillow.new("RGBA", (last * across + widest - GAP_PX, last * down + STRIP_PX))
    for k, strip in enumerate(strips):
        picture.paste(strip, (k * across, k * down))
    file = io.BytesIO()
    picture.save(file, "PNG")
    return file.getvalue()


def pictured_page(path: Path) -> list[Pillow.Image]:
    """Return the layers that the page of an output shows first, as strips."""
    shown = open_shown(path)
    parts = {part.key: part for part in shown.description.layers}
    return [_pane(shown, parts[key]) for key in shown.description.panes]


def _pane(shown: Shown, part: LayerPart) -> Pillow.Image:
    """Return a layer from its coarsest tiles, without what they share with their neighbours."""
    pixels = []
    for row in range(shown.wall.rows_of_tiles(0)):
        tile = np.asarray(shown.tile(part.key, Tile(0, 0, row)).convert("RGBA"))
        first = OVERLAP_PX if row else 0
        pixels.append(tile[first : first + TILE_PX, OVERLAP_PX:-OVERLAP_PX])
    wall = np.concatenate(pixels)
    if part.kind == "scalar":
        value = part.low + wall[..., :3] * ((part.high - part.low) / CODES)
        share = (value - part.shown_low) / ((part.shown_high - part.shown_low) or 1.0)
        wall = np.dstack([_bytes(1 - share if part.unit == "mm" else share), wall[..., 3]])  # deep is dark
    return _strip(wall, wall.shape[0] / wall.shape[1])


def pictured_summary(path: Path) -> list[Pillow.Image]:
    """Return the first plot of a summary as a strip, white where it has none."""
    for plot in sorted((path / "figures").glob("*.png")):
        with refusing(f"{plot} is no plot"):
            drawn = Pillow.open(io.BytesIO(read_small(plot, MOST_PLOT_BYTES))).convert("RGBA")
            return [drawn.resize((max(1, min(WIDEST_PX, drawn.width * STRIP_PX // drawn.height)), STRIP_PX))]
    return [Pillow.new("RGBA", (STRIP_PX, STRIP_PX), "white")]


def pictured_specimen(specimen: Path) -> list[Pillow.Image]:
    """Return the true relief of a simulated specimen, as a strip."""
    store = specimen / SAMPLE.parent / "wall.zarr"
    with refusing(f"{store} is no true wall"):
        arrays = read_arrays(store, ("relief_mm", "z"))
        relief_mm, z_mm = arrays["relief_mm"], arrays["z"]
        if relief_mm.ndim != 2 or z_mm.shape != relief_mm.shape[:1]:
            raise EndoctError(f"{store} is no true wall", found=f"shape {relief_mm.shape}", expected="(z, θ)")
        around_mm = 2 * math.pi * number(read_attributes(store), "bore_radius_mm", 0.01, 1e3, str(store))
        down, across = (max(1, n // MOST_PX) for n in relief_mm.shape)
        grey = _bytes(1 - np.nan_to_num(relief_mm[::down, ::across], nan=DEEP_MM) / DEEP_MM)
        wall = np.dstack([grey] * 3 + [np.full_like(grey, CODES)])
        return [_strip(wall, float(np.ptp(z_mm)) / around_mm)]


def _strip(wall: Pixels, turns: float) -> Pillow.Image:
    """Return a wall, RGBA (z, θ, 4), as a strip; its length is so many times its circumference."""
    width = min(max(round(STRIP_PX * turns), 1), WIDEST_PX)
    sideways = np.ascontiguousarray(wall.transpose(1, 0, 2))
    strip = Pillow.fromarray(sideways, "RGBA").resize((width, STRIP_PX), Pillow.Resampling.BOX)
    return Pillow.alpha_composite(Pillow.new("RGBA", strip.size, NOT_OBSERVED), strip)


def _bytes(share: NDArray[np.floating]) -> Pixels:
    codes: Pixels = np.clip(np.rint(CODES * share), 0, CODES).astype(np.uint8)
    return codes
