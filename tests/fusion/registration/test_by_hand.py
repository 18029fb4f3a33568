"""Alignments corrected by landmark pairs: planted errors come back, around the circle too, and nonsense is refused."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from endoct.base.errors import EndoctError
from endoct.fusion.comparison import CompareParameters, compare_panoramas
from endoct.fusion.geometry.alignment import (
    ALL_ORIENTATIONS,
    Alignment,
    Bend,
    LandmarkPair,
    Place,
    SearchOutcome,
    as_covariance,
    residuals_mm,
)
from endoct.fusion.registration.by_hand import KnownBore, Scale, covariance_about, fit_pairs, judge, mean_turn_rad

RADIUS_MM = 1.25
BORE = KnownBore(RADIUS_MM, ALL_ORIENTATIONS[:1], (0.95, 1.05))
ANY_BORE = replace(BORE, orientations=ALL_ORIENTATIONS)
START = Alignment(0.0, 0.0, confidence=0.5)
ALIGNED = SearchOutcome(START)
PLACES = ((0.3, 1.0), (2.5, 7.0), (5.9, 13.0), (4.0, 19.0))


def placed(truth: Alignment, *places: tuple[float, float], off_mm: float = 0.0, **more: Any) -> list[LandmarkPair]:
    """Return pairs on B's ``places`` and where ``truth`` puts these on A, there ``off_mm`` farther along."""
    return [
        LandmarkPair(Place(float(truth.theta_to_a(t)), float(truth.z_to_a(z)) + off_mm), Place(t, z), **more)
        for t, z in places
    ]


def test_a_single_pair_turns_and_shifts():
    pair = LandmarkPair(Place(0.2, 3.5), Place(6.2, 3.0))  # over θ = 0
    judged = judge([pair], ALIGNED, BORE)
    found = judged.outcome.alignment
    assert isinstance(found, Alignment)
    assert found.theta_shift_rad == pytest.approx(0.2 - 6.2 + 2 * np.pi)
    assert (found.z_shift_mm, found.z_scale) == (pytest.approx(0.5), 1.0)
    assert judged.said.moved is not None
    assert judged.said.moved.around_mm == pytest.approx(RADIUS_MM * (0.2 - 6.2 + 2 * np.pi))
    assert judged.said.moved.along_mm == pytest.approx(0.5)
    assert (judged.said.scale_share, judged.said.misfit) == (0.0, None)
    # what an automatic alignment has to say of itself is not said of this one
    assert (found.confidence, found.chance) == (0.0, 1.0)
    assert judged.said.automatic is not None
    assert judged.said.automatic.confidence == 0.5


def test_the_error_of_a_single_pair_is_that_of_the_place():
    judged = judge([LandmarkPair(Place(1.0, 5.0), Place(1.0, 5.0), sigma_mm=0.1)], ALIGNED, BORE)
    assert isinstance(judged.outcome.alignment, Alignment)
    covariance = np.array(judged.outcome.alignment.covariance)
    assert np.sqrt(covariance[0, 0]) * RADIUS_MM == pytest.approx(0.1)
    assert judged.outcome.alignment.z_error_mm(5.0) == pytest.approx(0.1)
    # away from the pair the scale counts, of which nothing is known but its range
    assert judged.outcome.alignment.z_error_mm(15.0) == pytest.approx(np.hypot(0.1, 10 * 0.1 / np.sqrt(12)), rel=1e-6)


