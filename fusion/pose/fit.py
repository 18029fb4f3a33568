"""The pose that fits best: robust least squares of the air that a CT has on the wall against what sides show."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from endoct.base.arrays import Coordinates
from endoct.fusion.pose.air import AirAround
from endoct.fusion.pose.observation import Observation
from endoct.fusion.pose.search import Candidate
from endoct.fusion.pose.wall import DEPTH, EDGE, OF_SIDE, RIMS, SHARED, TURN, Sense, prior_deviations, wall_places

SOFTNESS = (1.0, 0.6, 0.4, 0.25, 0.15, 0.1)
"""Samples count less and less beyond these residuals, in shares of air and in turn (Geman and McClure)."""
ROUNDS, LEAST_MOVE_MM, MOST_MOVE_MM = 8, 1e-3, 0.3
GAINS = (0.7, 1.4)
LEAST_VARIANCE = 1e-3
"""Least variance of residuals, in shares of air: no two instruments see a cell more alike."""
ALIKE = 0.35
"""How alike two sides err that look for the same cells in the same CT. It is the correlation of their errors across the
axis at the target, from 46 simulated bores of the preset 'patient', seeds 2000 to 2062."""
LEAST_FREE = 1.0
"""Least number of independent samples beyond the parameters that they determine."""


@dataclass(frozen=True, eq=False)
class PoseFit:
    """A pose fitted to sides: ``parameters`` (n,) as :mod:`endoct.fusion.pose.wall` says, ``covariance`` (n, n).

    ``agreement`` is, by side, the correlation of what it shows near edges with what the CT has there.
    """

    sides: tuple[Observation, ...]
    senses: tuple[Sense, ...]
    parameters: Coordinates
    covariance: Coordinates
    agreement: tuple[float, ...]

    def of_side(self, number: int) -> Coordinates:
        """Return the parameters of one side, (OF_SIDE,)."""
        first = SHARED + OF_SIDE * number
        return np.asarray(self.parameters[first : first + OF_SIDE])


def start_of(candidate: Candidate) -> torch.Tensor:
    """Return the parameters of a side alone at a candidate of the search."""
    start = torch.zeros(SHARED + OF_SIDE, dtype=torch.float64)
    start[:SHARED] = torch.tensor(candidate.axis)
    start[SHARED + DEPTH], start[SHARED + TURN] = candidate.depth_mm, candidate.turn_rad
    return start


def fit_pose(
    air: AirAround,
    sides: Sequence[Observation],
    senses: Sequence[Sense],
    start: torch.Tensor,
    *,
    softness: Sequence[float] = SOFTNESS,
    leading: Sequence[bool] | None = None,
) -> PoseFit:
    """Return the pose of ``sides`` together that fits ``air`` best near ``start``, (SHARED + n · OF_SIDE,).

    Samples count less and less beyond residuals of ``softness``, in shares of air and in turn. ``leading`` says which
    sides move the axis, all by default. The others only find their own depth and turn along it.
    """
    leading = leading or [True] * len(sides)
    at = start.to(device=air.values.device, dtype=torch.float64).clone()
    levels = [(1.0, 0.0)] * len(sides)
    inverse_prior = torch.diag(prior_deviations(tuple(sides)).to(at.device) ** -2)
    for soft in softness:
        for _ in range(ROUNDS):
            information, gradient = inverse_prior.clone(), -inverse_prior @ at
            for number, (side, sense) in enumerate(zip(sides, senses, strict=True)):
                seen = _compared(air, side, sense, at, number)
                levels[number], moved, counts, residual = _weighed(side, seen, levels[number], soft)
                if not leading[number]:
                    moved = torch.cat([torch.zeros_like(moved[:, :SHARED]), moved[:, SHARED:]], dim=1)
                part = _part(number)
                information[part[:, None], part] += moved.T @ (moved * counts[:, None])
                gradient[part] += moved.T @ (counts * residual)
            move = torch.linalg.solve(information, gradient)
            ends_mm = float(move[:2].abs().max() + air.length_mm / 2 * move[2:SHARED].abs().max())
            at = at + move * min(1.0, MOST_MOVE_MM / max(ends_mm, 1e-9))
            if ends_mm < LEAST_MOVE_MM:
                break
    return _finished(air, sides, senses, at, levels, leading)


def _part(number: int) -> torch.Tensor:
    """Return the indices of the parameters that one side depends on."""
    return torch.cat([torch.arange(SHARED), SHARED + OF_SIDE * number + torch.arange(OF_SIDE)])


@dataclass(frozen=True, eq=False)
class _Compared:
    """Samples of a side that count (m,): what it shows, with what weight, what the CT has, and its change (m, n)."""

    shown: torch.Tensor
    weight: torch.Tensor
    has: torch.Tensor
    moved: torch.Tensor


def _compared(air: AirAround, side: Observation, sense: Sense, at: torch.Tensor, number: int) -> _Compared:
    own = torch.cat([at[:SHARED], at[SHARED + OF_SIDE * number : SHARED + OF_SIDE * (number + 1)]])
    parts = []
    for layer in side.layers:
        # bare wall says nothing: the CT's noise and the density of bone would be taken for a pattern there
        telling = np.nonzero(layer.weight * layer.air * (1 - layer.air))
        shown = at.new_tensor(layer.air[telling])
        weight = at.new_tensor(layer.weight[telling]) * 4 * shown * (1 - shown)
        places, moved = wall_places(side, sense, air.length_mm / 2, own, layer.behind_mm, telling)
        has, gradient = air.share_and_gradient(places)
        gradient = gradient.to(torch.float64)
        change = torch.einsum("mip,im->mp", moved, gradient)
        slope, along = gradient.norm(dim=0), change[:, SHARED + DEPTH].abs()
        change[:, SHARED + EDGE], change[:, SHARED + RIMS] = slope, along
        has = has + own[SHARED + EDGE] * slope + own[SHARED + RIMS] * along
        parts.append((shown, weight, has, change))
    return _Compared(*(torch.cat(one) for one in zip(*parts, strict=True)))


def _levelled(
    samples: _Compared, levels: tuple[float, float], softness: float
) -> tuple[tuple[float, float], torch.Tensor, torch.Tensor]:
    """Return gain and offset of what is shown over what the CT has, the robust weights, and the residuals."""
    gain, offset = levels
    weight = _robust(samples.weight, samples.shown - gain * samples.has - offset, softness)
    total = weight.sum().clamp_min(1e-9)  # 0 where a side shows no edge
    shown, has = (weight * samples.shown).sum() / total, (weight * samples.has).sum() / total
    spread = (weight * (samples.has - has) ** 2).sum().clamp_min(1e-9)
    gain = float(((weight * (samples.has - has) * (samples.shown - shown)).sum() / spread).clamp(*GAINS))
    offset = float(shown - gain * has)
    residual = samples.shown - gain * samples.has - offset
    return (gain, offset), _robust(samples.weight, residual, softness), residual


def _robust(weight: torch.Tensor, residual: torch.Tensor, softness: float) -> torch.Tensor:
    robust: torch.Tensor = weight / (1 + (residual / softness) ** 2) ** 2
    return robust


def _weighed(
    side: Observation, samples: _Compared, levels: tuple[float, float], softness: float
) -> tuple[tuple[float, float], torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return (new levels; how parameters change the samples, (m, n); how much these count; their residuals).

    A sample counts as its share of an independent one, over the variance of them all.
    """
    levels, weight, residual = _levelled(samples, levels, softness)
    variance = ((weight * residual**2).sum() / weight.sum().clamp_min(1e-9)).clamp_min(LEAST_VARIANCE)
    return levels, levels[0] * samples.moved, weight * _share_of_one(side) / variance, residual


