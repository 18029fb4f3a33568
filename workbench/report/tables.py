"""The tables of a report: overlap, outlines, cells, raters, alignment, landmark pairs, sides, and how it all was made.

An alignment is where one side lies in the frame of the other, in words; if landmark pairs corrected or checked it,
that too.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from endoct.fusion.doubts import pairs_text
from endoct.fusion.result import (
    ByHand,
    CellScores,
    Distances,
    Limits,
    PairDistance,
    PairwiseScores,
    Raters,
    Reliefs,
    Result,
    Scores,
    StoredAlignment,
    Threshold,
)
from endoct.stitching.grid import SurfaceGrid
from endoct.workbench.report.findings import Findings, NamedOverlap
from endoct.workbench.report.side_findings import SideFindings
from endoct.workbench.report.wording import (
    NOTHING,
    area_text,
    count_text,
    interval_text,
    length_text,
    share_text,
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
ROLES = {"correct": "corrects", "check": "checks"}

Pair = tuple[float, float]
Names = tuple[str, str]


def side_table(findings: Findings) -> tuple[list[str], list[list[str]]]:
    """Return header and rows of what there is to say of either side."""
    columns = [_side_facts(side, findings.result) for side in findings.sides]
    rows = [[name, *(column[name] for column in columns)] for name in columns[0]]
    return ["", *(side.name for side in findings.sides)], rows


def overlap_table(overlaps: Sequence[NamedOverlap]) -> tuple[list[str], list[list[str]]]:
    """Return header and rows of ``overlaps``, without columns of which nothing is known."""
    columns = {title: [text(named) for named in overlaps] for title, text in OVERLAP_COLUMNS.items()}
    columns = {title: cells for title, cells in columns.items() if title in ALWAYS or set(cells) != {NOTHING}}
    names = [f"{named.of[0]} and {named.of[1]}, {named.where}" for named in overlaps]
    return ["", *columns], [list(row) for row in zip(names, *columns.values(), strict=True)]


def plane_rows(result: Result) -> list[list[str]]:
    """Return a row for each plane that cuts the bore: its side, place, dip, azimuth and support; standard errors."""
    return [
        [
            side,
            f"{length_text(plane.z_mm)} ± {length_text(plane.z_error_mm)}",
            f"{math.degrees(plane.dip_rad):.1f}° ± {math.degrees(plane.dip_error_rad):.1f}°",
            f"{math.degrees(plane.azimuth_rad):.1f}° ± {math.degrees(plane.azimuth_error_rad):.1f}°",
            f"{plane.support:.0%}",
        ]
        for side, planes in result.planes.items()
        for plane in planes
    ]


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
    text = of if threshold.value is None else f"{of}, above {threshold.value:.3g}{unit}"
    if (depth := threshold.by_depth) is None:
        return text
    changed = f"added {depth.added:.1%} of the wall and dropped {depth.dropped:.1%}"
    return f"{text}; depth, known on {depth.known:.0%}, {changed}"


def _only_one(named: NamedOverlap) -> str:
    """Return "endoscope 0.47 mm², oct 0.21 mm²"."""
    areas = zip(named.of, (named.overlap.only_a_mm2, named.overlap.only_b_mm2), strict=True)
    known = [f"{name} {area_text(area)}" for name, area in areas if area is not None]
    return ", ".join(known) or NOTHING


def _side_facts(side: SideFindings, result: Result) -> dict[str, str]:
    panorama = side.panorama
    cells = float(side.mask[side.valid].mean()) if side.valid.any() else math.nan
    depth = NOTHING
    known_mm = None if side.depth_mm is None else side.depth_mm[side.valid & np.isfinite(side.depth_mm)]
    if known_mm is not None and known_mm.size:
        low, high = (float(v) for v in np.percentile(known_mm, (5, 95)))
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


def alignment_rows(alignment: StoredAlignment, *, by_hand: bool = False) -> Iterator[tuple[str, str]]:
    """Yield what there is to say of an alignment, [in words, value]; errors are standard errors.

    For one that was made ``by_hand``, nothing says how far it stands out: no search led to it.
    """
    turn, shift, scale = _standard_errors(alignment)
    yield "Turned by", _degrees(alignment.theta_shift_rad, "°") + turn
    yield "Shifted along the bore by", length_text(alignment.z_shift_mm) + shift
    yield "Scaled along the bore by", f"{alignment.z_scale:.4f}{scale}"
    yield "Mirrored in θ", value_text("mirrored", alignment.mirrored)
    yield "Reversed in z", value_text("z_reversed", alignment.z_reversed)
    if not by_hand:
        yield "Confidence", share_text(alignment.confidence)
    yield "Correlation of what shows the cells", share_text(alignment.correlation)
    if not by_hand:
        yield "Score over that of the next best place", _number(alignment.ratio)
        yield "Probability that chance gives as much", _number(alignment.chance)
    yield "Area that both observed", area_text(alignment.overlap_mm2)
    if by_hand:
        return
    if bend := alignment.bend:
        along_mm, roll_rad = (max(map(abs, part), default=0.0) for part in (bend.shift_mm, bend.roll_rad))
        yield "Bends along the bore, by up to", f"{length_text(along_mm)} along, {_degrees(roll_rad, '°')} around"
    yield "Left uncorrected: departure from that turn around θ, up to", _degrees(alignment.uneven_rad, "°")
    yield "Left uncorrected: turn that grows along the bore", _degrees(alignment.twist_rad_per_mm, "° per mm")


def _standard_errors(alignment: StoredAlignment) -> tuple[str, str, str]:
    """Return " ± 0.28°", " ± 0.013 mm" and " ± 0.0028"; empty where they are not known."""
    if alignment.covariance is None:
        return "", "", ""
    variances = np.diag(alignment.covariance)
    if (variances < 0).any():
        return "", "", ""
    turn, shift, scale = (float(value) for value in np.sqrt(variances))
    return f" ± {math.degrees(turn):.2f}°", f" ± {length_text(shift)}", f" ± {scale:.4f}"


def _degrees(value_rad: float | None, unit: str) -> str:
    return NOTHING if value_rad is None else f"{math.degrees(value_rad):.2f}{unit}".replace("-", "−")


def _number(value: float | None) -> str:
    return NOTHING if value is None else f"{value:.3g}".replace("-", "−")


def by_hand_headline(said: ByHand) -> str:
    """Return the headline of an alignment that pairs made: "Corrected by 3 landmark pairs; 2 others lie …"."""
    did = "Aligned by hand, by" if said.automatic_reason is not None else "Corrected by"
    return f"{did} {pairs_text(said)}; {_error(said.check)}."


def by_hand_sentences(said: ByHand) -> Iterator[str]:
    """Yield sentences on what pairs did and what they say."""
    if said.corrected and said.moved is not None:
        yield (
            f"By hand it was moved by {_signed(said.moved.along_mm)} along and {_signed(said.moved.around_mm)} around "
            "the bore, amid the pairs, against the automatic alignment."
        )
    if said.corrected and said.correct is not None:
        yield (
            f"The pairs that corrected it lie {length_text(said.correct.median_mm)} apart (median) since; that is no "
            "error of the alignment, which followed them."
        )
    if said.check is not None:
        error = _error(said.check)
        yield f"{error[:1].upper()}{error[1:]}."


def pair_rows(said: ByHand) -> list[list[str]]:
    """Return a row for each pair: what it does, and how far its places lay apart before and lie now."""
    return [
        [
            f"{number} {pair.name}".strip(),
            ROLES[pair.role] if said.corrected or pair.role == "check" else "would correct",
            *_distance(pair.before),
            *_distance(pair.after),
        ]
        for number, pair in enumerate(said.pairs, 1)
    ]


def _error(check: Distances | None) -> str:
    if check is None:
        return "no pair was set apart to check it, so that its error is not known"
    pairs = f"{check.pairs} pair{'s' * (check.pairs != 1)} that had no part in it"
    if check.pairs == 1:
        return f"1 pair that had no part in it lies {length_text(check.median_mm)} off"
    return f"{pairs} lie {length_text(check.median_mm)} off (median), {length_text(check.max_mm)} at most"


def _distance(distance: PairDistance | None) -> tuple[str, str]:
    if distance is None:
        return NOTHING, NOTHING
    return _signed(distance.around_mm), _signed(distance.along_mm)


def _signed(value_mm: float) -> str:
    return f"{value_mm:+.3f} mm".replace("-", "−")


def score_table(result: Result) -> tuple[list[str], list[list[str]]]:
    """Return header and rows of what outlines and cells say; no rows where nothing was scored."""
    cards = dict(_cards(result))
    return ["", *(f"{first} and {second}" for first, second in cards)], list(_rows(cards))


def relief_rows(reliefs: Reliefs) -> list[list[str]]:
    """Return a row for each range of depth: how far the second side's relief lies behind the first's."""
    rows = []
    for stratum in reliefs.strata:
        if stratum.low is None:
            depths = f"below {stratum.to:g}"
        else:
            depths = f"{stratum.low:g} and more" if stratum.to is None else f"{stratum.low:g} to {stratum.to:g}"
        limits = [limit for limit in (stratum.low_limit, stratum.high_limit) if limit is not None]
        between = NOTHING if len(limits) < 2 else " to ".join(f"{limit:.3f}".replace("-", "−") for limit in limits)
        lengths = (length_text(value) for value in (stratum.median, stratum.mean, stratum.spread))
        rows.append([depths, area_text(stratum.area_mm2), *lengths, between, share_text(stratum.within_two_errors)])
    return rows


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
