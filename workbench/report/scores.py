"""The tables of scores besides the overlap: outlines, cells as objects, and raters."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from endoct.fusion.result import CellScores, Limits, PairwiseScores, Raters, Result, Scores
from endoct.workbench.report.wording import NOTHING, count_text, interval_text, length_text, share_text, table

RATER_COLUMNS = "Jaccard", "Dice", "Outlines, mean distance", "95th percentile", "within tolerance"

Pair = tuple[float, float]
Names = tuple[str, str]


def score_tables(result: Result) -> Iterator[str]:
    """Yield what outlines, cells and raters say, as HTML; nothing where nothing was scored."""
    cards = dict(_cards(result))
    if rows := list(_rows(cards)):
        yield "<h3>Outlines and cells</h3>\n"
        yield table(rows, ["", *(f"{first} and {second}" for first, second in cards)])
        yield (
            "<p class=soft>In brackets: 95 % intervals. Outlines: distance on the wall from either to the other, where "
            "both observed. Cells match where the area they share is at least half of their union. Only cells at "
            "least half of which the other side observed are counted. Precision: of the cells of the one named second, "
            "the share that the first shows too. Recall: of the cells of the first, the share that the second shows. "
            "Quality: both of these and the overlap of matched cells in one number (panoptic quality). Each cell is a "
            'line of <span class="code">cells.csv</span>.</p>\n'
        )
    if raters := result.raters:
        yield from _raters(raters)


def _cards(result: Result) -> Iterator[tuple[Names, Scores]]:
    """Yield the scores of every pair by its two names."""
    a, b = result.sides
    if result.aligned and result.scores:
        yield (a, b), result.scores
    against: Mapping[str, Mapping[str, Scores]]
    if result.raters:
        against = {"consensus": result.raters.majority.sides}
    else:
        against = {Path(path).name: sides for path, sides in (result.truth or {}).items()}
    for name, sides in against.items():
        for side, scores in sides.items():
            yield (name, side), scores


def _rows(cards: Mapping[Names, Scores]) -> Iterator[list[str]]:
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
        yield ["Cells counted", *(_counts(names, c) for names, c in zip(cards, cells, strict=True))]
        yield ["Cells matched", *(count_text(c.matched) if c else NOTHING for c in cells)]
        yield ["Cells, precision", *(_share(c.precision, c.precision_interval) if c else NOTHING for c in cells)]
        yield ["Cells, recall", *(_share(c.recall, c.recall_interval) if c else NOTHING for c in cells)]
        yield ["Cells, quality", *(_share(c.quality, c.quality_interval) if c else NOTHING for c in cells)]
    areas, depths = ([card.area_mm2 for card in cards.values()], [card.depth_mm for card in cards.values()])
    for limits, title, unit in ((areas, "Area of matched cells", "mm²"), (depths, "Depth of matched cells", "mm")):
        if any(limits):
            yield [f"{title}, difference", *(_limits(n, of, unit) for n, of in zip(cards, limits, strict=True))]


def _length(value_mm: float | None, interval: Pair | None) -> str:
    """Return a length and its interval: "0.036 mm (0.027 to 0.046)"."""
    return NOTHING if value_mm is None else length_text(value_mm) + _between(interval, 3)


def _share(value: float | None, interval: Pair | None) -> str:
    """Return a share and its interval: "0.700 (0.50 to 0.90)"."""
    return NOTHING if value is None else share_text(value) + _between(interval, 2)


def _between(interval: Pair | None, digits: int) -> str:
    text = interval_text(interval, digits).removeprefix("95 % interval ")
    return f" ({text})" if text else ""


def _counts(names: Names, cells: CellScores | None) -> str:
    """Return "endoscope 21, oct 18"."""
    return f"{names[0]} {cells.of_reference}, {names[1]} {cells.of_other}" if cells else NOTHING


def _limits(names: Names, limits: Limits | None, unit: str) -> str:
    """Return "oct − endoscope: −0.018 mm² (95 % within −0.194 to 0.158, 4 cells)"."""
    if limits is None:
        return NOTHING
    bias, low, high = (f"{value:.3f}".replace("-", "−") for value in (limits.bias, limits.low, limits.high))
    return f"{names[1]} − {names[0]}: {bias} {unit} (95 % within {low} to {high}, {limits.pairs} cells)"


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
