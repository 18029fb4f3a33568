"""The tables of a report: overlap, alignment, sides, and how it all was made."""

import math
from collections.abc import Callable, Iterator, Mapping
from html import escape
from typing import Any

import numpy as np

from endoct.fusion.result import Result, Threshold
from endoct.stitching.grid import SurfaceGrid
from endoct.workbench.report.by_hand import by_hand_tables
from endoct.workbench.report.findings import Findings, NamedOverlap, overlaps_of
from endoct.workbench.report.placement import alignment_rows
from endoct.workbench.report.side_findings import SideFindings
from endoct.workbench.report.wording import (
    NOTHING,
    area_text,
    count_text,
    flattened,
    share_text,
    table,
    value_text,
    without_stop,
)

OVERLAP_COLUMNS: Mapping[str, Callable[[NamedOverlap], str]] = {
    "Jaccard": lambda named: share_text(named.overlap.jaccard),
    "Dice": lambda named: share_text(named.overlap.dice),
    "Both": lambda named: area_text(named.overlap.both_mm2),
    "Only one": lambda named: _only_one(named),
    "Neither": lambda named: area_text(named.overlap.neither_mm2),
    "Places": lambda named: count_text(named.overlap.sites),
}
ALWAYS = ("Jaccard", "Dice")
"""Columns that are there also where nothing is known."""


def side_table(findings: Findings) -> str:
    """Return what there is to say of either side, as HTML."""
    columns = [_side_facts(side, findings.result) for side in findings.sides]
    return table(
        ([name, *(column[name] for column in columns)] for name in columns[0]),
        ["", *(side.name for side in findings.sides)],
    )


def result_tables(result: Result) -> Iterator[str]:
    """Yield the overlaps and the alignment of a comparison as HTML."""
    if overlaps := overlaps_of(result):
        texts = {title: [text(named) for named in overlaps] for title, text in OVERLAP_COLUMNS.items()}
        texts = {title: cells for title, cells in texts.items() if title in ALWAYS or set(cells) != {NOTHING}}
        names = [f"{named.of[0]} and {named.of[1]}, {named.where}" for named in overlaps]
        yield "<h3>Overlap of the cells</h3>\n"
        yield table(zip(names, *texts.values(), strict=True), ["", *texts])
        yield (
            "<p class=soft>Areas that both, only one or neither of the two call cell, where both observed the wall, on "
            "a cylinder of the nominal diameter.</p>\n"
        )
    if result.aligned and result.alignment:
        a, b = result.sides
        yield f"<h3>Alignment of {escape(b)} to {escape(a)}</h3>\n"
        yield table(alignment_rows(result.alignment, by_hand=result.by_hand is not None and result.by_hand.corrected))
    elif result.best_unbelieved:
        yield "<h3>The best alignment found, which was not accepted</h3>\n"
        yield table(alignment_rows(result.best_unbelieved))
    if result.by_hand is not None:
        yield from by_hand_tables(result.by_hand)


def provenance(result: Result) -> Iterator[str]:
    """Yield inputs, times, versions and parameters as HTML."""
    yield "<h3>Inputs</h3>\n"
    yield _digests(result.inputs)
    yield '<div class="columns"><div>\n<h3>Seconds per stage</h3>\n'
    yield table((name, f"{value:.1f} s") for name, value in result.seconds.items())
    yield "</div><div>\n<h3>Versions</h3>\n"
    yield table(result.versions.items())
    yield '</div></div>\n<div class="columns">\n'
    for name, parameters in result.parameters.items():
        if parameters:
            yield f"<div><h3>Parameters, {escape(name)}</h3>\n{_leaves(parameters)}</div>\n"
    yield "</div>\n"


def panorama_provenance(made: Mapping[str, Any]) -> Iterator[str]:
    """Yield inputs, versions and parameters of a panorama as HTML, as far as its provenance says them."""
    if isinstance(device := made.get("device"), str):
        yield f"<h3>Device</h3>\n<p>{escape(device)}, for what can be computed there</p>\n"
    parts = {"Inputs": "inputs", "Sidecar": "acquisition", "Parameters": "parameters", "Versions": "versions"}
    for title, key in parts.items():
        if isinstance(said := made.get(key), Mapping) and said:
            yield f"<h3>{title}</h3>\n"
            yield _digests(said) if key == "inputs" else _leaves(said)


def conditions(result: Result, grid: SurfaceGrid) -> str:
    """Return on which grid two sides were compared, and by what their cells were segmented."""
    thresholds = result.threshold or {}
    parts = [
        f"Common grid: {grid.n_z} × {grid.n_theta} samples (z × θ), {grid.dz_mm * 1000:.3g} µm along the bore and "
        f"{grid.dtheta_mm * 1000:.3g} µm around it at a bore radius of {grid.radius_mm:.3f} mm."
    ]
    parts += [f"Cells of {side}: {threshold_text(thresholds[side])}." for side in result.sides if side in thresholds]
    return " ".join(parts)


def threshold_text(threshold: Threshold | None) -> str:
    """Return what cells were segmented by: "wall relief, capped at 0.4 mm, above 0.03 mm"."""
    if threshold is None:
        return NOTHING
    of = without_stop(threshold.of) or "as given"
    unit = f" {threshold.unit}" if threshold.unit not in (None, "", "1") else ""
    return of if threshold.value is None else f"{of}, above {threshold.value:.3g}{unit}"


def _only_one(named: NamedOverlap) -> str:
    """Return "endoscope 0.47 mm², oct 0.21 mm²"."""
    areas = zip(named.of, (named.overlap.only_a_mm2, named.overlap.only_b_mm2), strict=True)
    known = [f"{name} {area_text(area)}" for name, area in areas if area is not None]
    return ", ".join(known) or NOTHING


def _digests(inputs: Mapping[str, object]) -> str:
    return table(((name, str(digest)) for name, digest in inputs.items()), ["file", "sha256"], code=(1,))


def _leaves(values: Mapping[str, object]) -> str:
    return table((name, value_text(key, value)) for name, key, value in flattened(values))


def _side_facts(side: SideFindings, result: Result) -> dict[str, str]:
    panorama = side.panorama
    cells = float(side.mask[side.valid].mean()) if side.valid.any() else math.nan
    depth = NOTHING
    if side.depth_mm is not None:
        low, high = (float(v) for v in np.nanpercentile(side.depth_mm[side.valid], (5, 95)))
        depth = f"{low:.3f} to {high:.3f} mm".replace("-", "−")
    frames = side.frame_z_mm.size
    return {
        "Recorded": f"{frames} {panorama.frame_dim}{'s' if frames != 1 else ''}" if frames else NOTHING,
        "Own panorama, z × θ": f"{panorama.grid.n_z} × {panorama.grid.n_theta} samples",
        "Observed of its own panorama": f"{panorama.valid.mean():.1%}",
        "Observed of the common grid": f"{side.valid.mean():.1%}",
        "Cells, of the wall it observed": f"{cells:.1%}" if math.isfinite(cells) else NOTHING,
        "Depth, 5th to 95th percentile": depth,
        "Cells segmented by": threshold_text((result.threshold or {}).get(side.name)),
        "Cells look": (result.polarity or {}).get(side.name) or NOTHING,
    }
