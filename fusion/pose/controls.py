"""Patterns that cannot be in the bone: pieces of a side, in another order and turned. They tell what chance gives.

Each control has the cells of the side, their sizes, shapes and share, but not their places. How well the best place of
such a pattern fits, over the same axes, turns and depths, is what the true one has to beat.
"""

import numpy as np
import torch

from endoct.fusion.pose.search import ROWS_MM, Pattern

PIECE_MM = 4.0
CONTROLS = 24
SEED = 17


def control_patterns(pattern: Pattern, count: int = CONTROLS) -> list[Pattern]:
    """Return ``count`` scrambled patterns, the same ones for the same pattern."""
    rng = np.random.default_rng(SEED)
    n_z, n_theta = pattern.air.shape
    n_pieces = max(2, round(n_z * ROWS_MM / PIECE_MM))
    return [_scrambled(pattern, n_pieces, n_theta, rng) for _ in range(count)]


def _scrambled(pattern: Pattern, n_pieces: int, n_theta: int, rng: np.random.Generator) -> Pattern:
    rows = np.array_split(np.arange(pattern.air.shape[0]), n_pieces)
    order = rng.permutation(n_pieces)
    while (np.diff(order) == 1).any() and n_pieces > 3:  # no two pieces stay neighbours
        order = rng.permutation(n_pieces)
    turns = rng.integers(n_theta, size=n_pieces)
    air = [torch.roll(pattern.air[rows[piece]], int(turn), dims=1) for piece, turn in zip(order, turns, strict=True)]
    weight = [
        torch.roll(pattern.weight[rows[piece]], int(turn), dims=1) for piece, turn in zip(order, turns, strict=True)
    ]
    return Pattern(torch.cat(air), torch.cat(weight), pattern.sense)
