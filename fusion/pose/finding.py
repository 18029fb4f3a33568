"""The pose of a bore from one recording or two: searched for, fitted, and held against chance.

The answer says where the bore lies, by all sides and by each alone, or why that stays open.

Patterns that cannot be in the bone, made of a side's own pieces, say what chance gives. The best place of such a
pattern, over the same axes, turns and depths, is what the true one has to beat.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from endoct.base.arrays import Coordinates
from endoct.base.doubt import Doubt
from endoct.base.numeric.circle import wrap_rad
from endoct.fusion.pose.air import AirAround
from endoct.fusion.pose.fit import SOFTNESS, PoseFit, fit_pose, start_of
from endoct.fusion.pose.observation import Observation
from endoct.fusion.pose.pose import BorePose
from endoct.fusion.pose.search import (
    ASIDE_MM,
    TILT_RAD,
    Candidate,
    Pattern,
    axes_around,
    candidates_along,
    favours_mirror,
    pattern_of,
    senses_of,
    shuffled_patterns,
    turned_patterns,
)
from endoct.fusion.pose.support import mirror_reason, open_handedness, support_doubts, too_wide
from endoct.fusion.pose.wall import SHARED
from endoct.modalities.ct.trajectory import Trajectory

STARTS = 3
"""A fit begins at so many places of the search that lie apart."""
APART_MM, APART_RAD = 0.8, 0.35
BEYOND = 1.25
"""A fit that ends farther off the plan than so many times what was searched has left the place that it began at."""
ROUGH, FINE = SOFTNESS[:3], SOFTNESS[3:]
LEAST_STANDING = 3.0
"""A pattern has to stand above the mean score of the controls by so many of their spreads. Of 12 bores on tuning seeds,
ten of them sparse, the least had 3.4. In another bone the most had 2.5."""
LEAST_ALONG = 2.0
"""The same along the axis that the other side finds, where a pattern has far fewer places to fit by chance. Seven of
136 recordings of other bores reached it, and all eleven of the same bore."""
LEAST_BY_DEPTH, LEAST_BY_CELLS = 0.4, 0.45
"""Least agreement with the CT near edges. By cells alone, mirrored bores of the preset 'patient' reach 0.44."""
MOST_APART = 28.5
"""The square of how far two sides' axes may lie apart over their covariance. It is χ² of four degrees of freedom, which
two axes of one bore exceed once in 100 000."""
CLOSE_AGREEMENT = 0.05
"""A second pose that lies apart, and fits as well but for so much, leaves open which is right."""
Summary = tuple[tuple[float, float, float, float], float, float]
"""A pose in short: its axis, depth and turn."""


@dataclass(frozen=True, eq=False)
class PoseAnswer:
    """The best ``pose`` there is, by all sides together, and by each ``alone``.

    Attributes
    ----------
    reason: why it cannot be told, in a full sentence; None where it is told.
    standing: by side, how far its score lies above that of control patterns, in their spreads.
    doubts: about a pose that is told, the gravest first. The sense of θ may not be known. Stretches without an edge may
        be long, the ellipse wide, or the pattern may hardly stand out. A side may be unable to tell the pose alone.
        Then the axis is by the other one, and this one's depth and turn may be wrong.
    """

    pose: BorePose
    alone: tuple[BorePose, ...]
    reason: str | None
    standing: tuple[float, ...]
    doubts: tuple[Doubt, ...] = ()


@dataclass(frozen=True, eq=False)
class SidePose:
    """The best pose of one side alone.

    Attributes
    ----------
    second: how well the best pose apart from it agrees; None where all fits met.
    standing: how far the score of the search lies above the mean of the controls, in their spreads.
    mirrored: whether the sense of θ is known, and the mirror image of the CT fits better.
    """

    fit: PoseFit
    second: float | None
    standing: float
    mirrored: bool = False

    @property
    def reason(self) -> str | None:
        """Why this side cannot tell the pose alone; None where it can."""
        name, agreement, least = self.fit.sides[0].name, self.fit.agreement[0], _least_of(self.fit.sides[0])
        if agreement < least:
            said = f"the {name}'s edges correlate {agreement:.2f} with the CT's at best, {least:g} at least"
            return f"{said}; the mirror image of the CT fits better" if self.mirrored else said
        if self.mirrored:
            return mirror_reason(name)
        if self.standing < LEAST_STANDING:
            return (
                f"the {name}'s pattern fits hardly better than rearranged ones would: "
                f"{self.standing:.1f} of their spreads above their mean, {LEAST_STANDING:g} at least"
            )
        aside_mm, tilt_rad = (float(np.hypot(*self.fit.parameters[one : one + 2])) for one in (0, 2))
        if aside_mm > BEYOND * ASIDE_MM or tilt_rad > BEYOND * TILT_RAD:
            return (
                f"the {name}'s pattern fits best {aside_mm:.1f} mm and {np.degrees(tilt_rad):.1f}° off the plan, "
                f"where bores are looked for within {ASIDE_MM:g} mm and {np.degrees(TILT_RAD):g}°"
            )
        if self.second is not None and self.second > agreement - CLOSE_AGREEMENT:
            return f"the {name}'s pattern fits as well at another place"
        return None


def find_pose(air: AirAround, plan: Trajectory, sides: Sequence[Observation]) -> PoseAnswer:
    """Return the pose of the bore that one or two ``sides`` show, in the CT that ``air`` was taken from."""
    return answer(air, plan, [find_alone(air, side) for side in sides])


def answer(air: AirAround, plan: Trajectory, alone: Sequence[SidePose]) -> PoseAnswer:
    """Return the pose by all sides, each of which was found ``alone``, or why it cannot be told.

    It cannot where no side can tell it, where sides contradict each other, or where a mirror image fits. Nor can it
    where the edges of cells leave it open.
    """
    together = alone[0].fit if len(alone) == 1 else fit_together(air, alone)
    pose = BorePose(plan, together)
    reasons = [one.reason for one in alone if one.reason is not None]
    by_mirror, of_hands = _of_hands(air, alone, together)
    reason = "; ".join(reasons) if len(reasons) == len(alone) else None
    reason = reason or by_mirror or _contradiction(air, alone) or _stranger(air, alone, together) or too_wide(pose)
    standing = [one.standing for one in alone if one.reason is None]
    left_out = (Doubt("side-left-out", f"{one}: its own depth and turn may be wrong") for one in reasons)
    doubts = (*of_hands, *support_doubts(pose, standing), *left_out)
    return PoseAnswer(
        pose=pose,
        alone=tuple(BorePose(plan, one.fit) for one in alone),
        reason=reason,
        standing=tuple(one.standing for one in alone),
        doubts=() if reason is not None else doubts,
    )


def _of_hands(air: AirAround, alone: Sequence[SidePose], together: PoseFit) -> tuple[str | None, list[Doubt]]:
    """Return why a mirror image rules the pose out, if it does, and doubts about the sense of θ."""
    senses = zip(together.sides, together.senses, strict=True)
    unknown = [(side.name, sense) for side, sense in senses if not side.handed]
    for one in alone if unknown else ():
        if (side := one.fit.sides[0]).handed:
            mirrored = favours_mirror(air, side, together.parameters[:SHARED])
            if mirrored:
                return mirror_reason(side.name), []
            if mirrored is False or one.reason is None:
                return None, []
    return None, [open_handedness(unknown)] if unknown else []


def find_alone(air: AirAround, side: Observation) -> SidePose:
    """Return the pose that ``side`` alone has in ``air``."""
    starts, standing, mirrored = searched(air, side)
    return replace(fitted(air, side, starts, standing), mirrored=mirrored)


def searched(air: AirAround, side: Observation) -> tuple[list[Candidate], float, bool]:
    """Return (the best candidates that lie apart; how far the first stands out; whether a mirror image fits better).

    How far it stands out is in spreads of the controls. A mirror image is tried where the sense of θ is known.
    """
    device = str(air.values.device)
    true, controls = _patterns(side, device)
    back = [replace(sense, turning=-sense.turning) for sense in senses_of(side)] if side.handed else []
    mirrored = [pattern_of(side, sense, device) for sense in back]
    by_pattern = candidates_along(air, side, [*true, *controls, *mirrored], axes_around(air.length_mm))
    best = [some[0].score for some in by_pattern]
    highest, others = max(best[: len(true)]), len(true) + len(controls)
    standing = _standing(highest, best[len(true) : others])
    candidates = sorted((one for some in by_pattern[: len(true)] for one in some), key=lambda one: -one.score)
    mirror_fits = max(best[others:], default=-1.0) > highest
    return _apart(candidates, air.length_mm), standing, mirror_fits


def standing_along(air: AirAround, side: Observation, axis: Coordinates) -> float:
    """Return how far ``side`` stands out of its controls along one axis (4,), at its best depth and turn."""
    true, controls = _patterns(side, str(air.values.device))
    best = [some[0].score for some in candidates_along(air, side, [*true, *controls], axis[np.newaxis])]
    return _standing(max(best[: len(true)]), best[len(true) :])


def _patterns(side: Observation, device: str) -> tuple[list[Pattern], list[Pattern]]:
    """Return the patterns of a side in its senses, and controls of it, equally many of either kind."""
    true = [pattern_of(side, sense, device) for sense in senses_of(side)]
    return true, [*turned_patterns(true[0]), *shuffled_patterns(true[0])]


def fitted(air: AirAround, side: Observation, starts: Sequence[Candidate], standing: float) -> SidePose:
    """Return the best pose of ``side`` that a fit finds from ``starts``."""
    rough = [fit_pose(air, [side], [one.sense], start_of(one), softness=ROUGH) for one in starts]
    rough.sort(key=lambda fit: -fit.agreement[0])
    others = [fit.agreement[0] for fit in rough[1:] if differ(summary(fit), summary(rough[0]), air.length_mm)]
    fit = fit_pose(air, [side], rough[0].senses, torch.as_tensor(rough[0].parameters), softness=FINE)
    return SidePose(fit, max(others, default=None), standing)


def fit_together(air: AirAround, alone: Sequence[SidePose]) -> PoseFit:
    """Return the pose of sides that were found alone: one axis, each side's own depth and turn.

    The axis is by those that can tell it alone, if any can: another one may lie anywhere, and would pull it there. The
    fit begins at the axis of the side that stands out most of these. A side that found another axis searches anew along
    that one. Where none has to, the fit is only made finer, so that no side leaves the place that it found.
    """
    leading = [one.reason is None for one in alone]
    if not any(leading):
        leading = [True] * len(alone)
    leader = max((one for one, leads in zip(alone, leading, strict=True) if leads), key=lambda one: one.standing)
    axis = leader.fit.parameters[:SHARED]
    start, senses = [torch.as_tensor(axis)], []
    softness: Sequence[float] = FINE
    for one in alone:
        side = one.fit.sides[0]
        if not differ(summary(one.fit), (summary(leader.fit)[0], *summary(one.fit)[1:]), air.length_mm):
            start.append(torch.as_tensor(one.fit.of_side(0)))
            senses.append(one.fit.senses[0])
            continue
        patterns = [pattern_of(side, sense, str(air.values.device)) for sense in senses_of(side)]
        along = candidates_along(air, side, patterns, axis[np.newaxis])
        best = max((some[0] for some in along), key=lambda candidate: candidate.score)
        start.append(start_of(best)[SHARED:])
        senses.append(best.sense)
        softness = SOFTNESS
    sides = [one.fit.sides[0] for one in alone]
    return fit_pose(air, sides, senses, torch.cat(start), softness=softness, leading=leading)


def _standing(score: float, of_controls: Sequence[float]) -> float:
    """Return how far a score lies above the mean of controls, in spreads: the less of both kinds; 0 without a pattern.

    ``of_controls`` are the scores of one kind, then as many of the other.
    """
    kinds = np.reshape(of_controls, (2, -1))
    spreads, apart = kinds.std(axis=1, ddof=1), score - kinds.mean(axis=1)
    return float(np.min(apart / spreads)) if (spreads > 0).all() else 0.0


def _contradiction(air: AirAround, alone: Sequence[SidePose]) -> str | None:
    """Return how two sides that each stand out contradict each other, None where they do not.

    A side that shows edges too poorly to tell the pose alone can still be right about where the bore is not.
    """
    if len(alone) < 2 or any(one.standing < LEAST_STANDING for one in alone):
        return None
    (one, by_one), (other, by_other) = ((each.fit.parameters[:SHARED], each.fit.covariance) for each in alone)
    apart = one - other
    if apart @ np.linalg.solve((by_one + by_other)[:SHARED, :SHARED], apart) < MOST_APART:
        return None
    axes = [BorePose(Trajectory((0, 0, 0), (0, 0, air.length_mm)), each.fit) for each in alone]
    ends = [axis.axis_lps(np.array([0.0, air.length_mm])) for axis in axes]
    distance = float(np.linalg.norm(ends[0] - ends[1], axis=1).max())
    names = [axis.names[0] for axis in axes]
    return f"{names[0]} and {names[1]} find axes that lie {distance:.2f} mm apart, more than either could be off"


def _stranger(air: AirAround, alone: Sequence[SidePose], together: PoseFit) -> str | None:
    """Return which side is not of the bore that the other one finds; None where each fits somewhere along it."""
    for one, side, agreement in zip(alone, together.sides, together.agreement, strict=True):
        if one.reason is None:
            continue
        where = f"along the axis that the other side finds the {side.name}'s"
        if agreement < _least_of(side):
            said = f"edges correlate {agreement:.2f} with the CT's, {_least_of(side):g} at least"
        elif (standing := standing_along(air, side, together.parameters[:SHARED])) < LEAST_ALONG:
            said = f"pattern stands {standing:.1f} spreads above rearranged ones, {LEAST_ALONG:g} at least"
        elif one.mirrored:
            said = "pattern is there, but it fits the mirror image of the CT better"
        else:
            continue
        return f"{where} {said}: of another bore, or too poor; try the other side alone"
    return None


def _least_of(side: Observation) -> float:
    return LEAST_BY_DEPTH if len(side.layers) > 1 else LEAST_BY_CELLS


def _apart(candidates: Sequence[Candidate], length_mm: float) -> list[Candidate]:
    """Return the best candidates that lie apart from each other."""
    chosen: list[Candidate] = []
    for one in candidates:
        here = (one.axis, one.depth_mm, one.turn_rad)
        if all(differ(here, (other.axis, other.depth_mm, other.turn_rad), length_mm) for other in chosen):
            chosen.append(one)
        if len(chosen) == STARTS:
            break
    return chosen


def summary(fit: PoseFit) -> Summary:
    """Return the axis, depth and turn of the first side's pose."""
    x, y, about_x, about_y = (float(value) for value in fit.parameters[:SHARED])
    depth, turn = (float(value) for value in fit.of_side(0)[:2])
    return (x, y, about_x, about_y), depth, turn


def differ(here: Summary, there: Summary, length_mm: float) -> bool:
    """Return whether two poses in the same bone are two places rather than one."""
    apart = np.abs(np.subtract(here[0], there[0]))
    ends_mm = float(apart[:2].max() + length_mm / 2 * apart[2:].max())
    turn = abs(float(wrap_rad(np.array(here[2] - there[2]))))
    return ends_mm > APART_MM or abs(here[1] - there[1]) > APART_MM or turn > APART_RAD