def _share_of_one(side: Observation) -> float:
    """Return which share of an independent sample each sample is."""
    step, column = float(side.z_mm[1] - side.z_mm[0]), 2 * np.pi * side.radius_mm / side.layers[0].air.shape[1]
    return float(step * column / side.alike_mm**2 / np.sqrt(len(side.layers)))


def _finished(
    air: AirAround,
    sides: Sequence[Observation],
    senses: Sequence[Sense],
    at: torch.Tensor,
    levels: Sequence[tuple[float, float]],
    leading: Sequence[bool],
) -> PoseFit:
    """Return the fit with its covariance."""
    n = at.numel()
    covariance, of_axis, agreement = np.zeros((n, n)), [], []
    for number, (side, sense) in enumerate(zip(sides, senses, strict=True)):
        seen = _compared(air, side, sense, at, number)
        _, moved, counts, residual = _weighed(side, seen, levels[number], SOFTNESS[-1])
        own = _of_one(side, moved, counts, residual)
        part = _part(number).numpy()
        covariance[np.ix_(part[SHARED:], part[SHARED:])] = own[SHARED:, SHARED:]
        if leading[number]:
            of_axis.append(own[:SHARED, :SHARED])
            covariance[np.ix_(part, part)] += np.pad(own[:SHARED, SHARED:], ((0, OF_SIDE), (SHARED, 0)))
            covariance[np.ix_(part, part)] += np.pad(own[SHARED:, :SHARED], ((SHARED, 0), (0, OF_SIDE)))
        agreement.append(_correlation(seen))
    covariance[:SHARED, :SHARED] = _together(of_axis)
    return PoseFit(tuple(sides), tuple(senses), at.cpu().numpy(), covariance, tuple(agreement))


