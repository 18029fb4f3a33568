"""Where one strip lies on another."""

import numpy as np
import pytest

from endoct.base.compute.memory import Kept
from endoct.stitching.motion.matching import Matcher
from endoct.stitching.motion.warp import Texture


def test_places_are_the_same_whether_spectra_are_held_or_not(monkeypatch: pytest.MonkeyPatch) -> None:
    """Which of two arrays an operator writes into depends on who else holds them, and rounds otherwise."""
    wall = np.random.default_rng(0).normal(size=(96, 1024)).astype(np.float32)  # large enough for that
    with Kept[Texture]() as strips:
        for first in (0, 9, 20):
            strips.append((wall[first : first + 64], np.ones((64, 1024), np.bool_)))
        held = Matcher(strips, 0.02, 1.0).search({1: [None], 2: [None]})
        monkeypatch.setattr("endoct.stitching.motion.matching.LATEST", 0)
        assert Matcher(strips, 0.02, 1.0).search({1: [None], 2: [None]}) == held
    (of_one,), (of_two,) = held
    assert [round(place.rows) for place in (*of_one, *of_two)] == [9, 11, 20]


def test_each_window_is_searched_by_itself_and_nothing_lies_beyond_the_strips() -> None:
    """Two strips lie 6 rows of 0.02 mm and 20 of 128 columns apart."""
    wall = np.random.default_rng(1).normal(size=(40, 128)).astype(np.float32)
    with Kept[Texture]() as strips:
        strips.append((wall[:32], np.ones((32, 128), np.bool_)))
        strips.append((np.roll(wall[6:38], -20, axis=1), np.ones((32, 128), np.bool_)))
        matcher = Matcher(strips, 0.02, 1.0)
        windows = (0.05, 0.2), (-0.3, -0.1), (9.0, 10.0)
        ((free,), (right,), (wrong,), (beyond,)) = matcher.search({1: [None, *([window] for window in windows)]})[0]
        alone = matcher.search({1: [[windows[-1]]]})[0]
    assert round(free.rows) == round(right.rows) == 6
    assert round(free.columns) % 128 == 20
    assert right.correlation == free.correlation > 0.9
    assert -15 <= wrong.rows <= -5
    assert wrong.correlation < 0.5
    assert not beyond.trusted
    assert np.isnan(beyond.rows)
    assert not alone[0][0].trusted
