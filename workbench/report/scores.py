"""The tables of scores besides the overlap: outlines, cells as objects, and raters."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from endoct.fusion.result import CellScores, Limits, PairwiseScores, Raters, Scores
from endoct.workbench.report.findings import Findings
from endoct.workbench.report.wording import NOTHING, count_text, interval_text, length_text, share_text, table

RATER_COLUMNS = "Jaccard", "Dice", "Outlines, mean", "95th percentile", "within tolerance"

Pair = tuple[float, float]


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
            'of <span class="code">cells.csv</span>. What each score means: docs/explanation/scores.md.</p>\n'
        )
    if raters := findings.result.raters:
        yield from _raters(raters)


def _cards(findings: Findings) -> Iterator[tuple[str, Scores]]:
    result = findings.result
    a, b = result.sides
    if result.aligned and result.scores:
        yield f"{a} and {b}", result.scores
    against: Mapping[str, Mapping[str, Scores]]
    if result.raters:
        against = {"consensus": result.raters.majority.sides}
    else:
        against = {Path(path).name: sides for path, sides in (result.truth or {}).items()}
    for name, sides in against.items():
        for side, scores in sides.items():
            yield f"{name} and {side}", scores


def _rows(cards: Mapping[str, Scores]) -> Iterator[list[str]]:
    boundaries = [card.boundary for card in cards.values()]
    cells = [card.cells for card in cards.values()]
    if tolerances := [b.tolerance_mm for b in boundaries if b]:
        yield [
            "Outlines, mean distance",
            *(_length(b.mean_mm, b.mean_interval_mm) if b else NOTHING for b in boundaries),
        ]
        yield ["Outlines, 95th percentile", *(length_text(b.p95_mm) if b else NOTHING for b in boundaries)]
        within = (_share(b.within_share, b.within_interval) if b else NOTHING for b in boundaries)
        yield [f"Outlines within {tolerances[0]:g} mm of each other", *within]
    if any(cells):
        yield ["Cells, of the first and of the second", *(_counts(c) for c in cells)]
        yield ["… of them matched", *(count_text(c.matched) if c else NOTHING for c in cells)]
        yield ["Cells, precision", *(_share(c.precision, c.precision_interval) if c else NOTHING for c in cells)]
        yield ["Cells, recall", *(_share(c.recall, c.recall_interval) if c else NOTHING for c in cells)]
        yield ["Cells, quality", *(_share(c.quality, c.quality_interval) if c else NOTHING for c in cells)]
    areas, depths = ([card.area_mm2 for card in cards.values()], [card.depth_mm for card in cards.values()])
    for limits, title, unit in ((areas, "area of matched cells", "mm²"), (depths, "depth of matched cells", "mm")):
        if any(limits):
            yield [f"Second less first, {title}", *(_limits(of, unit) for of in limits)]


def _length(value_mm: float | None, interval: Pair | None) -> str:
    """Return a length and its interval: "0.036 mm (0.027 to 0.046)"."""
    return NOTHING if value_mm is None else length_text(value_mm) + _between(interval, 3)


def _share(value: float | None, interval: Pair | None) -> str:
    """Return a share and its interval: "0.700 (0.50 to 0.90)"."""
    return NOTHING if value is None else share_text(value) + _between(interval, 2)


def _between(interval: Pair | None, digits: int) -> str:
    text = interval_text(interval, digits).removeprefix("95 % interval ")
    return f" ({text})" if text else ""


def _counts(cells: CellScores | None) -> str:
    return f"{cells.of_reference} and {cells.of_other}" if cells else NOTHING


def _limits(limits: Limits | None, unit: str) -> str:
    if limits is None:
        return NOTHING
    bias, low, high = (f"{value:.3f}".replace("-", "−") for value in (limits.bias, limits.low, limits.high))
    return f"{bias} {unit} (limits {low} to {high}, n = {limits.pairs})"


def _raters(raters: Raters) -> Iterator[str]:
    yield "<h3>Raters</h3>\n"
    rows = [
        [f"{title}, median of {medians.pairs} pairs", *_pairwise(medians)]
        for medians, title in ((raters.within, "One rater, two sessions"), (raters.between, "Two raters"))
        if medians
    ]
    rows += [[f"{' '.join(pair.first)} and {' '.join(pair.second)}", *_pairwise(pair)] for pair in raters.pairs]
    yield table(rows, ["", *RATER_COLUMNS])
    methods = "; ".join(f"{name}: {consensus.method}" for name, consensus in raters.consensus.items())
    yield f"<p class=soft>Consensus, {methods}. The majority's lies next to this page as consensus.png.</p>\n"


def _pairwise(scores: PairwiseScores) -> Sequence[str]:
    return (
        share_text(scores.jaccard),
        share_text(scores.dice),
        length_text(scores.boundary_mean_mm),
        length_text(scores.boundary_p95_mm),
        share_text(scores.boundary_within_share),
    )
