"""Which sense of θ fits; controls of a pattern: its pieces turned, all of them there, no neighbours kept."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from endoct.fusion.pose import search
from endoct.fusion.pose.search import (
    COLUMNS,
    OF_EACH_KIND,
    PIECE_MM,
    ROWS_MM,
    Pattern,
    shuffled_patterns,
    turned_patterns,
)
from endoct.fusion.pose.wall import Sense

N_ROWS = round(5.2 * PIECE_MM / ROWS_MM)
"""Rows of a pattern of five pieces."""
RNG = np.random.default_rng(8)
AIR = RNG.normal(size=(N_ROWS, COLUMNS)).astype(np.float32)
PATTERN = Pattern(torch.tensor(AIR), torch.tensor(RNG.random((N_ROWS, COLUMNS)).astype(np.float32)), Sense(1, -1))


def origin_of(control: Pattern) -> tuple[list[int], list[int]]:
    """Which row of the pattern each row of a control is, and by how many columns it was turned."""
    rows, turns = [], []
    for row in control.air.numpy():
        like = np.fft.ifft(np.fft.fft(row) * np.conj(np.fft.fft(AIR, axis=1)), axis=1).real
        where = np.unravel_index(like.argmax(), like.shape)
        rows.append(int(where[0]))
        turns.append(int(where[1]))
    return rows, turns


def test_turned_pieces_stay_in_their_order() -> None:
    controls = turned_patterns(PATTERN)
    assert len(controls) == OF_EACH_KIND
    for control in controls:
        rows, turns = origin_of(control)
        assert rows == list(range(N_ROWS))
        assert 1 + np.count_nonzero(np.diff(turns)) == 5
        assert control.sense == PATTERN.sense
    assert len({tuple(origin_of(control)[1]) for control in controls}) == OF_EACH_KIND


def test_shuffled_pieces_are_all_there_and_lose_their_neighbours() -> None:
    controls = shuffled_patterns(PATTERN)
    assert len(controls) == OF_EACH_KIND
    for control in controls:
        rows, turns = origin_of(control)
        assert sorted(rows) == list(range(N_ROWS))
        joints = np.flatnonzero(np.diff(rows) != 1)
        assert len(joints) == 4, "five pieces, of which no two that follow each other did so before"
        weight = PATTERN.weight.numpy()
        expected = np.stack([np.roll(weight[row], turn) for row, turn in zip(rows, turns, strict=True)])
        np.testing.assert_array_equal(control.weight.numpy(), expected)


def test_a_short_pattern_has_two_pieces() -> None:
    short = Pattern(PATTERN.air[:6], PATTERN.weight[:6], Sense())
    turns = np.array([origin_of(control)[1] for control in turned_patterns(short)])
    assert (np.count_nonzero(np.diff(turns, axis=1), axis=1) <= 1).all()
    assert (np.count_nonzero(np.diff(turns, axis=1), axis=1) == 1).any()


@dataclass
class Sensed:
    """Of an observation, whether its senses are known."""

    directed: bool
    handed: bool = True


@pytest.mark.parametrize(
    ("right", "wrong", "favoured"),
    [(0.5, 0.75, True), (0.75, 0.5, False), (0.6, 0.55, None), (0.55, 0.6, None)],
)
@pytest.mark.parametrize("directed", [True, False])
def test_the_mirror_image_is_favoured_where_it_fits_clearly_better(
    right: float, wrong: float, favoured: bool | None, directed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where z may run either way, the better of both counts, whichever it is."""

    def score(sense: Sense) -> float:
        best = right if sense.turning == 1 else wrong
        return best - 0.4 * (not directed and sense.inward == sense.turning)

    monkeypatch.setattr(search, "pattern_of", lambda side, sense, device: sense)
    monkeypatch.setattr(
        search,
        "candidates_along",
        lambda air, side, senses, axes: [[SimpleNamespace(score=score(sense))] for sense in senses],
    )
    air: Any = SimpleNamespace(values=torch.zeros(1))
    side: Any = Sensed(directed)
    assert search.favours_mirror(air, side, np.zeros(4)) is favoured
