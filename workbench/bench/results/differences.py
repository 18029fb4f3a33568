"""How methods differ from one of them, case by case: the same cases, so that their difficulty cancels."""

from collections.abc import Sequence
from dataclasses import dataclass

from endoct.workbench.bench.results.frame import SCORE, frame_of
from endoct.workbench.bench.results.summary import Spread, spread
from endoct.workbench.bench.runner import Row


@dataclass(frozen=True)
class Difference:
    """A score of a method minus that of the reference, over the cases that have both.

    ``lower`` and ``higher`` count the cases in which it is negative and positive.
    """

    method: str
    score: str
    spread: Spread
    lower: int
    higher: int


def differences(rows: Sequence[Row], reference: str, scores: Sequence[str]) -> list[Difference]:
    """Return every method's differences from ``reference``, those of the first score first.

    So a method that has no first score, since it was never aligned, changes nothing in the order of the scores.
    """
    frame = frame_of(rows)
    is_reference = frame["method"] == reference
    base = frame[is_reference].drop_duplicates("case", keep="last").set_index("case")
    others = frame[~is_reference]
    differing = []
    for column in (f"{SCORE}{score}" for score in scores):
        by_case = (others[column] - others["case"].map(base[column])).dropna()
        for method, values in by_case.groupby(others["method"], sort=False):
            lower, higher = int((values < 0).sum()), int((values > 0).sum())
            differing.append(Difference(str(method), column.removeprefix(SCORE), spread(values), lower, higher))
    return differing
