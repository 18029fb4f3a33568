"""The task "stitching": what its cases are made of, and what its judge thinks of right, wrong and unknown."""

from dataclasses import replace

import numpy as np
import pytest

from endoct.workbench.bench.rivals.stitching import phase_correlation
from endoct.workbench.bench.task import Declined
from endoct.workbench.bench.tasks import stitching
from endoct.workbench.bench.tasks.stitching import StitchingCase, StripPoses

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
def case() -> StitchingCase:
    return stitching.cases(3, 0, RANGES)


def truth_of(case: StitchingCase) -> StripPoses:
    return StripPoses(case.truth.z_mm, case.truth.roll_rad, np.ones(case.truth.z_mm.size, np.bool_))


def test_a_case_depends_on_seed_and_index_alone(case: StitchingCase) -> None:
    again, other = stitching.cases(3, 0, RANGES), stitching.cases(3, 1, RANGES)
    strips = [c.given[0] for c in (case, again, other)]
    np.testing.assert_array_equal(strips[0][5].intensity, strips[1][5].intensity)
    assert not np.array_equal(case.truth.z_mm, other.truth.z_mm)


def test_the_truth_is_judged_right_and_a_wrong_place_wrong(case: StitchingCase) -> None:
    truth = truth_of(case)
    assert stitching.judge(case, truth)["right"] == 1
    shifted = truth.z_mm + np.where(np.arange(truth.z_mm.size) >= 10, 0.1, 0)
    scores = stitching.judge(case, replace(truth, z_mm=shifted))
    assert scores["wrong"] == pytest.approx(1 / (truth.z_mm.size - 1))
    unsure = replace(truth, z_mm=shifted, trusted=np.arange(truth.z_mm.size) != 10)
    scores = stitching.judge(case, unsure)
    assert scores["wrong"] == 0
    assert scores["unknown"] == pytest.approx(1 / (truth.z_mm.size - 1))


def test_who_trusts_nothing_has_declined(case: StitchingCase) -> None:
    truth = truth_of(case)
    with pytest.raises(Declined):
        stitching.judge(case, replace(truth, trusted=np.zeros(truth.z_mm.size, np.bool_)))


def test_ours_is_right_where_a_fixed_pattern_fools_phase_correlation(case: StitchingCase) -> None:
    ours = stitching.judge(case, stitching.ours(*case.given))
    assert ours["right"] == 1
    assert ours["feed_error_mm"] < 0.005
    assert stitching.judge(case, phase_correlation(*case.given))["wrong"] > 0.5