@pytest.mark.parametrize("shift_rad", [0.0, 1.0, 3.1, 6.28])
@pytest.mark.parametrize(("mirrored", "z_reversed"), ALL_ORIENTATIONS)
def test_planted_turn_shift_and_scale_come_back(shift_rad: float, mirrored: bool, z_reversed: bool):
    truth = Alignment(shift_rad, 2.5, 1.02, mirrored, z_reversed)
    start = replace(truth, theta_shift_rad=shift_rad + 0.2, z_shift_mm=2.0, z_scale=1.0)
    exact = placed(truth, *PLACES, sigma_mm=1e-4)
    judged = judge(exact, SearchOutcome(start), ANY_BORE)
    found = judged.outcome.alignment
    assert isinstance(found, Alignment)
    assert np.angle(np.exp(1j * (found.theta_shift_rad - shift_rad))) == pytest.approx(0, abs=1e-9)
    assert found.z_scale == pytest.approx(1.02, abs=1e-6)
    assert found.z_to_a(10.0) == pytest.approx(truth.z_to_a(10.0), abs=1e-5)
    assert judged.said.scale_share > 0.999
    assert judged.said.moved is not None
    assert judged.said.moved.turn_rad == pytest.approx(-0.2)


def test_the_scale_is_weighed_against_what_was_known():
    """Two pairs ±d from their middle say 1.02 with a variance of σ²/(2d²); before them 1.00 was known with another."""
    pairs = placed(Alignment(0.0, 0.0, 1.02), (1.0, 5.0), (1.0, 9.0), sigma_mm=0.05)
    of_pairs, known = 0.05**2 / (2 * 2.0**2), 0.01**2
    share = known / (known + of_pairs)
    fit = fit_pairs(pairs, (False, False), RADIUS_MM, Scale(1.0, known))
    assert fit.scale_share == pytest.approx(share)
    assert fit.alignment.z_scale == pytest.approx(1 + 0.02 * share)
    assert np.array(fit.alignment.covariance)[2, 2] == pytest.approx(1 / (1 / of_pairs + 1 / known))
    assert fit_pairs(pairs, (False, False), RADIUS_MM, Scale(1.0, 0.0)).alignment.z_scale == 1.0


def test_pairs_that_an_alignment_allows_for_leave_its_scale_to_it():
    sure = SearchOutcome(replace(START, covariance=as_covariance(np.diag([1e-6, 1e-5, 1e-8]))))
    near = judge(placed(Alignment(0.01, 0.02, 1.001), (1.0, 5.0), (2.0, 9.0)), sure, BORE)
    assert near.said.scale_share < 0.001
    far = judge(placed(Alignment(0.3, 0.5, 1.02), (1.0, 5.0), (2.0, 9.0)), sure, BORE)
    assert far.said.scale_share > 0.7  # the automatic one was wrong, and so is what it said of its error


def test_the_more_exact_pair_counts_more():
    truth = Alignment(0.0, 1.0)
    pairs = [
        *placed(truth, (1.0, 5.0), sigma_mm=0.02),
        *placed(truth, (1.0, 5.0), off_mm=0.4, sigma_mm=0.04),
    ]
    found = judge(pairs, ALIGNED, BORE).outcome.alignment
    assert isinstance(found, Alignment)
    assert found.z_shift_mm == pytest.approx(1.0 + 0.4 / 5)  # weights 4 : 1


def test_check_pairs_check_and_change_nothing():
    truth = Alignment(0.1, 0.2)
    correct = placed(truth, *PLACES[:2])
    check = placed(truth, *PLACES[2:], off_mm=0.3, role="check")
    with_check, without = judge([*correct, *check], ALIGNED, BORE), judge(correct, ALIGNED, BORE)
    assert with_check.outcome == without.outcome
    assert without.said.check is None
    said = with_check.said.check
    assert said is not None
    assert (said.pairs, said.median_mm, said.max_mm) == (2, pytest.approx(0.3), pytest.approx(0.3))
    assert (said.along_max_mm, said.around_max_mm) == (pytest.approx(0.3), pytest.approx(0.0, abs=1e-9))
    assert [pair.after and pair.after.along_mm for pair in with_check.said.pairs[2:]] == pytest.approx([-0.3, -0.3])
    alone = judge(check, ALIGNED, BORE)
    assert alone.outcome == ALIGNED
    assert not alone.said.corrected


