"""What a side alone must show to tell a pose, by numbers put in by hand; the slow cases lie in test_core.py."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from endoct.fusion.pose import finding
from endoct.fusion.pose.air import AirAround
from endoct.fusion.pose.finding import (
    APART_MM,
    APART_RAD,
    CLOSE_AGREEMENT,
    LEAST_BY_CELLS,
    LEAST_BY_DEPTH,
    LEAST_STANDING,
    MOST_APART,
    STARTS,
    SidePose,
    differ,
    summary,
)
from endoct.fusion.pose.fit import PoseFit
from endoct.fusion.pose.observation import Layer, Observation
from endoct.fusion.pose.search import OF_EACH_KIND, Candidate
from endoct.fusion.pose.wall import OF_SIDE, SHARED, Sense

LENGTH_MM = 16.0
AIR = AirAround(torch.zeros(1, 4, 3, 3, 3), (0.0, 0.0, 0.0), LENGTH_MM)
N = SHARED + OF_SIDE


def side(name: str = "camera", layers: int = 1) -> Observation:
    image = np.random.default_rng(4).random((101, 64)).astype(np.float32)
    layer = Layer(0.0, image, np.ones_like(image))
    return Observation(name, 0.2 * np.arange(101), 1.25, (layer,) * layers, 0.02, 0.7, 0.03, 0.02, True, True)


def pose(
    *, agreement: float = 0.7, second: float | None = None, standing: float = 4.0, mirrored: bool = False,
    axis: tuple[float, ...] = (0, 0, 0, 0), sigma: float = 0.1, name: str = "camera", layers: int = 1,
) -> SidePose:  # fmt: skip
    """A side's pose; its axis errs by ``sigma`` in each of its four numbers."""
    parameters = np.concatenate([axis, np.zeros(OF_SIDE)])
    fit = PoseFit((side(name, layers),), (Sense(),), parameters, sigma**2 * np.eye(N), (agreement,))
    return SidePose(fit, second, standing, mirrored)


@pytest.mark.parametrize(
    ("second", "told"),
    [(None, True), (0.7 - CLOSE_AGREEMENT - 0.01, True), (0.7 - CLOSE_AGREEMENT + 0.01, False), (0.75, False)],
)
def test_a_pattern_that_fits_as_well_at_another_place_tells_nothing(second: float | None, told: bool) -> None:
    expected = None if told else "the camera's pattern fits as well at another place"
    assert pose(second=second).reason == expected


@pytest.mark.parametrize(("layers", "least"), [(1, LEAST_BY_CELLS), (2, LEAST_BY_DEPTH)])
def test_edges_agree_at_least_so_much(layers: int, least: float) -> None:
    assert pose(agreement=least + 0.001, layers=layers).reason is None
    said = pose(agreement=least - 0.01, layers=layers).reason or ""
    assert f"edges correlate {least - 0.01:.2f} with the CT's at best, {least:g} at least" in said
    assert "mirror" not in said
    assert "mirror image of the CT fits better" in (pose(agreement=0.1, mirrored=True).reason or "")


def test_a_pattern_stands_out_or_tells_nothing() -> None:
    assert pose(standing=LEAST_STANDING).reason is None
    assert f"{LEAST_STANDING - 0.1:.1f} of their spreads" in (pose(standing=LEAST_STANDING - 0.1).reason or "")


def test_the_gravest_reason_is_told() -> None:
    everything = pose(agreement=0.1, second=0.5, standing=0.0, axis=(3, 0, 0, 0))
    better = replace(everything, fit=replace(everything.fit, agreement=(0.6,)))
    assert "edges correlate" in (everything.reason or "")
    assert "hardly better than rearranged" in (better.reason or "")
    assert "off the plan" in (replace(better, standing=5.0).reason or "")
    assert "mirror image" in (replace(better, mirrored=True).reason or "")


FAR = [(2.6, 0, 0, 0), (0, 2.6, 0, 0), (-1.85, 1.85, 0, 0), (0, 0, 0.09, 0), (0, 0, 0, -0.09)]


@pytest.mark.parametrize("axis", FAR)
def test_how_far_off_the_plan_counts_both_ways(axis: tuple[float, ...]) -> None:
    assert "off the plan" in (pose(axis=axis).reason or "")
    assert pose(axis=tuple(0.7 * value for value in axis)).reason is None


