"""Where a panorama truly lies on another."""

import numpy as np
import pytest

from endoct.workbench.pipeline.truth import TrueMap, TruePose

ROWS_MM = np.linspace(0.0, 4.0, 9)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_the_alignment_of_a_true_map_puts_rows_and_columns_where_they_are(way: float) -> None:
    pose_a = TruePose(0.5, 1, ROWS_MM, 10 + ROWS_MM)
    pose_b = TruePose(0.2, -1, ROWS_MM, 12 + 1.02 * way * ROWS_MM)
    true = TrueMap(np.linspace(-3, 7, 21), pose_a, pose_b)
    there = true.alignment(ROWS_MM)
    assert there.mirrored
    assert there.z_reversed == (way < 0)
    assert there.z_scale == pytest.approx(1.02)
    assert np.allclose(there.z_to_a(ROWS_MM), 2 + 1.02 * way * ROWS_MM)
    away = there.theta_to_a(np.array([0.0, 1.0]), 0.0) - true.theta_to_a(np.array([0.0, 1.0]))
    assert np.allclose(np.mod(away + 1, 2 * np.pi), 1)


def test_rows_beyond_the_other_panorama_do_not_bend_it() -> None:
    pose = TruePose(0.0, 1, ROWS_MM, ROWS_MM)
    true = TrueMap(ROWS_MM[:5], pose, TruePose(0.0, 1, ROWS_MM, 1 + ROWS_MM))
    assert np.allclose(true.alignment(ROWS_MM).z_to_a(ROWS_MM), 1 + ROWS_MM)