def test_scattered_pairs_widen_the_error():
    truth = Alignment(0.0, 0.0)
    pairs = [*placed(truth, PLACES[0], PLACES[2], off_mm=0.4), *placed(truth, PLACES[1], PLACES[3], off_mm=-0.4)]
    judged = judge(pairs, ALIGNED, BORE)
    assert judged.said.misfit is not None
    assert judged.said.misfit > 3
    assert isinstance(judged.outcome.alignment, Alignment)
    assert judged.outcome.alignment.z_error_mm(10.0) > 2 * 0.05 / np.sqrt(4)


NOTHING = SearchOutcome(None, START, "Nothing stands out.")


def test_pairs_establish_what_was_not_found():
    truth = Alignment(2.0, 3.0, 1.01)
    assert judge(placed(truth, PLACES[0]), NOTHING, BORE).outcome.alignment is None
    judged = judge(placed(truth, *PLACES[:2], sigma_mm=0.01), NOTHING, BORE)
    assert isinstance(judged.outcome.alignment, Alignment)
    assert judged.outcome.alignment.z_to_a(4.0) == pytest.approx(truth.z_to_a(4.0), abs=0.02)
    assert judged.said.automatic_reason == "Nothing stands out."


@pytest.mark.parametrize("orientation", ALL_ORIENTATIONS)
def test_three_pairs_say_which_way_around(orientation: tuple[bool, bool]):
    truth = Alignment(2.0, 25.0, 1.0, *orientation)
    two = judge(placed(truth, *PLACES[:2]), NOTHING, ANY_BORE).outcome
    assert two.alignment is None
    assert "it needs 3" in two.reason
    three = judge(placed(truth, *PLACES[:3]), NOTHING, ANY_BORE)
    assert isinstance(three.outcome.alignment, Alignment)
    assert (three.outcome.alignment.mirrored, three.outcome.alignment.z_reversed) == orientation
    assert three.said.orientation_by_pairs


def test_pairs_in_one_place_do_not_say_which_way_around():
    truth = Alignment(2.0, 3.0)
    found = judge(placed(truth, (1.0, 5.0), (1.0, 5.0), (1.0, 5.0)), NOTHING, ANY_BORE).outcome
    assert found.alignment is None
    assert "farther apart" in found.reason


def test_pairs_that_contradict_handedness_turn_what_is_open_and_are_refused_else():
    truth = Alignment(2.0, 0.0, 1.0, mirrored=True)
    turned = judge(placed(truth, *PLACES), SearchOutcome(replace(START, theta_shift_rad=2.0)), ANY_BORE)
    assert isinstance(turned.outcome.alignment, Alignment)
    assert turned.outcome.alignment.mirrored
    assert turned.said.orientation_by_pairs
    with pytest.raises(EndoctError, match="mirrored in θ, and the recordings that it is not"):
        judge(placed(truth, *PLACES), SearchOutcome(replace(START, theta_shift_rad=2.0)), BORE)


def test_pairs_in_the_wrong_order_are_refused():
    one, two = placed(START, *PLACES[:2])
    with pytest.raises(EndoctError, match="cannot all be right"):
        judge([replace(one, a=two.a), replace(two, a=one.a)], ALIGNED, BORE)


@given(
    turns=st.lists(st.floats(0, 2 * np.pi, exclude_max=True), min_size=1, max_size=8),
    weights=st.lists(st.floats(0.1, 10), min_size=8, max_size=8),
)
def test_the_mean_turn_has_the_least_sum_of_squares(turns: list[float], weights: list[float]):
    angles, weight = np.array(turns), np.array(weights[: len(turns)])

    def cost(turn_rad: float) -> float:
        return float(weight @ (np.mod(angles - turn_rad + np.pi, 2 * np.pi) - np.pi) ** 2)

    best = cost(mean_turn_rad(angles, weight))
    assert best <= min(cost(turn) for turn in np.linspace(0, 2 * np.pi, 721)) + 1e-9


def test_residuals_go_the_shorter_way_around():
    pair = LandmarkPair(Place(0.05, 1.0), Place(6.25, 1.0))
    around_mm = residuals_mm([pair], START, RADIUS_MM)[0, 0]
    assert around_mm == pytest.approx(RADIUS_MM * (6.25 - 0.05 - 2 * np.pi))


