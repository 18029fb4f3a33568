"""The result of a comparison as types; only they know the keys of ``result.json``."""

from endoct.fusion.result.budget import Budget, BudgetPart, BudgetParts, NotVisible
from endoct.fusion.result.by_hand import ByHand, Distances, Moved, PairDistance, PlacedPair, StoredPlace
from endoct.fusion.result.part import Interval
from endoct.fusion.result.raters import (
    Consensus,
    DrawnBy,
    PairwiseScores,
    Performance,
    RaterAgreement,
    RaterMedians,
    RaterPair,
    Raters,
)
from endoct.fusion.result.result import (
    Believable,
    Bootstrap,
    CorrectedTwist,
    Result,
    Threshold,
)
from endoct.fusion.result.scores import (
    BoundaryScores,
    CellScores,
    Drift,
    Limits,
    Line,
    MaskScores,
    Overlap,
    OwnRows,
    PairScores,
    Scores,
    Strata,
    Stratum,
)
from endoct.fusion.result.stored_alignment import StoredAlignment

__all__ = [
    "Believable",
    "Bootstrap",
    "BoundaryScores",
    "Budget",
    "BudgetPart",
    "BudgetParts",
    "ByHand",
    "CellScores",
    "Consensus",
    "CorrectedTwist",
    "Distances",
    "DrawnBy",
    "Drift",
    "Interval",
    "Limits",
    "Line",
    "MaskScores",
    "Moved",
    "NotVisible",
    "Overlap",
    "OwnRows",
    "PairDistance",
    "PairScores",
    "PairwiseScores",
    "Performance",
    "PlacedPair",
    "RaterAgreement",
    "RaterMedians",
    "RaterPair",
    "Raters",
    "Result",
    "Scores",
    "StoredAlignment",
    "StoredPlace",
    "Strata",
    "Stratum",
    "Threshold",
]
