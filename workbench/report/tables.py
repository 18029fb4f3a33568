"""The tables of a report: overlap, alignment, sides, and how it all was made."""

import math
from collections.abc import Iterator, Mapping
from html import escape
from typing import Any

import numpy as np

from endoct.workbench.report.doubts import without_stop
from endoct.workbench.report.findings import Findings, SideFindings
from endoct.workbench.report.wording import flattened, key_text, table, value_text

SCORE_NAMES = {
    "jaccard": "Jaccard",
    "dice": "Dice",
    "both_mm2": "Both",
    "only_a_mm2": "Only the first",
    "only_b_mm2": "Only the second",
    "neither_mm2": "Neither",
}


def numbers(findings: Findings) -> Iterator[str]:
    """Yield the numbers of a comparison as HTML."""
    result = findings.result
    overlaps = findings.overlaps
    if overlaps:
        keys = list(dict.fromkeys(key for overlap in overlaps for key in overlap.scores))
        yield "<h3>Overlap of the cells</h3>\n"
        yield table(
            (
                [f"{o.of[0]} and {o.of[1]}, {o.where}", *(value_text(key, o.scores.get(key)) for key in keys)]
                for o in overlaps
            ),
            ["", *(SCORE_NAMES.get(key, key_text(key)) for key in keys)],
        )
        yield "<p class=soft>Counted where both observed the wall; areas on the nominal bore.</p>\n"
    if findings.aligned:
        a, b = (side.name for side in findings.sides)
        yield f"<h3>Alignment of {escape(b)} to {escape(a)}</h3>\n"
        yield _leaves(result["alignment"])
    elif result.get("best_unbelieved"):
        yield "<h3>The best alignment found, which was not believed</h3>\n"
        yield _leaves(result["best_unbelieved"])
    yield "<h3>Sides</h3>\n"
    columns = [_side_facts(side, result) for side in findings.sides]
    yield table(
        ([name, *(column[name] for column in columns)] for name in columns[0]),
        ["", *(side.name for side in findings.sides)],
    )


def provenance(result: Mapping[str, Any]) -> Iterator[str]:
    """Yield inputs, times, versions and parameters as HTML."""
    yield "<h3>Inputs</h3>\n"
    yield table(result.get("inputs", {}).items(), ["file", "sha256"], code=(1,))
    yield '<div class="columns"><div>\n<h3>Seconds per stage</h3>\n'
    seconds = result.get("seconds", {})
    yield table((name, f"{value:.1f} s") for name, value in seconds.items())
    yield "</div><div>\n<h3>Versions</h3>\n"
    yield table(result.get("versions", {}).items())
    yield '</div></div>\n<div class="columns">\n'
    for name, parameters in result.get("parameters", {}).items():
        if parameters:
            yield f"<div><h3>Parameters, {escape(name)}</h3>\n{_leaves(parameters)}</div>\n"
    yield "</div>\n"


def threshold_text(threshold: Mapping[str, Any] | None) -> str:
    """Return what cells were told by: "wall relief, capped at 0.4 mm, above 0.03 mm"."""
    if not threshold:
        return "–"
    of = without_stop(threshold.get("of")) or "as given"
    value, unit = threshold.get("value"), threshold.get("unit") or ""
    return of if value is None else f"{of}, above {value:.3g}{f' {unit}' if unit not in ('', '1') else ''}"


def _leaves(values: Mapping[str, Any]) -> str:
    return table((name, value_text(key, value)) for name, key, value in flattened(values))


def _side_facts(side: SideFindings, result: Mapping[str, Any]) -> dict[str, str]:
    panorama = side.panorama
    cells = float(side.mask[side.valid].mean()) if side.valid.any() else math.nan
    depth = "none"
    if side.depth_mm is not None:
        low, high = (float(v) for v in np.nanpercentile(side.depth_mm[side.valid], (5, 95)))
        depth = f"{low:.3f} to {high:.3f} mm".replace("-", "−")
    frames = side.frame_z_mm.size
    facts = {
        "Recorded": f"{frames} {panorama.frame_dim}{'s' if frames != 1 else ''}" if frames else "–",
        "Own panorama, z × θ": f"{panorama.grid.n_z} × {panorama.grid.n_theta} samples",
        "Observed of its own panorama": f"{panorama.valid.mean():.1%}",
        "Observed of the common grid": f"{side.valid.mean():.1%}",
        "Cells, of the wall it observed": f"{cells:.1%}" if math.isfinite(cells) else "–",
        "Depth, 5th to 95th percentile": depth,
        "Cells told by": threshold_text((result.get("threshold") or {}).get(side.name)),
    }
    if polarity := (result.get("polarity") or {}).get(side.name):
        facts["Cells look"] = polarity
    else:
        facts["Cells look"] = "–"
    return facts
