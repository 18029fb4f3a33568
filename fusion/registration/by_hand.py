"""Alignments corrected or established by landmark pairs, and their error by the pairs that were set apart to check it.

A landmark pair is a place on side A and the same place on side B, as somebody pointed them out. Pairs correct turn
and shift. The farther they lie apart, the more they also correct the scale along the bore. Handedness and direction
stay as they were found, unless three pairs or more contradict them clearly. Where nothing was found, pairs establish
an alignment by themselves: two, or three that also say which way around it is.

The turn, shift and scale that lay the landmarks of one side on those of the other best are fitted by weighted least
squares. Around the bore landmarks lie on a circle. There the sum of squared distances has a minimum for every way
of cutting it open. So every way is tried (Hotz and Huckemann 2015, Intrinsic means on the circle). The answer does
not depend on where θ = 0 is.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.fusion.evidence.side import Side
from endoct.fusion.geometry.alignment import (
    ALL_ORIENTATIONS,
    Alignment,
    LandmarkPair,
    Orientation,
    Place,
    Role,
    SearchOutcome,
    as_covariance,
    columns,
    of_role,
    residuals_mm,
)
from endoct.fusion.registration.align import FARTHEST, with_evidence
from endoct.fusion.registration.instruments import LEFT_BY_INSTRUMENTS
from endoct.fusion.result import ByHand, Distances, Moved, PairDistance, PlacedPair, StoredAlignment, StoredPlace

FEWEST = 2
"""Number of pairs that establish an alignment where none was found."""
FEWEST_FOR_ORIENTATION = 3
"""Number of pairs that may also decide the orientation."""
DECISIVE = 16.0
"""Least difference of χ² that decides between two orientations: four standard errors."""
FAR_OFF = 2.0
"""Pairs contradict the automatic alignment from this root mean square distance on, in standard errors."""
CHECK_PAIRS = "look at the pairs again: one may be on the wrong cell"


@dataclass(frozen=True)
class Scale:
    """What is known of the scale along the bore before any pair: ``value``, and ``variance``, 0 where it is given."""

    value: float = 1.0
    variance: float = 0.0


@dataclass(frozen=True)
class PairFit:
    """The ``alignment`` that fits pairs best in one orientation, with its covariance.

    Attributes
    ----------
    chi2: the sum of squared distances in standard errors.
    freedom: how many more distances there are than fitted numbers.
    scale_share: how much of the scale is by the pairs, 0 to 1; the rest is by what was known before.
    """

    alignment: Alignment
    chi2: float
    freedom: float
    scale_share: float

    @property
    def misfit(self) -> float | None:
        """How far pairs lie apart, as a multiple of what is expected; None where they decide too little to say."""
        return float(np.sqrt(self.chi2 / self.freedom)) if self.freedom else None


def fit_pairs(pairs: Sequence[LandmarkPair], orientation: Orientation, radius_mm: float, scale: Scale) -> PairFit:
    """Return the alignment of one ``orientation`` that fits one or more ``pairs`` best.

    The scale is the mean of what the pairs say and what was known before, weighted by precision. A single pair, or
    pairs close together along the bore, leave it as it was; pairs far apart decide it. It stays within ``FARTHEST``.
    The covariance is that of the places pointed out. It is larger by as much as pairs lie farther apart than their
    ``sigma_mm`` says.
    """
    mirrored, z_reversed = orientation
    a, b = columns(pairs)
    weight = np.array([pair.sigma_mm for pair in pairs], np.float64) ** -2.0
    turn_rad = mean_turn_rad(a[:, 0] - (-b[:, 0] if mirrored else b[:, 0]), weight)
    along_mm = -b[:, 1] if z_reversed else b[:, 1]
    middle_mm, there_mm = (float(np.average(z_mm, weights=weight)) for z_mm in (along_mm, a[:, 1]))
    precision = float(weight @ (along_mm - middle_mm) ** 2)
    share = precision * scale.variance / (1 + precision * scale.variance)
    value = scale.value
    if share:
        by_pairs = float(weight @ ((along_mm - middle_mm) * (a[:, 1] - there_mm))) / precision
        value = float(np.clip(share * by_pairs + (1 - share) * scale.value, *FARTHEST))
    alignment = Alignment(turn_rad, there_mm - value * middle_mm, value, mirrored, z_reversed)
    chi2 = float(weight @ (residuals_mm(pairs, alignment, radius_mm) ** 2).sum(axis=1))
    freedom = 2 * len(pairs) - 2 - share if len(pairs) > 1 else 0.0
    excess = max(1.0, chi2 / freedom) if freedom else 1.0
    of_scale = scale.variance / (1 + precision * scale.variance / excess)
    of_places = excess / float(weight.sum())
    covariance = covariance_about(middle_mm, of_places / radius_mm**2, of_places, of_scale)
    return PairFit(replace(alignment, covariance=as_covariance(covariance)), chi2, freedom, share)


def mean_turn_rad(turns_rad: Coordinates, weight: Coordinates) -> float:
    """Return the angle in [0, 2π) from which ``turns_rad``, (n,), have the least weighted sum of squared distances."""
    turn = 2 * np.pi
    sorted_rad = np.sort(np.mod(turns_rad, turn))
    weight = weight[np.argsort(np.mod(turns_rad, turn))]
    # the circle cut open before the k-th: those before it go on beyond the turn
    share = np.concatenate([[0.0], np.cumsum(weight)[:-1]]) / weight.sum()
    means = np.mod(float(np.average(sorted_rad, weights=weight)) + turn * share, turn)
    apart = np.mod(sorted_rad[np.newaxis] - means[:, np.newaxis] + np.pi, turn) - np.pi
    return float(means[np.argmin(apart**2 @ weight)])


def covariance_about(middle_mm: float, of_turn: float, of_place: float, of_scale: float) -> Coordinates:
    """Return the covariance of (turn, shift, scale), float64 (3, 3), of independent errors with these variances.

    ``of_place`` is that of the place of ``middle_mm``, on B's z as the alignment's scale multiplies it.
    """
    common = -middle_mm * of_scale
    rows = [[of_turn, 0, 0], [0, of_place + middle_mm**2 * of_scale, common], [0, common, of_scale]]
    return np.array(rows, np.float64)


@dataclass(frozen=True)
class KnownBore:
    """What is known of two sides before any pair: the radius, the orientations left open, the scales to search."""

    radius_mm: float
    orientations: tuple[Orientation, ...]
    z_scale_range: tuple[float, float]

    @property
    def scale(self) -> Scale:
        """What is known of the scale without an alignment: any within the range is equally likely."""
        low, high = self.z_scale_range
        return Scale(variance=(high - low) ** 2 / 12)


@dataclass(frozen=True)
class Judged:
    """Where pairs lead to, and what is said of that."""

    outcome: SearchOutcome
    said: ByHand


def judge(pairs: Sequence[LandmarkPair], automatic: SearchOutcome, bore: KnownBore) -> Judged:
    """Return what ``pairs`` make of the ``automatic`` alignment, and its error by those that check it.

    The corrected alignment has no confidence of its own. Raises :class:`EndoctError` where pairs clearly contradict the
    handedness or the direction that the recordings state, or do not lie as on a bore.
    """
    correcting, why = of_role(pairs, "correct"), ""
    fit = None
    if correcting and automatic.alignment:
        fit = _corrected(correcting, automatic.alignment, bore)
    elif correcting:
        fit, why = _established(correcting, bore)
    if fit is not None and fit.alignment.z_scale in FARTHEST:
        raise EndoctError(
            "the landmark pairs cannot all be right",
            found=f"{_named(correcting)}, which do not lie along the bore as on the other side",
            expected=f"a scale along the bore from {FARTHEST[0]:g} to {FARTHEST[1]:g}",
            remedy=CHECK_PAIRS,
        )
    used = automatic if fit is None else SearchOutcome(fit.alignment)
    if why:
        used = replace(used, reason=f"{used.reason} {why}")
    return Judged(used, _said(pairs, automatic, used.alignment, fit, bore.radius_mm))


def align_by_hand(a: Side, b: Side, automatic: SearchOutcome, pairs: Sequence[LandmarkPair], bore: KnownBore) -> Judged:
    """Return what ``pairs`` make of an alignment, as :func:`judge` does, with what both sides show where they put B.

    Raises :class:`EndoctError` as :func:`judge` does, and where the two share no wall there.
    """
    judged = judge(pairs, automatic, bore)
    if not judged.said.corrected or judged.outcome.alignment is None:
        return judged
    return replace(judged, outcome=SearchOutcome(_with_evidence(judged.outcome.alignment, a, b)))


def _corrected(pairs: Sequence[LandmarkPair], automatic: Alignment, bore: KnownBore) -> PairFit:
    own = automatic.mirrored, automatic.z_reversed
    scale = replace(bore.scale, value=automatic.z_scale)
    bend = None
    if automatic.covariance and not _contradict(pairs, automatic, bore.radius_mm):
        scale, bend = replace(scale, variance=automatic.covariance[2][2]), automatic.bend
    fit = fit_pairs(_straightened(pairs, automatic) if bend else pairs, own, bore.radius_mm, scale)
    fit = replace(fit, alignment=replace(fit.alignment, bend=bend))
    if len(pairs) < FEWEST_FOR_ORIENTATION:
        return fit
    best = min(_in_every_orientation(pairs, ALL_ORIENTATIONS, bore), key=lambda one: one.chi2)
    if not _clearly_better(best, fit):
        return fit
    turned = best.alignment.mirrored, best.alignment.z_reversed
    if turned in bore.orientations:
        return best
    raise EndoctError(
        f"the landmark pairs say that B is {orientation_text(turned)}, and the recordings that it is not",
        found=f"pairs {fit.misfit or 0:.0f} standard errors apart, {best.misfit or 0:.1f} if it were",
        expected=f"B {orientation_text(own)}",
        remedy=f"{CHECK_PAIRS}, or correct handedness and travel in the sidecars",
    )


def _straightened(pairs: Sequence[LandmarkPair], bent: Alignment) -> list[LandmarkPair]:
    """Return ``pairs`` with their places on B where the rigid part of ``bent`` puts them as that itself does."""
    b = columns(pairs)[1]
    theta_rad = bent.rigid.theta_to_b(bent.theta_to_a(b[:, 0], b[:, 1]))
    z_mm = bent.rigid.z_to_b(bent.z_to_a(b[:, 1]))
    return [
        replace(pair, b=Place(float(theta), float(z))) for pair, theta, z in zip(pairs, theta_rad, z_mm, strict=True)
    ]


def _contradict(pairs: Sequence[LandmarkPair], automatic: Alignment, radius_mm: float) -> bool:
    """Return whether pairs lie farther off an alignment than its covariance allows; that is then not believed."""
    sigma_mm = np.array([pair.sigma_mm for pair in pairs])
    turn_mm = radius_mm * np.sqrt(automatic.covariance[0][0] if automatic.covariance else 0.0)
    own_mm = automatic.z_error_mm([pair.b.z_mm for pair in pairs])
    allowed_mm = np.stack([np.hypot(sigma_mm, turn_mm), np.hypot(sigma_mm, own_mm)], axis=1)
    return bool(np.sqrt(np.mean((residuals_mm(pairs, automatic, radius_mm) / allowed_mm) ** 2)) > FAR_OFF)


def _established(pairs: Sequence[LandmarkPair], bore: KnownBore) -> tuple[PairFit | None, str]:
    """Return the alignment by pairs alone; or None, and a sentence on what they lack, where they say too little."""
    is_open = len(bore.orientations) > 1
    fewest = FEWEST_FOR_ORIENTATION if is_open else FEWEST
    if len(pairs) < fewest:
        which = " where nothing says which way around the sides are" if is_open else ""
        return None, f"{_count(pairs)} cannot establish an alignment: it needs {fewest}{which}."
    fits = sorted(_in_every_orientation(pairs, bore.orientations, bore), key=lambda one: one.chi2)
    if len(fits) > 1 and not _clearly_better(fits[0], fits[1]):
        one, other = (orientation_text((f.alignment.mirrored, f.alignment.z_reversed)) for f in fits[:2])
        return None, f"{_count(pairs)} fit with B {one} and {other}: they need to lie farther apart."
    return fits[0], ""


def _in_every_orientation(
    pairs: Sequence[LandmarkPair], orientations: Sequence[Orientation], bore: KnownBore
) -> list[PairFit]:
    return [fit_pairs(pairs, orientation, bore.radius_mm, bore.scale) for orientation in orientations]


def _clearly_better(fit: PairFit, other: PairFit) -> bool:
    return other.chi2 - fit.chi2 >= DECISIVE * max(1.0, (fit.misfit or 0.0) ** 2)


def _with_evidence(alignment: Alignment, a: Side, b: Side) -> Alignment:
    one, two = a.evidence, b.evidence
    shared = with_evidence(alignment, one, two)
    if shared is None:
        of_b_mm = alignment.z_to_a(two.z_mm)
        raise EndoctError(
            f"as the landmark pairs lay {b.name} on {a.name}, the two share no wall",
            found=f"{b.name} from z = {of_b_mm.min():.2f} to {of_b_mm.max():.2f} mm",
            expected=f"some of it between {one.z_mm[0]:.2f} and {one.z_mm[-1]:.2f} mm",
            remedy=CHECK_PAIRS,
        )
    covariance = np.array(alignment.covariance)
    if (one.kind == "relief") != (two.kind == "relief"):
        direction = -1.0 if alignment.z_reversed else 1.0
        of_turn, of_place, of_scale = (left**2 for left in LEFT_BY_INSTRUMENTS)
        covariance += covariance_about(direction * float(two.z_mm[[0, -1]].mean()), of_turn, of_place, of_scale)
    return replace(shared, covariance=as_covariance(covariance))


def _said(
    pairs: Sequence[LandmarkPair],
    automatic: SearchOutcome,
    used: Alignment | None,
    fit: PairFit | None,
    radius_mm: float,
) -> ByHand:
    found = automatic.alignment
    before = None if found is None else residuals_mm(pairs, found, radius_mm)
    after = None if used is None else residuals_mm(pairs, used, radius_mm)
    turned = fit is not None and (
        found is None or (found.mirrored, found.z_reversed) != (fit.alignment.mirrored, fit.alignment.z_reversed)
    )
    return ByHand(
        corrected=fit is not None,
        automatic=StoredAlignment.of(found or automatic.best),
        automatic_reason=None if found else automatic.reason,
        scale_share=0.0 if fit is None else fit.scale_share,
        orientation_by_pairs=turned,
        moved=None if fit is None or found is None or turned else _moved(found, fit.alignment, pairs, radius_mm),
        misfit=None if fit is None else fit.misfit,
        pairs=tuple(
            PlacedPair(
                name=pair.name,
                role=pair.role,
                a=StoredPlace(theta_rad=pair.a.theta_rad, z_mm=pair.a.z_mm),
                b=StoredPlace(theta_rad=pair.b.theta_rad, z_mm=pair.b.z_mm),
                sigma_mm=pair.sigma_mm,
                before=distance(before, k),
                after=distance(after, k),
            )
            for k, pair in enumerate(pairs)
        ),
        correct=distances(pairs, "correct", after),
        check=distances(pairs, "check", after),
    )


def distance(residuals: Coordinates | None, k: int) -> PairDistance | None:
    """Return how far pair ``k`` lies apart, by its residuals; None where there are none."""
    if residuals is None:
        return None
    around_mm, along_mm = (float(value) for value in residuals[k])
    return PairDistance(around_mm=around_mm, along_mm=along_mm, distance_mm=float(np.hypot(around_mm, along_mm)))


def _moved(old: Alignment, new: Alignment, pairs: Sequence[LandmarkPair], radius_mm: float) -> Moved:
    middle_mm = float(np.mean([pair.b.z_mm for pair in of_role(pairs, "correct")]))
    turn_rad = float(np.angle(np.exp(1j * (new.theta_shift_rad - old.theta_shift_rad))))
    return Moved(
        around_mm=turn_rad * radius_mm,
        along_mm=float(new.z_to_a(middle_mm) - old.z_to_a(middle_mm)),
        turn_rad=turn_rad,
        z_scale=new.z_scale / old.z_scale,
    )


def distances(pairs: Sequence[LandmarkPair], role: Role, residuals: Coordinates | None) -> Distances | None:
    """Return how far the pairs of one role lie apart, by the residuals of all pairs; None where there are none."""
    chosen = [k for k, pair in enumerate(pairs) if pair.role == role]
    if residuals is None or not chosen:
        return None
    around_mm, along_mm = np.abs(residuals[chosen]).T
    apart_mm = np.hypot(around_mm, along_mm)
    return Distances(
        pairs=len(chosen),
        median_mm=float(np.median(apart_mm)),
        max_mm=float(apart_mm.max()),
        around_median_mm=float(np.median(around_mm)),
        around_max_mm=float(around_mm.max()),
        along_median_mm=float(np.median(along_mm)),
        along_max_mm=float(along_mm.max()),
    )


def orientation_text(orientation: Orientation) -> str:
    """Return an orientation in words, "mirrored in θ"."""
    mirrored, z_reversed = orientation
    turns = ["mirrored in θ"] * mirrored + ["reversed in z"] * z_reversed
    return " and ".join(turns) or "neither mirrored nor reversed"


def _count(pairs: Sequence[LandmarkPair]) -> str:
    return f"{len(pairs)} landmark pair{'s' * (len(pairs) != 1)}"


def _named(pairs: Sequence[LandmarkPair]) -> str:
    return ", ".join(pair.name or "one without a name" for pair in pairs[:5])
