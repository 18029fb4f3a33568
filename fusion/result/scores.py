"""How far masks of one wall agree: overlap, outlines, cells, and what matched cells measure.

The budget says where the disagreement of two sides comes from: 1 − J parted into four causes. The scores of raters
say how far people who draw cells agree, and what they agree on.
"""

from typing import Annotated

from pydantic import ConfigDict, Field, model_validator

from endoct.fusion.result.part import Count, Interval, Number, Part, Texts, WholeOrNumber


class Overlap(Part):
    """Two masks, counted sample by sample where both sides observed the wall.

    ``jaccard`` |A ∩ B| / |A ∪ B| and ``dice`` 2 |A ∩ B| / (|A| + |B|), None where neither shows a cell; areas on the
    nominal bore; ``sites``: places where either shows a cell, over which the intervals are bootstrapped;
    ``jaccard_without_two``: the least and the largest index that is left without any one or two of them, None where
    there are no more than two.
    """

    jaccard: Number | None = None
    dice: Number | None = None
    both_mm2: Number | None = None
    only_a_mm2: Number | None = None
    only_b_mm2: Number | None = None
    neither_mm2: Number | None = None
    sites: Count | None = None
    jaccard_interval: Interval | None = None
    dice_interval: Interval | None = None
    jaccard_without_two: Interval | None = None


class _RowsOf(Part):
    rows_of: str


class OwnRows(Overlap, _RowsOf):
    """The overlap on the samples of the side ``rows_of``, which is not interpolated."""

    jaccard: Number | None


class BoundaryScores(Part):
    """How far two outlines lie from each other on the wall, mm, over the length of both.

    ``within_share``: share of that length that lies within ``tolerance_mm`` of the other.
    """

    mean_mm: Number | None = None
    mean_interval_mm: Interval | None = None
    p95_mm: Number | None = None
    within_share: Number | None = None
    within_interval: Interval | None = None
    tolerance_mm: Number


class CellScores(Part):
    """Cells as objects, those of ``other`` against those of ``reference``; only cells that both sides observed.

    ``quality`` is the panoptic quality; ``half_covered_of_…`` the share of cells of which the other side's mask covers
    one half and more.
    """

    reference: str | None = None
    other: str | None = None
    of_reference: Count
    of_other: Count
    matched: Count | None = None
    precision: Number | None = None
    precision_interval: Interval | None = None
    recall: Number | None = None
    recall_interval: Interval | None = None
    quality: Number | None = None
    quality_interval: Interval | None = None
    overlap_of_matched: Number | None = None
    half_covered_of_reference: Number | None = None
    half_covered_of_other: Number | None = None


class Limits(Part):
    """Limits of agreement of ``pairs`` of measurements, B's less A's (Bland and Altman 1986).

    ``bias`` is their mean, ``low`` and ``high`` what 95 % of them lie between if they are normal.
    """

    pairs: Count
    bias: Number
    low: Number
    high: Number
    bias_interval: Interval | None = None


class Line(Part):
    """How far matched cells lie apart along z: the mean, mm, the slope by least squares, and its standard error."""

    mean: Number | None = None
    per_mm: Number
    per_mm_error: Number


class Drift(Part):
    """How far matched whole cells lie apart, B's less A's, along z (``z_mm``) and around the bore (``arc_mm``)."""

    pairs: Count | None = None
    length_mm: Number
    z_mm: Line
    arc_mm: Line


class Stratum(Part):
    """The Jaccard index over sites of one kind, from ``low`` on and below ``to``; None: open."""

    low: Number | None = Field(validation_alias="from", serialization_alias="from")
    to: Number | None
    sites: Count
    area_mm2: Number | None = None
    jaccard: Number | None
    jaccard_interval: Interval | None
    only_first: Number | None = None
    only_second: Number | None = None


Rows = Annotated[tuple[Stratum, ...], Field(strict=False)]


class Strata(Part):
    """Sites by their diameter, depth and contrast; the last two where a side knows them."""

    model_config = ConfigDict(extra="forbid")

    diameter_mm: Rows = ()
    depth_mm: Rows = ()
    contrast: Rows = ()

    def by_kind(self) -> dict[str, tuple[Stratum, ...]]:
        """Return the rows of each kind that there is."""
        kinds = {"diameter_mm": self.diameter_mm, "depth_mm": self.depth_mm, "contrast": self.contrast}
        return {name: rows for name, rows in kinds.items() if name in self.model_fields_set}


