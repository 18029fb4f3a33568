"""How far people who draw cells agree, and what they agree on."""

from typing import Annotated

from pydantic import Field, model_validator

from endoct.fusion.result.part import Count, Number, Part, Texts
from endoct.fusion.result.scores import MaskScores


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
