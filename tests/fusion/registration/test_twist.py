"""A twist along z: found against the other side, corrected only where asked for, both figures given."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from tolerances import TWIST_RAD

from endoct.fusion.comparison import CompareParameters, compare_panoramas


def twisted(pair: Any) -> tuple[Any, np.ndarray]:
    """B with its rows turned by up to 5° along z, whole samples of its own."""
    b = pair.b
    course = 0.12 * np.sin(np.linspace(0, 2.5, b.grid.n_z))
    turn = np.round((course - course.mean()) / b.grid.dtheta_rad).astype(int)

    def turned(image: np.ndarray) -> np.ndarray:
        return np.stack([np.roll(row, k) for row, k in zip(image, turn, strict=True)])

    b = replace(
        b, intensity=turned(b.intensity), depth_mm=turned(b.depth_mm), valid=turned(b.valid), weight=turned(b.weight)
    )
    return b, turn * b.grid.dtheta_rad


def test_a_twist_is_found_where_asked_for_and_said(pair_of: Callable[..., Any]) -> None:
    assert not CompareParameters().correct_twist
    pair = pair_of(3, known=True, rows=20)
    b, turn_rad = twisted(pair)
    compared = compare_panoramas(pair.a, b, CompareParameters(dz_mm=0.1, n_theta=256, correct_twist=True))
    stated = compared.result.twist
    known = np.array(stated.known)
    assert known.mean() > 0.5
    left = turn_rad - np.array(stated.twist_rad)
    left = left[known] - left[known].mean()
    assert np.sqrt(np.mean(left**2)) < TWIST_RAD
    assert np.std(turn_rad) > 2 * TWIST_RAD
    assert stated.jaccard_with == compared.result.jaccard
    assert stated.jaccard_with > stated.jaccard_without + 0.03
    assert "raises the score" in stated.note
