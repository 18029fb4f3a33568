"""How far masks of one wall agree, as parts of a result: overlap, outlines, cells, and what matched cells measure.

The budget says where the disagreement of two sides comes from: 1 − J parted into four causes. The scores of raters
say how far people who draw cells agree, and what they agree on.

Every part of a result is a frozen record that keeps to its kinds. It knows what was stated: a key that was not is
absent from the JSON again. None is null, and stands where something was looked for and is not there. Keys that no
part names are kept as they came, so that results of other versions can be read and written.
"""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, model_validator

Number = Annotated[float, Field(ge=-1e12, le=1e12, allow_inf_nan=False)]
WholeOrNumber = Annotated[int | float, Field(ge=-1e12, le=1e12, allow_inf_nan=False)]
"""A number that stays whole where it is whole: the sum over nothing is 0, not 0.0."""
Count = Annotated[int, Field(ge=0, le=10**12)]
# JSON has lists only: a list is taken for a tuple, but what it holds is checked strictly
Interval = Annotated[tuple[Number, Number], Field(strict=False)]
Numbers = Annotated[tuple[Number, ...], Field(strict=False)]
Texts = Annotated[tuple[str, ...], Field(strict=False)]


class Part(BaseModel):
    """A part of a result, see the module."""

    model_config = ConfigDict(strict=True, frozen=True, extra="allow", populate_by_name=True)


class Overlap(Part):
    """Two masks, counted sample by sample where both sides observed the wall; areas are on the nominal bore.

    Attributes
    ----------
    jaccard, dice: |A ∩ B| / |A ∪ B| and 2 |A ∩ B| / (|A| + |B|), None where neither shows a cell.
    sites: places where either shows a cell, over which the intervals are bootstrapped.
    jaccard_without_two: the least and the largest index that is left without any one or two sites; None where there
        are no more than two.
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

    @property
    def is_empty(self) -> bool:
        """Whether neither side shows a cell, so that there is nothing to score."""
        return self.jaccard is None or self.sites == 0


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

    ``quality`` is the panoptic quality. ``half_covered_of_…`` is the share of cells of which the other side's mask
    covers one half or more.
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
        return {kind: getattr(self, kind) for kind in Strata.model_fields if kind in self.model_fields_set}


class ReliefStratum(Part):
    """Where both reliefs together lie from ``low`` on and below ``to`` behind the wall, mm; None: open.

    ``mean``, ``median`` and robust ``spread`` are of the second relief less the first, mm; ``low_limit`` and
    ``high_limit`` are its 2.5th and 97.5th percentiles. ``within_two_errors`` is the share within two stated standard
    errors. They are None where there are too few samples, or no error is stated.
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


class ByLi(_OnGrid):
    """The overlap of the two sides by Li's threshold alone, on the same samples as that of the cells that were found.

    ``threshold``: by side, in mm where its depth was thresholded; else a difference of logarithms of the intensity.
    """

    own_rows: OwnRows
    threshold: dict[str, Number]


class PairScores(Scores, _OnGrid):
    """The scores of the two sides: ``grid`` their overlap on the common grid, ``own_rows`` that on B's own samples.

    ``by_li`` is their overlap by Li's threshold alone; None where a side is a mask or shows nothing to threshold.
    ``reliefs`` compares their depth, where both know it.
    """

    own_rows: OwnRows | None = None
    by_li: ByLi | None = None
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
        return {cause: getattr(self, cause) for cause in BudgetParts.model_fields}


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


class Contradiction(Part):
    """A cell that the side ``shown_by`` surely shows, where the other side surely shows plain wall.

    ``theta_rad``, ``z_mm``: its middle, in A's frame. ``relief_mm``: its median depth as measured; ``probability``: of
    a cell there by the learned eye, in the median.
    """

    shown_by: str
    theta_rad: Number
    z_mm: Number
    area_mm2: Number
    relief_mm: Number
    probability: Number


class WallSummary(Part):
    """The one wall: its cells, their area and volume with standard errors, and contradictions, largest first."""

    cells: Count
    area_mm2: Number
    area_error_mm2: Number
    volume_mm3: Number
    volume_error_mm3: Number
    contradictions: Annotated[tuple[Contradiction, ...], Field(strict=False)] = ()
