"""The pose that fits best: robust least squares of the air that a CT has on the wall against what sides show."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from endoct.fusion.pose.air import AirAround
from endoct.fusion.pose.observation import Observation
from endoct.fusion.pose.search import Candidate
from endoct.fusion.pose.wall import DEPTH, EDGE, OF_SIDE, SHARED, TURN, Sense, prior_deviations, wall_places
from endoct.stitching.arrays import Coordinates

SOFTNESS = (1.0, 0.6, 0.4, 0.25, 0.15, 0.1)
"""Residuals in shares of air beyond which samples count less and less (Geman and McClure), in turn."""
ROUNDS, LEAST_MOVE_MM, MOST_MOVE_MM = 8, 1e-3, 0.3
GAINS = (0.7, 1.4)
PATCH_MM = 0.35
"""Samples closer than this are about one."""
TILE_MM = 2.0
"""Of wall whose errors are about one: a cell."""
LEAST_VARIANCE = 1e-4
AWAY_FROM_EDGES = 0.1
"""Weight of samples far from any edge that a side shows, over that of those at one.

A cell that a side misses, or that lies hidden just behind the wall, pulls over all its area, and says nothing of where
the bore lies.
"""


@dataclass(frozen=True, eq=False)
class Fit:
    """A pose fitted to sides: ``parameters`` (n,) as :mod:`endoct.fusion.pose.wall` says, ``covariance`` (n, n).

    ``agreement``: by side, the correlation of what it shows with what the CT has there.
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


def fit_pose(air: AirAround, sides: Sequence[Observation], senses: Sequence[Sense], start: torch.Tensor) -> Fit:
    """Return the pose of ``sides`` together that fits ``air`` best near ``start``, (SHARED + n · OF_SIDE,)."""
    device = air.values.device
    at = start.to(device=device, dtype=torch.float64).clone()
    inverse_prior = torch.diag(prior_deviations(tuple(sides)).to(device) ** -2)
    levels = [(1.0, 0.0)] * len(sides)
    for softness in SOFTNESS:
        for _ in range(ROUNDS):
            information, gradient = inverse_prior.clone(), -inverse_prior @ at
            for number, (side, sense) in enumerate(zip(sides, senses, strict=True)):
                seen = _compared(air, side, sense, at, number)
                levels[number], weight, residual = _levelled(seen, levels[number], softness)
                counts, moved = _counting(side, weight, residual), levels[number][0] * seen.moved
                part = torch.cat([torch.arange(SHARED), SHARED + OF_SIDE * number + torch.arange(OF_SIDE)]).to(device)
                information[part[:, None], part] += moved.T @ (moved * (counts * weight)[:, None])
                gradient[part] += moved.T @ (counts * weight * residual)
            move = torch.linalg.solve(information, gradient)
            ends_mm = float(move[:2].abs().max() + air.length_mm / 2 * move[2:SHARED].abs().max())
            at = at + move * min(1.0, MOST_MOVE_MM / max(ends_mm, 1e-9))
            if ends_mm < LEAST_MOVE_MM:
                break
    return _finished(air, sides, senses, at, levels, inverse_prior)


@dataclass(frozen=True, eq=False)
class _Compared:
    """Samples of all layers of a side (m,): what it shows, its weight, what the CT has, and its change (m, n)."""

    shown: torch.Tensor
    weight: torch.Tensor
    has: torch.Tensor
    moved: torch.Tensor


def _compared(air: AirAround, side: Observation, sense: Sense, at: torch.Tensor, number: int) -> _Compared:
    own = torch.cat([at[:SHARED], at[SHARED + OF_SIDE * number : SHARED + OF_SIDE * (number + 1)]])
    parts = []
    for layer in side.layers:
        places, moved = wall_places(side, sense, air.length_mm / 2, own, layer.behind_mm)
        has, gradient = air.share_and_gradient(places)
        gradient = gradient.to(torch.float64)
        change = torch.einsum("iztp,izt->ztp", moved.permute(2, 0, 1, 3), gradient)
        slope = gradient.norm(dim=0)
        change[..., SHARED + EDGE] = slope
        has = has + own[SHARED + EDGE] * slope
        shown = at.new_tensor(layer.air)
        weight = at.new_tensor(layer.weight) * (AWAY_FROM_EDGES + (1 - AWAY_FROM_EDGES) * 4 * shown * (1 - shown))
        parts.append((shown.flatten(), weight.flatten(), has.flatten(), change.flatten(0, 1)))
    return _Compared(*(torch.cat(one) for one in zip(*parts, strict=True)))


