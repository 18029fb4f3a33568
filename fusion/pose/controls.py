"""Patterns that cannot be in the bone, made of a side's own pieces. They tell what chance gives.

The best place of such a pattern, over the same axes, turns and depths, is what the true one has to beat. Two kinds:
*turned* ones have every piece of the bore where it is, but turned about the axis, so that how much air there is along
the bore stays as it is; *shuffled* ones have the pieces in another order as well.

Each piece holds as much of the pattern: of cells that all lie in a third of the bore, pieces of one length would leave
most together, and the pattern would have to beat itself.
"""

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from endoct.fusion.pose.search import ROWS_MM, Pattern

PIECE_MM = 4.0
"""Their mean length."""
LEAST_HELD = 0.02
"""Of the mean, what bare rows count for."""
OF_EACH_KIND = 10
SEED = 17


def turned_patterns(pattern: Pattern, count: int = OF_EACH_KIND) -> list[Pattern]:
    """Return ``count`` patterns whose pieces are turned, the same ones for the same pattern."""
    rng = np.random.default_rng(SEED)
    n_pieces = _n_pieces(pattern)
    return [_rearranged(pattern, range(n_pieces), _turns(rng, pattern, n_pieces)) for _ in range(count)]


def shuffled_patterns(pattern: Pattern, count: int = OF_EACH_KIND) -> list[Pattern]:
    """Return ``count`` patterns whose pieces are in another order and turned, the same ones for the same pattern."""
    rng = np.random.default_rng(SEED)
    n_pieces = _n_pieces(pattern)
    return [
        _rearranged(pattern, _without_neighbours(rng, n_pieces), _turns(rng, pattern, n_pieces)) for _ in range(count)
    ]


def _n_pieces(pattern: Pattern) -> int:
    return max(2, round(pattern.air.shape[0] * ROWS_MM / PIECE_MM))


def _turns(rng: np.random.Generator, pattern: Pattern, n_pieces: int) -> Sequence[int]:
    return [int(turn) for turn in rng.integers(pattern.air.shape[1], size=n_pieces)]


def _without_neighbours(rng: np.random.Generator, n_pieces: int) -> Sequence[int]:
    order = rng.permutation(n_pieces)
    while n_pieces > 3 and (np.diff(order) == 1).any():
        order = rng.permutation(n_pieces)
    return [int(piece) for piece in order]


def _pieces(pattern: Pattern, count: int) -> list[NDArray[np.intp]]:
    """Return the rows of ``count`` pieces that hold as much of the pattern each."""
    held = (pattern.weight * pattern.air**2).sum(dim=1).cpu().numpy().astype(np.float64)
    held += LEAST_HELD * held.mean() + 1e-12
    cuts = np.searchsorted(np.cumsum(held), held.sum() * np.arange(1, count) / count) + 1
    return np.split(np.arange(held.size), cuts)


def _rearranged(pattern: Pattern, order: Sequence[int], turns: Sequence[int]) -> Pattern:
    rows = _pieces(pattern, len(order))
    air, weight = (
        torch.cat([torch.roll(image[rows[piece]], turn, dims=1) for piece, turn in zip(order, turns, strict=True)])
        for image in (pattern.air, pattern.weight)
    )
    return Pattern(air, weight, pattern.sense)
