"""How far two masks of one wall agree: overlap, outlines, cells, and what matched cells measure."""

from typing import Annotated

from pydantic import ConfigDict, Field

from endoct.fusion.result.part import Count, Interval, Number, Part


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
    """The scores of the two sides: ``grid`` their overlap on the common grid, ``own_rows`` that on B's own samples."""

    own_rows: OwnRows | None = None


class MaskScores(Scores, Overlap):
    """The scores of one side against a mask in side A's frame, the mask being A."""

    jaccard: Number | None
