"""The task "stitching": what its cases are made of, and what its judge thinks of right, wrong and unknown."""

from dataclasses import replace

import numpy as np
import pytest

from endoct.workbench.bench import made_strips, stitching
from endoct.workbench.bench.stitching import StripPoses
from endoct.workbench.bench.stitching_rivals import opencv_ecc_prepared, phase_correlation
from endoct.workbench.bench.task import Case, Declined

RANGES = {
    "recipe": ("made",),
    "jitter": (0.1, 0.1),
    "roll_deg": (2.0, 2.0),
    "dropped": (0.1, 0.1),
    "pattern": (0.2, 0.2),
    "texture": (0.2, 0.2),
    "pits": (0.05, 0.05),
}


@pytest.fixture(scope="module")
def case() -> Case:
    return stitching.cases(3, 0, RANGES)


def truth_of(case: Case) -> StripPoses:
    return StripPoses(case.truth.z_mm, case.truth.roll_rad, np.ones(case.truth.z_mm.size, np.bool_))


def test_a_case_depends_on_seed_and_index_alone(case: Case) -> None:
    again, other = stitching.cases(3, 0, RANGES), stitching.cases(3, 1, RANGES)
    strips = [c.given[0] for c in (case, again, other)]
    np.testing.assert_array_equal(strips[0][5].intensity, strips[1][5].intensity)
    assert not np.array_equal(case.truth.z_mm, other.truth.z_mm)


def test_strips_show_the_wall_where_they_are(case: Case) -> None:
    """A strip that moved by whole rows and columns shows the same, but for the probe and the pits."""
    still = dict.fromkeys(made_strips.RANGES, 0.0) | {"texture": 0.3}
    strips, z_mm, _ = made_strips.made_strips(1, 0, still)
    rows = made_strips.PITCH_MM / (made_strips.VISIBLE_MM / made_strips.N_ROWS)
    np.testing.assert_allclose(np.diff(z_mm), made_strips.PITCH_MM)
    below, above = np.log(strips[0].intensity[round(rows) :]), np.log(strips[1].intensity[: -round(rows)])
    flat = [one - np.median(one, axis=1, keepdims=True) for one in (below, above)]
    at_place = np.corrcoef(flat[0].ravel(), flat[1].ravel())[0, 1]
    elsewhere = np.corrcoef(np.roll(flat[0], 40, axis=1).ravel(), flat[1].ravel())[0, 1]
    assert at_place > elsewhere + 0.3


def test_the_truth_is_judged_right_and_a_wrong_place_wrong(case: Case) -> None:
    truth = truth_of(case)
    assert stitching.judge(case, truth)["right"] == 1
    shifted = truth.z_mm + np.where(np.arange(truth.z_mm.size) >= 10, 0.1, 0)
    scores = stitching.judge(case, replace(truth, z_mm=shifted))
    assert scores["wrong"] == pytest.approx(1 / (truth.z_mm.size - 1))
    unsure = replace(truth, z_mm=shifted, trusted=np.arange(truth.z_mm.size) != 10)
    scores = stitching.judge(case, unsure)
    assert scores["wrong"] == 0
    assert scores["unknown"] == pytest.approx(1 / (truth.z_mm.size - 1))


def test_who_trusts_nothing_has_declined(case: Case) -> None:
    truth = truth_of(case)
    with pytest.raises(Declined):
        stitching.judge(case, replace(truth, trusted=np.zeros(truth.z_mm.size, np.bool_)))


def test_ours_is_right_where_a_fixed_pattern_fools_phase_correlation(case: Case) -> None:
    ours = stitching.judge(case, stitching.ours(*case.given))
    assert ours["right"] == 1
    assert ours["feed_error_mm"] < 0.005
    assert stitching.judge(case, phase_correlation(*case.given))["wrong"] > 0.5


def test_a_rivals_rows_and_columns_become_feed_and_roll_of_the_right_sign() -> None:
    easy = RANGES | {"dropped": (0.0, 0.0), "pattern": (0.0, 0.0), "pits": (0.0, 0.0), "roll_deg": (1.0, 1.0)}
    case = stitching.cases(4, 0, easy)
    for method in (opencv_ecc_prepared, phase_correlation):
        assert stitching.judge(case, method(*case.given))["right"] > 0.6
