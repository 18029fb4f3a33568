"""Turns in a stream of A-scans of which it is known where the beam pointed."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from tolerances import A_SCAN

from endoct.base.errors import EndoctError
from endoct.modalities.oct.spectra.turns import Levels, find_turns, usual_turn

AROUND, DEPTH = 4096, 128
USUAL = 1000.0
NOISE_DB = 3.0


def texture(rng: np.random.Generator) -> NDArray[np.float64]:
    """What the beam sees around a turn, dB (angle, depth): an off-axis face, and speckle as wide as four A-scans."""
    angle, depth = np.arange(AROUND) * 2 * np.pi / AROUND, np.arange(DEPTH)
    face = 15 * np.exp(-(((depth - 40 - 12 * np.sin(angle)[:, None]) / 3) ** 2))
    speckle = gaussian_filter1d(rng.normal(size=(AROUND, DEPTH)), 8, axis=0, mode="wrap") * 25
    return face + speckle * (depth > 60)


def turned(lengths: NDArray[np.float64], part: float, uneven_rad: float = 0.03) -> NDArray[np.float64]:
    """Angles in turns of the A-scans of turns of so many A-scans each, with ``part`` of one more; unevenly turned."""
    starts = np.concatenate([[0.0], np.cumsum(lengths)])
    ascan = np.arange(int(starts[-2] + part * lengths[-1]))
    turns = np.interp(ascan, starts, np.arange(starts.size))
    return turns + uneven_rad / (2 * np.pi) * np.sin(2 * np.pi * turns)


def stream(angle: NDArray[np.float64], rng: np.random.Generator, noise_db: float = NOISE_DB) -> Levels:
    seen = texture(rng)[np.floor(np.mod(angle, 1) * AROUND).astype(np.intp)]
    levels = (50 + seen + noise_db * rng.normal(size=seen.shape)).astype(np.float32)
    return lambda indices: levels[indices]


@pytest.mark.parametrize("seed", [0, 1])
def test_turns_that_differ_by_three_percent_are_found(seed: int) -> None:
    rng = np.random.default_rng(seed)
    lengths = USUAL * (1 + 0.03 * np.clip(rng.normal(size=8), -2, 2))
    angle = turned(lengths, part=0.4)
    levels = stream(angle, rng)
    usual = usual_turn(levels, angle.size)
    assert usual == pytest.approx(USUAL, rel=0.05)
    turns = find_turns(levels, angle.size, usual)
    assert turns.starts[0] == 0
    np.testing.assert_allclose(turns.lengths, lengths[:-1], atol=A_SCAN)
    assert (turns.alike > 0.5).all()
    assert find_turns(levels, angle.size, usual, most=3).lengths.size == 3


def test_a_stop_of_little_more_than_a_turn_gives_one() -> None:
    rng = np.random.default_rng(2)
    lengths = np.array([1030.0, 1030.0])
    angle = turned(lengths, part=0.2)
    levels = stream(angle, rng)
    turns = find_turns(levels, angle.size, usual_turn(levels, angle.size))
    np.testing.assert_allclose(turns.lengths, lengths[:1], atol=A_SCAN)


def test_a_turn_that_lacks_a_block_of_a_scans_is_shorter_by_it() -> None:
    rng = np.random.default_rng(3)
    angle = turned(np.full(6, USUAL), part=0.9)
    lost = slice(2400, 2410)
    turns = find_turns(stream(np.delete(angle, lost), rng), angle.size - 10, USUAL)
    np.testing.assert_allclose(turns.lengths, [1000, 1000, 990, 1000, 1000], atol=A_SCAN)


def test_nothing_is_found_where_nothing_repeats() -> None:
    rng = np.random.default_rng(4)
    noise = rng.normal(size=(5000, DEPTH)).astype(np.float32)
    with pytest.raises(EndoctError, match=r"no turns can be seen.*'ascans'"):
        usual_turn(lambda indices: noise[indices], len(noise))
    within_a_turn = stream(turned(np.full(2, 4000.0), part=0.0)[:3000], rng)
    with pytest.raises(EndoctError, match="no turns can be seen"):
        usual_turn(within_a_turn, 3000)
