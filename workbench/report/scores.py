"""The tables of scores beside the overlap: outlines, cells as objects, and raters."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from endoct.workbench.report.findings import Findings
from endoct.workbench.report.wording import NOTHING, interval_text, table, value_text

RATER_COLUMNS = {
    "jaccard": "Jaccard",
    "dice": "Dice",
    "boundary_mean_mm": "Outlines, mean",
    "boundary_p95_mm": "95th percentile",
    "boundary_within_share": "within tolerance",
}


def score_tables(findings: Findings) -> Iterator[str]:
    """Yield what outlines, cells and raters say, as HTML; nothing where nothing was scored."""
    cards = dict(_cards(findings))
    if rows := list(_rows(cards)):
        yield "<h3>Outlines and cells</h3>\n"
        yield table(rows, ["", *cards])
        yield (
            "<p class=soft>Outlines: distance on the bore from either to the other where both observed the wall. Cells "
            "match where their intersection is at least half of their union. Precision: share of the second's cells "
            "that the first shows too; recall: share of the first's cells that the second shows; quality: both and "
            "the overlap in one (panoptic quality). Only cells of which the other observed half. Each cell is a line "
            'of <span class="code">cells.csv</span>. What each score means: docs/scores.md.</p>\n'
        )
    if raters := findings.result.get("raters"):
        yield from _raters(raters)


def _cards(findings: Findings) -> Iterator[tuple[str, Mapping[str, Any]]]:
    result = findings.result
    a, b = (side.name for side in findings.sides)
    if findings.aligned and (scores := result.get("scores")) and "cells" in scores:
        yield f"{a} and {b}", scores
    if raters := result.get("raters"):
        against = {"consensus": raters["consensus"]["majority"]["sides"]}
    else:
        against = {Path(path).name: sides for path, sides in (result.get("truth") or {}).items()}
    for name, sides in against.items():
        for side, scores in sides.items():
            if "cells" in scores:
                yield f"{name} and {side}", scores


def _rows(cards: Mapping[str, Mapping[str, Any]]) -> Iterator[list[str]]:
    boundaries = [card.get("boundary") or {} for card in cards.values()]
    cells = [card.get("cells") or {} for card in cards.values()]
    if any(boundaries):
        tolerance = next(b["tolerance_mm"] for b in boundaries if b)
        yield ["Outlines, mean distance", *(_with(b, "mean_mm", "mean_interval_mm") for b in boundaries)]
        yield ["Outlines, 95th percentile", *(value_text("p95_mm", b.get("p95_mm")) for b in boundaries)]
        within = (_with(b, "within_share", "within_interval") for b in boundaries)
        yield [f"Outlines within {tolerance:g} mm of each other", *within]
    if any(cells):
        yield ["Cells, of the first and of the second", *(_counts(c) for c in cells)]
        yield ["… of them matched", *(value_text("matched", c.get("matched")) for c in cells)]
        for name in ("precision", "recall", "quality"):
            yield [f"Cells, {name}", *(_with(c, name, f"{name}_interval", "recall") for c in cells)]
    for key, title, unit in (
        ("area_mm2", "area of matched cells", "mm²"),
        ("depth_mm", "depth of matched cells", "mm"),
    ):
        if any(card.get(key) for card in cards.values()):
            yield [f"Second less first, {title}", *(_limits(card.get(key), unit) for card in cards.values())]


def _with(scores: Mapping[str, Any], key: str, interval: str, shown_as: str | None = None) -> str:
    """Return a value and its interval: "0.700 (0.50 to 0.90)"."""
    if scores.get(key) is None:
        return NOTHING
    between = interval_text(scores.get(interval), 3 if key.endswith("_mm") else 2).removeprefix("95 % interval ")
    return value_text(shown_as or key, scores[key]) + (f" ({between})" if between else "")


def _counts(cells: Mapping[str, Any]) -> str:
    return f"{cells['of_reference']} and {cells['of_other']}" if cells else NOTHING


def _limits(limits: Mapping[str, Any] | None, unit: str) -> str:
    if not limits:
        return NOTHING
    bias, low, high = (f"{limits[key]:.3f}".replace("-", "−") for key in ("bias", "low", "high"))
    return f"{bias} {unit} (limits {low} to {high}, n = {limits['pairs']})"


def _raters(raters: Mapping[str, Any]) -> Iterator[str]:
    yield "<h3>Raters</h3>\n"
    rows = [
        [f"{title}, median of {of['pairs']} pairs", *(value_text(key, of[key]) for key in RATER_COLUMNS)]
        for key, title in (("within", "One rater, two sessions"), ("between", "Two raters"))
        if (of := raters.get(key))
    ]
    rows += [
        [
            f"{' '.join(pair['first'])} and {' '.join(pair['second'])}",
            *(value_text(key, pair[key]) for key in RATER_COLUMNS),
        ]
        for pair in raters["pairs"]
    ]
    yield table(rows, ["", *RATER_COLUMNS.values()])
    methods = "; ".join(f"{name}: {of['method']}" for name, of in raters["consensus"].items())
    yield f"<p class=soft>Consensus, {methods}. The majority's lies beside this page as consensus.png.</p>\n"
