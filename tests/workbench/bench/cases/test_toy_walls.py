"""Toy walls with cells."""

import numpy as np
import pytest

from endoct.workbench.bench.cases.toy_walls import toy_panorama

MIDDLE = {"signal_db": 20.0, "cell_mm": 0.8, "unevenness": 0.5}


@pytest.mark.parametrize(("modality", "fill", "missing"), [("depth", 0.1, 0.2), ("intensity", 0.3, 0.0)])
def test_toy_walls_are_as_their_conditions_say(modality: str, fill: float, missing: float) -> None:
    shares = []
    for seed in range(6):
        panorama, cell = toy_panorama(seed, 0, modality, {**MIDDLE, "fill": fill, "missing": missing})
        shares.append(float(cell.mean()))
        assert panorama.valid.mean() == pytest.approx(1 - missing, abs=0.001)
        assert (panorama.depth_mm is None) == (modality == "intensity")
    assert np.mean(shares) == pytest.approx(fill, rel=0.15)
