"""What the tables say of scores besides the overlap: outlines, cells as objects, and raters."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from endoct.fusion.result import CellScores, Limits, PairwiseScores, Raters, Reliefs, ReliefStratum, Result, Scores
from endoct.workbench.report.wording import NOTHING, area_text, count_text, interval_text, length_text, share_text

Pair = tuple[float, float]
Names = tuple[str, str]


def score_table(result: Result) -> tuple[list[str], list[list[str]]]:
    """Return header and rows of what outlines and cells say; no rows where nothing was scored."""
    cards = dict(_cards(result))
    return ["", *(f"{first} and {second}" for first, second in cards)], list(_rows(cards))


def relief_rows(reliefs: Reliefs) -> list[list[str]]:
    """Return a row for each range of depth: how far the second side's relief lies behind the first's."""
    return [_relief_row(one) for one in reliefs.strata]


def _relief_row(one: ReliefStratum) -> list[str]:
    depths = (
        f"below {one.to:g}"
        if one.low is None
        else f"{one.low:g} and more"
        if one.to is None
        else f"{one.low:g} to {one.to:g}"
    )
    limits = None if one.low_limit is None or one.high_limit is None else (one.low_limit, one.high_limit)
    between = NOTHING if limits is None else " to ".join(f"{value:.3f}".replace("-", "−") for value in limits)
    lengths = (length_text(value) for value in (one.median, one.mean, one.spread))
    return [depths, area_text(one.area_mm2), *lengths, between, share_text(one.within_two_errors)]


def rater_rows(raters: Raters) -> list[list[str]]:
    """Return rows of how far raters agree: Jaccard, Dice, and the distances of outlines."""
    rows = [
        [f"{title}, median of {medians.pairs} pairs", *_pairwise(medians)]
        for medians, title in ((raters.within, "One rater, two sessions"), (raters.between, "Two raters"))
        if medians
    ]
    return rows + [[f"{' '.join(pair.first)} and {' '.join(pair.second)}", *_pairwise(pair)] for pair in raters.pairs]


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


def _pairwise(scores: PairwiseScores) -> Sequence[str]:
    return (
        share_text(scores.jaccard),
        share_text(scores.dice),
        length_text(scores.boundary_mean_mm),
        length_text(scores.boundary_p95_mm),
        share_text(scores.boundary_within_share),
    )
