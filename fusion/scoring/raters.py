"""How far people who draw cells agree with themselves and with each other, and what they agree on."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Mask
from endoct.fusion.result import PairwiseScores, Performance, RaterAgreement, RaterMedians, RaterPair
from endoct.fusion.scoring.boundary import boundary_distances, outline
from endoct.fusion.scoring.overlap import agreement
from endoct.stitching.grid import SurfaceGrid

STAPLE_ROUNDS = 200
STAPLE_STOP = 1e-9
MOST_DRAWINGS = 30


@dataclass(frozen=True, eq=False)
class Drawing:
    """Cells that ``rater`` drew in ``session``: ``mask`` where ``valid``, bool (n_z, n_theta)."""

    rater: str
    session: str
    mask: Mask
    valid: Mask


def rater_agreement(drawings: Sequence[Drawing], grid: SurfaceGrid, tolerance_mm: float) -> RaterAgreement:
    """Return how two and more ``drawings`` on ``grid`` agree."""
    pairs = tuple(
        RaterPair(
            first=(one.rater, one.session),
            second=(two.rater, two.session),
            within=one.rater == two.rater,
            **dict(_scores(one, two, grid, tolerance_mm)),
        )
        for one, two in combinations(drawings, 2)
    )
    return RaterAgreement(
        pairs=pairs,
        within=_medians([pair for pair in pairs if pair.within]),
        between=_medians([pair for pair in pairs if not pair.within]),
    )


def majority(drawings: Sequence[Drawing]) -> Mask:
    """Return what more than half of the raters drew, each by the mean over their sessions; bool (n_z, n_theta)."""
    raters = list(dict.fromkeys(drawing.rater for drawing in drawings))
    shares = [np.mean([d.mask for d in drawings if d.rater == rater], axis=0, dtype=np.float32) for rater in raters]
    return np.asarray(np.mean(shares, axis=0) > 0.5 + 1e-6)


def staple(drawings: Sequence[Drawing], valid: Mask) -> tuple[Mask, tuple[Performance, ...]]:
    """Return (the consensus, bool (n_z, n_theta), within ``valid``; each drawing's sensitivity and specificity).

    By simultaneous truth and performance level estimation (Warfield, Zou and Wells 2004, doi:10.1109/TMI.2004.828354).
    Every drawing is a rater of its own. The prior is the mean share of cells; there is no spatial prior. A sample is
    cell where its posterior is one half or more. Raises ValueError for more than ``MOST_DRAWINGS``.
    """
    if len(drawings) > MOST_DRAWINGS:
        raise ValueError(f"{len(drawings)} drawings are more than {MOST_DRAWINGS}")
    # samples that all drawings judge alike count as one: there are few ways to be judged
    code = np.zeros(valid.shape, np.int64)
    for k, drawing in enumerate(drawings):
        code |= drawing.mask.astype(np.int64) << k
    patterns, inverse, count = np.unique(code[valid], return_inverse=True, return_counts=True)
    says = (patterns[:, np.newaxis] >> np.arange(len(drawings)) & 1).astype(np.float64)
    posterior, sensitivity, specificity = _expectation_maximisation(says, count)
    consensus = np.zeros(valid.shape, np.bool_)
    consensus[valid] = (posterior >= 0.5)[inverse]
    rows = zip(drawings, sensitivity, specificity, strict=True)
    return consensus, tuple(
        Performance(rater=d.rater, session=d.session, sensitivity=float(p), specificity=float(q)) for d, p, q in rows
    )


def _expectation_maximisation(
    says: Coordinates, count: NDArray[np.int64]
) -> tuple[Coordinates, Coordinates, Coordinates]:
    """Return (posterior (n_patterns,), sensitivity, specificity (n_drawings,)) of patterns, each ``count`` times."""
    prior = float(count @ says.mean(axis=1) / count.sum())
    sensitivity, specificity = np.full(says.shape[1], 0.99), np.full(says.shape[1], 0.99)
    posterior = np.zeros(count.size)
    for _ in range(STAPLE_ROUNDS):
        before = posterior
        if_cell = prior * np.prod(np.where(says > 0, sensitivity, 1 - sensitivity), axis=1)
        if_wall = (1 - prior) * np.prod(np.where(says > 0, 1 - specificity, specificity), axis=1)
        posterior = if_cell / np.maximum(if_cell + if_wall, np.finfo(np.float64).tiny)
        cell, wall = count * posterior, count * (1 - posterior)
        sensitivity = cell @ says / max(float(cell.sum()), 1e-12)
        specificity = wall @ (1 - says) / max(float(wall.sum()), 1e-12)
        if np.abs(posterior - before).max() < STAPLE_STOP:
            break
    return posterior, sensitivity, specificity


def _scores(first: Drawing, second: Drawing, grid: SurfaceGrid, tolerance_mm: float) -> PairwiseScores:
    both = first.valid & second.valid
    counted = agreement(first.mask, second.mask, both, grid.dz_mm * grid.dtheta_mm)
    of_first, of_second = (outline(drawing.mask, both, grid.dz_mm, grid.dtheta_mm) for drawing in (first, second))
    apart = boundary_distances(of_first, of_second, grid.n_theta * grid.dtheta_mm)
    return PairwiseScores(
        jaccard=counted.jaccard,
        dice=counted.dice,
        boundary_mean_mm=apart.mean_mm if apart else None,
        boundary_p95_mm=apart.p95_mm if apart else None,
        boundary_within_share=apart.within(tolerance_mm) if apart else None,
    )


def _medians(pairs: Sequence[PairwiseScores]) -> RaterMedians | None:
    if not pairs:
        return None
    return RaterMedians(
        pairs=len(pairs),
        jaccard=_median(pair.jaccard for pair in pairs),
        dice=_median(pair.dice for pair in pairs),
        boundary_mean_mm=_median(pair.boundary_mean_mm for pair in pairs),
        boundary_p95_mm=_median(pair.boundary_p95_mm for pair in pairs),
        boundary_within_share=_median(pair.boundary_within_share for pair in pairs),
    )


def _median(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None