def _levelled(
    seen: _Compared, levels: tuple[float, float], softness: float
) -> tuple[tuple[float, float], torch.Tensor, torch.Tensor]:
    """Return gain and offset of what is shown over what the CT has, the robust weights, and the residuals."""
    gain, offset = levels
    weight = _robust(seen.weight, seen.shown - gain * seen.has - offset, softness)
    total = weight.sum()
    shown, has = (weight * seen.shown).sum() / total, (weight * seen.has).sum() / total
    spread = (weight * (seen.has - has) ** 2).sum().clamp_min(1e-9)
    gain = float(((weight * (seen.has - has) * (seen.shown - shown)).sum() / spread).clamp(*GAINS))
    offset = float(shown - gain * has)
    residual = seen.shown - gain * seen.has - offset
    return (gain, offset), _robust(seen.weight, residual, softness), residual


def _robust(weight: torch.Tensor, residual: torch.Tensor, softness: float) -> torch.Tensor:
    robust: torch.Tensor = weight / (1 + (residual / softness) ** 2) ** 2
    return robust


def _counting(side: Observation, weight: torch.Tensor, residual: torch.Tensor) -> torch.Tensor:
    """Return by how much a sample counts: independent ones for each, over the variance."""
    variance = ((weight * residual**2).sum() / weight.sum()).clamp_min(LEAST_VARIANCE)
    step, column = float(side.z_mm[1] - side.z_mm[0]), 2 * np.pi * side.radius_mm / side.layers[0].air.shape[1]
    counts: torch.Tensor = step * column / PATCH_MM**2 / float(np.sqrt(len(side.layers))) / variance
    return counts


def _finished(
    air: AirAround,
    sides: Sequence[Observation],
    senses: Sequence[Sense],
    at: torch.Tensor,
    levels: Sequence[tuple[float, float]],
    inverse_prior: torch.Tensor,
) -> Fit:
    """Return the fit with its covariance: scatter of the tiles' pulls between the inverses of the information."""
    information, scatter, agreement = inverse_prior.clone(), inverse_prior.clone(), []
    for number, (side, sense) in enumerate(zip(sides, senses, strict=True)):
        seen = _compared(air, side, sense, at, number)
        _, weight, residual = _levelled(seen, levels[number], SOFTNESS[-1])
        counts, moved = _counting(side, weight, residual), levels[number][0] * seen.moved
        part = torch.cat([torch.arange(SHARED), SHARED + OF_SIDE * number + torch.arange(OF_SIDE)]).to(at.device)
        information[part[:, None], part] += moved.T @ (moved * (counts * weight)[:, None])
        pulls = moved * (counts * weight * residual)[:, None]
        tiles = torch.zeros(int(_tiles(side).max()) + 1, pulls.shape[1], dtype=torch.float64, device=at.device)
        tiles.index_add_(0, torch.as_tensor(_tiles(side), device=at.device).repeat(len(side.layers)), pulls)
        scatter[part[:, None], part] += tiles.T @ tiles
        agreement.append(_correlation(seen))
    inverse = torch.linalg.inv(information)
    covariance = inverse @ scatter @ inverse
    return Fit(tuple(sides), tuple(senses), at.cpu().numpy(), covariance.cpu().numpy(), tuple(agreement))


def _tiles(side: Observation) -> NDArray[np.int64]:
    """Return for each sample of a layer the tile of wall it lies on, (n_z · n_theta,)."""
    n_z, n_theta = side.layers[0].air.shape
    step = float(side.z_mm[1] - side.z_mm[0])
    rows = np.arange(n_z) * step // TILE_MM
    around = max(1, round(2 * np.pi * side.radius_mm / TILE_MM))
    return np.asarray(rows[:, None] * around + np.arange(n_theta) * around // n_theta, dtype=np.int64).ravel()


def _correlation(seen: _Compared) -> float:
    weight = seen.weight / seen.weight.sum()
    shown, has = seen.shown - (weight * seen.shown).sum(), seen.has - (weight * seen.has).sum()
    spread = torch.sqrt((weight * shown**2).sum() * (weight * has**2).sum()).clamp_min(1e-12)
    return float((weight * shown * has).sum() / spread)
