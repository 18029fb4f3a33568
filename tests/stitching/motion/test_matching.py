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