def test_it_stands_above_the_better_of_both_kinds_of_control() -> None:
    turned, shuffled = [1.0, 2.0, 3.0], [0.0, 2.0, 4.0]  # of one mean, 2; they spread by 1 and by 2
    assert finding._standing(8.0, [*turned, *shuffled]) == pytest.approx(3)
    assert finding._standing(8.0, [*shuffled, *turned]) == pytest.approx(3)
    high = [value + 4 for value in turned]
    assert finding._standing(8.0, [*high, *turned]) == finding._standing(8.0, [*turned, *high]) == pytest.approx(2)
    for other in (turned, [1.0, 1.0, 1.0]):  # a kind that is all alike says nothing
        assert finding._standing(8.0, [1.0, 1.0, 1.0, *other]) == finding._standing(8.0, [*other, 1.0, 1.0, 1.0]) == 0


def test_controls_are_equally_many_of_either_kind() -> None:
    """The first are turned piece by piece: every row keeps its mean. The others are in another order too."""
    true, controls = finding._patterns(replace(side(), directed=False), "cpu")
    assert [one.sense for one in true] == [Sense(), Sense(1, -1)]
    assert len(controls) == 2 * OF_EACH_KIND
    kept = [torch.allclose(one.air.mean(dim=1), true[0].air.mean(dim=1), atol=1e-5) for one in controls]
    assert kept == [True] * OF_EACH_KIND + [False] * OF_EACH_KIND


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("share", "apart"), [(0.95, False), (1.05, True)])
def test_two_places_rather_than_one(share: float, apart: bool, sign: int) -> None:
    """Ends move by what the axis moves aside and by what half its length tilts."""
    here = (0.1, -0.2, 0.01, 0.0), 5.0, 3.1
    step = sign * share
    there = [
        ((0.1 + step * APART_MM, -0.2, 0.01, 0.0), 5.0, 3.1),
        ((0.1, -0.2, 0.01, step * APART_MM / (LENGTH_MM / 2)), 5.0, 3.1),
        ((0.1 + step * APART_MM / 2, -0.2, 0.01 - step * APART_MM / LENGTH_MM, 0.0), 5.0, 3.1),
        (here[0], 5.0 + step * APART_MM, 3.1),
        (here[0], 5.0, 3.1 + step * APART_RAD),
        (here[0], 5.0, 3.1 + step * APART_RAD - 2 * np.pi),
    ]
    for other in there:
        assert differ(here, other, LENGTH_MM) is apart
        assert differ(other, here, LENGTH_MM) is apart


def test_a_fit_begins_at_the_best_places_that_lie_apart() -> None:
    turns = [0.0, 0.1, 1.0, 1.1, 2.0, 3.0, 4.0]
    candidates = [Candidate(1.0 - k / 10, (0.0, 0.0, 0.0, 0.0), 8.0, turn, Sense()) for k, turn in enumerate(turns)]
    chosen = finding._apart(candidates, LENGTH_MM)
    assert [one.turn_rad for one in chosen] == [0.0, 1.0, 2.0][:STARTS]
    assert len(finding._apart(candidates[:2], LENGTH_MM)) == 1


def test_a_pose_in_short_is_that_of_the_first_side() -> None:
    fit = pose(axis=(0.1, 0.2, 0.03, 0.04)).fit
    fit.parameters[SHARED : SHARED + 2] = 7.0, 1.5
    assert summary(fit) == ((0.1, 0.2, 0.03, 0.04), 7.0, 1.5)


@pytest.mark.parametrize(("share", "told"), [(0.99, True), (1.01, False)])
def test_sides_contradict_each_other_beyond_both_their_errors(share: float, told: bool) -> None:
    """Variances add: 0.03² + 0.04² = 0.05², so that χ² is (distance / 0.05)²."""
    aside_mm = 0.05 * np.sqrt(share * MOST_APART)
    one, other = pose(sigma=0.03), pose(sigma=0.04, axis=(aside_mm, 0, 0, 0), name="oct")
    reason = finding._contradiction(AIR, [one, other])
    assert (reason is None) == told
    assert told or reason == f"camera and oct find axes that lie {aside_mm:.2f} mm apart, more than either could be off"
    assert finding._contradiction(AIR, [other]) is None
    for low in (0, 1):  # one that does not stand out contradicts nobody
        sides = [one, replace(other, fit=replace(other.fit, parameters=9 + other.fit.parameters))]
        assert finding._contradiction(AIR, sides) is not None
        sides[low] = replace(sides[low], standing=LEAST_STANDING - 0.1)
        assert finding._contradiction(AIR, sides) is None