def _together(each: Sequence[Coordinates]) -> Coordinates:
    """Return the covariance of the weighted mean of axes that err alike, from that of ``each``."""
    weights, roots = [np.linalg.inv(one) for one in each], [np.linalg.cholesky(one) for one in each]
    mean = np.linalg.inv(np.sum(weights, axis=0))
    spread = np.linalg.inv(mean)
    for one in range(len(each)):
        for other in range(len(each)):
            if one != other:
                spread += weights[one] @ (ALIKE * roots[one] @ roots[other].T) @ weights[other]
    return np.asarray(mean @ spread @ mean)


def _of_one(side: Observation, moved: torch.Tensor, counts: torch.Tensor, residual: torch.Tensor) -> Coordinates:
    """Return the covariance (n, n) of one side's fit.

    It is what edges leave open, and nothing else. The fit goes through the edges, so their residuals are smaller than
    their errors: much smaller where there are few.
    """
    prior = torch.diag(prior_deviations((side,)).to(moved.device) ** -2)
    of_edges = moved.T @ (moved * counts[:, None])
    inverse = torch.linalg.inv(prior + of_edges)
    total = counts.sum().clamp_min(1e-9)
    samples = float(total * ((counts * residual**2).sum() / total).clamp_min(LEAST_VARIANCE))
    taken = float(torch.trace(inverse @ of_edges))
    covariance = inverse @ (prior + samples / max(samples - taken, LEAST_FREE) * of_edges) @ inverse
    covariance[SHARED + DEPTH, SHARED + DEPTH] += side.along_mm**2
    return np.asarray(covariance.cpu().numpy())


def _correlation(samples: _Compared) -> float:
    """Return the correlation of what a side shows with what the CT has, near the edges that the side shows."""
    weight = samples.weight * samples.shown * (1 - samples.shown)
    weight = weight / weight.sum().clamp_min(1e-12)
    shown, has = samples.shown - (weight * samples.shown).sum(), samples.has - (weight * samples.has).sum()
    spread = torch.sqrt((weight * shown**2).sum() * (weight * has**2).sum()).clamp_min(1e-12)
    return float((weight * shown * has).sum() / spread)