def test_a_comparison_is_scored_where_the_pairs_put_it(pair_of: Callable[..., Any]):
    made = pair_of(2, theta_shift_rad=1.0)
    automatic = compare_panoramas(made.a, made.b, CompareParameters(n_theta=512))
    assert automatic.alignment is not None
    assert automatic.result.by_hand is None
    off = replace(made.truth, theta_shift_rad=made.truth.theta_shift_rad + 0.25)
    wrong = placed(off, (1.0, 1.0), (3.0, 3.0), (5.0, 4.5))
    check = placed(made.truth, (2.0, 2.0), role="check")
    moved = compare_panoramas(made.a, made.b, CompareParameters(n_theta=512), pairs=[*wrong, *check])
    assert moved.alignment is not None
    assert moved.alignment.theta_shift_rad == pytest.approx(off.theta_shift_rad, abs=0.03)
    assert moved.result.jaccard < 0.7 * automatic.result.jaccard
    assert moved.alignment.correlation < 0.7 * automatic.alignment.correlation
    assert moved.result.doubts[0].code == "corrected-by-hand"
    by_hand = moved.result.by_hand
    assert by_hand is not None
    assert by_hand.automatic is not None
    assert by_hand.automatic.theta_shift_rad == automatic.alignment.theta_shift_rad
    assert by_hand.check is not None
    assert by_hand.check.max_mm == pytest.approx(0.25 * RADIUS_MM, abs=0.05)


def test_pairs_that_leave_nothing_in_common_are_refused(pair: Any):
    with pytest.raises(EndoctError, match="share no wall"):
        compare_panoramas(pair.a, pair.b, pairs=[LandmarkPair(Place(0.0, 500.0), Place(0.0, 1.0))])


@pytest.mark.parametrize("middle_mm", [-4.0, 0.0, 3.0])
def test_errors_about_a_place_are_those_of_draws(middle_mm: float) -> None:
    """Of 50 000 alignments that err in turn, in where a place lies, and in scale, each by itself."""
    variances = 4e-4, 9e-4, 1e-4
    turn, place, scale = np.sqrt(variances)[:, None] * np.random.default_rng(0).normal(size=(3, 50_000))
    scattered = np.cov([turn, place - middle_mm * scale, scale])
    stated = covariance_about(middle_mm, *variances)
    of_one = np.sqrt(np.diag(stated))
    np.testing.assert_allclose(scattered / np.outer(of_one, of_one), stated / np.outer(of_one, of_one), atol=0.03)


def test_pairs_correct_the_rigid_part_of_a_bent_alignment_and_leave_its_bend():
    bend = Bend((0.0, 9.0, 9.02, 20.0), (0.0, 0.0, 0.6, 0.6), (0.0, 0.0, 0.1, 0.1), (0.0,) * 4, (0.0,) * 4)
    covariance = as_covariance(np.diag([1e-2, 1e-2, 1e-6]))
    truth = Alignment(0.3, 0.05, mirrored=True, bend=bend)
    start = replace(truth, theta_shift_rad=0.28, z_shift_mm=0.0, covariance=covariance)
    pairs = [LandmarkPair(Place(float(truth.theta_to_a(t, z)), float(truth.z_to_a(z))), Place(t, z)) for t, z in PLACES]
    judged = judge(pairs, SearchOutcome(start), BORE)
    found = judged.outcome.alignment
    assert found is not None
    assert found.bend == bend
    assert (found.theta_shift_rad, found.z_shift_mm) == pytest.approx((0.3, 0.05), abs=1e-3)
    assert judged.said.correct is not None
    assert judged.said.correct.max_mm < 0.003
    far = replace(start, z_shift_mm=3.0)  # pairs that contradict an alignment do not believe its bend either
    found = judge(pairs, SearchOutcome(far), BORE).outcome.alignment
    assert found is not None
    assert found.bend is None