class ReliefStratum(Part):
    """Where both reliefs together lie from ``low`` on and below ``to`` behind the wall, mm; None: open.

    ``mean``, ``median`` and robust ``spread`` of the second relief less the first, mm; ``low_limit`` and ``high_limit``
    its 2.5th and 97.5th percentiles; ``within_two_errors`` the share within two stated standard errors. None where
    there are too few samples, or no error is stated.
    """

    low: Number | None = Field(validation_alias="from", serialization_alias="from")
    to: Number | None
    area_mm2: Number
    mean: Number | None = None
    median: Number | None = None
    spread: Number | None = None
    low_limit: Number | None = None
    high_limit: Number | None = None
    within_two_errors: Number | None = None


class Reliefs(Part):
    """How far the relief of the side ``second`` lies behind that of ``first``, by depth.

    ``known``: share of what both observed where both know the depth; nothing within ``rim_mm`` of an outline counts.
    """

    first: str
    second: str
    known: Number
    rim_mm: Number
    strata: Annotated[tuple[ReliefStratum, ...], Field(strict=False)]


class Scores(Part):
    """All scores of two masks besides their overlap, each None where there is nothing to score."""

    boundary: BoundaryScores | None = None
    cells: CellScores | None = None
    area_mm2: Limits | None = None
    depth_mm: Limits | None = None
    drift: Drift | None = None
    strata: Strata | None = None


class _OnGrid(Part):
    grid: Overlap = Overlap()


class PairScores(Scores, _OnGrid):
    """The scores of the two sides: ``grid`` their overlap on the common grid, ``own_rows`` that on B's own samples.

    ``reliefs`` compares their depth, where both know it.
    """

    own_rows: OwnRows | None = None
    reliefs: Reliefs | None = None


class MaskScores(Scores, Overlap):
    """The scores of one side against a mask in side A's frame, the mask being A."""

    jaccard: Number | None


class BudgetPart(Part):
    """What one cause costs: a share of 1, the union of both sides' cells, and its interval over patches of wall."""

    share: Number
    interval: Interval | None


class BudgetParts(Part):
    """The four causes; they sum to 1 − J."""

    alignment: BudgetPart
    sampling: BudgetPart
    visibility: BudgetPart
    segmentation: BudgetPart

    def by_cause(self) -> dict[str, BudgetPart]:
        """Return the parts by name, in the order in which they are taken off."""
        return {
            "alignment": self.alignment,
            "sampling": self.sampling,
            "visibility": self.visibility,
            "segmentation": self.segmentation,
        }


class NotVisible(Part):
    """Cells of one side of which the other has no sign."""

    cells: Count
    area_mm2: WholeOrNumber


class Budget(Part):
    """1 − J by causes; ``not_visible`` and ``not_covered`` (mm²) by the side that does not show the other's cells."""

    one_minus_jaccard: Number
    parts: BudgetParts
    alignment_known: bool
    not_visible: dict[str, NotVisible]
    not_covered: dict[str, WholeOrNumber]
    draws: Count | None = None


class DrawnBy(Part):
    """Who drew the mask at ``path``, and when."""

    path: str
    rater: str
    session: str


class PairwiseScores(Part):
    """Overlap of two drawn masks, and the distance of their outlines, mm; None where there is nothing to score."""

    jaccard: Number | None
    dice: Number | None
    boundary_mean_mm: Number | None
    boundary_p95_mm: Number | None
    boundary_within_share: Number | None


class _Named(Part):
    first: Texts
    second: Texts
    within: bool | None = None


class RaterPair(PairwiseScores, _Named):
    """Two drawn masks, each named by (rater, session); ``within``: both are of one rater."""


class _OfPairs(Part):
    pairs: Count


class RaterMedians(PairwiseScores, _OfPairs):
    """The median of each score over ``pairs`` pairs."""


class RaterAgreement(Part):
    """Any two drawn masks, and the medians ``within`` one rater and ``between`` two, None without such a pair."""

    pairs: Annotated[tuple[RaterPair, ...], Field(strict=False)]
    within: RaterMedians | None = None
    between: RaterMedians | None = None


class Consensus(Part):
    """What raters agree on by one ``method``, and every side's scores against that."""

    method: str
    sides: dict[str, MaskScores]


class Performance(Part):
    """How well one rater draws in one session, by STAPLE."""

    rater: str
    session: str
    sensitivity: Number
    specificity: Number


class _Drawn(Part):
    drawings: Annotated[tuple[DrawnBy, ...], Field(strict=False)] = ()


class Raters(RaterAgreement, _Drawn):
    """Several drawn masks: how far they agree, their consensus by method, and how well each of them is drawn."""

    consensus: dict[str, Consensus]
    performance: Annotated[tuple[Performance, ...], Field(strict=False)] = ()

    @model_validator(mode="after")
    def _has_majority(self) -> "Raters":
        if "majority" not in self.consensus:
            raise ValueError("no majority")
        return self

    @property
    def majority(self) -> Consensus:
        """What more than half of the raters drew."""
        return self.consensus["majority"]
