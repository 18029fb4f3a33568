"""The task "alignment" of the bench: what it draws is what it says, and ours finds it to a fraction of a pixel."""

import numpy as np
import pytest
from bench_tasks import EASY
from tolerances import LANDMARK_PX

from endoct.fusion.geometry.alignment import Alignment, NotAligned
from endoct.workbench.bench.task import Declined
from endoct.workbench.bench.tasks.alignment import N_THETA, N_Z, PX_MM, RANGES, TASK, AlignmentCase, ours


def test_cases_are_what_they_say(easy: AlignmentCase) -> None:
    again = TASK.cases(0, 0, EASY)
    assert all(np.array_equal(x.intensity, y.intensity) for x, y in zip(easy.given, again.given, strict=True))
    a, b = easy.given
    assert a.grid.shape == b.grid.shape == (N_Z, N_THETA)
    cells = a.intensity / np.median(a.intensity, axis=0) < 0.5
    assert cells.mean() == pytest.approx(0.2, abs=0.06)
    # a column of B lies where the truth says
    turn = round(easy.truth.theta_shift_rad / (2 * np.pi) * N_THETA)
    shift = round(easy.truth.z_shift_mm / PX_MM)
    there = np.roll(b.intensity, turn, axis=1)[max(0, -shift) : N_Z - max(0, shift)]
    here = a.intensity[max(0, shift) : N_Z - max(0, -shift)]
    assert np.corrcoef(np.log(there).ravel(), np.log(here).ravel())[0, 1] > 0.8


def test_the_judge_knows_the_truth_and_an_error(easy: AlignmentCase) -> None:
    assert TASK.judge(easy, easy.truth)["landmark_px"] == pytest.approx(0, abs=1e-9)
    off = Alignment(easy.truth.theta_shift_rad + 2 * np.pi * 3 / N_THETA, easy.truth.z_shift_mm + 4 * PX_MM)
    scores = TASK.judge(easy, off)
    assert scores["landmark_px"] == pytest.approx(5, rel=1e-3)
    assert scores["success"] == 0
    with pytest.raises(Declined, match="It found nothing"):
        TASK.judge(easy, NotAligned("It found nothing."))


def test_ours_finds_a_turned_inverted_noisy_panorama() -> None:
    hard = {**RANGES, "orientation": ("turned",), "polarity": ("bright",), "noise": ("high",), "overlap": (0.5, 0.6)}
    case = TASK.cases(3, 0, hard)
    answer = ours(*case.given)
    assert isinstance(answer, Alignment)
    assert (answer.mirrored, answer.z_reversed) == (True, True)
    assert TASK.judge(case, answer)["landmark_px"] < LANDMARK_PX
