"""Cells marked by what has learned from walls."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from endoct.workbench.bench.cases.toy_walls import toy_panorama
from endoct.workbench.bench.rivals import learned_segmentation as learned
from endoct.workbench.bench.task import Declined, NotInstalled

EASY = {"signal_db": 25.0, "cell_mm": 1.0, "fill": 0.2, "missing": 0.0, "unevenness": 0.5}


@pytest.fixture
def few_lessons(monkeypatch: pytest.MonkeyPatch) -> None:
    """The forest learns from a few walls, and is forgotten afterwards."""
    pytest.importorskip("sklearn", reason="scikit-learn is not installed", exc_type=ImportError)
    monkeypatch.setattr(learned, "SEEDS", range(4))
    monkeypatch.setattr(learned, "_forest", learned._forest.__wrapped__)


@pytest.mark.usefixtures("few_lessons")
def test_a_forest_learns_what_cells_are_and_always_the_same() -> None:
    panorama, cell = toy_panorama(3, 0, "depth", EASY)
    first, again = (learned.random_forest(panorama) for _ in range(2))
    assert (first & cell).sum() / (first | cell).sum() > 0.8
    np.testing.assert_array_equal(first, again)


@pytest.mark.usefixtures("few_lessons")
def test_a_forest_sees_the_same_wherever_the_circle_is_cut() -> None:
    panorama, _ = toy_panorama(4, 0, "depth", EASY)
    assert panorama.depth_mm is not None
    turned = replace(
        panorama,
        intensity=np.roll(panorama.intensity, 200, axis=1),
        depth_mm=np.roll(panorama.depth_mm, 200, axis=1),
        valid=np.roll(panorama.valid, 200, axis=1),
    )
    there = np.roll(learned.random_forest(panorama), 200, axis=1)
    assert (there == learned.random_forest(turned)).mean() > 0.999


def test_without_scikit_learn_the_forest_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "sklearn.ensemble", None)
    learned._forest.cache_clear()
    with pytest.raises(NotInstalled, match="scikit-learn is not installed"):
        learned.random_forest(toy_panorama(3, 0, "depth", EASY)[0])


def test_the_eye_declines_what_it_was_not_trained_for() -> None:
    with pytest.raises(Declined, match="no eye was trained"):
        learned.learned_eye(toy_panorama(3, 0, "depth", EASY)[0])
