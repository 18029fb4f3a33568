"""Places move as their derivatives say, a pattern is found where it was put, and controls are no places of the bore."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from endoct.fusion.pose import finding
from endoct.fusion.pose.air import STEP_MM, AirAround
from endoct.fusion.pose.finding import SidePose, answer, find_alone
from endoct.fusion.pose.fit import ALIKE, _together, fit_pose
from endoct.fusion.pose.observation import Layer, Observation
from endoct.fusion.pose.pose import BorePose
from endoct.fusion.pose.search import (
    COLUMNS,
    ROWS_MM,
    Pattern,
    correlations,
    pattern_of,
    shuffled_patterns,
    turned_patterns,
)
from endoct.fusion.pose.wall import FREE, OF_SIDE, SHARED, TURN, Sense, wall_places
from endoct.modalities.ct.trajectory import Trajectory

LENGTH_MM, RADIUS_MM = 16.0, 1.25
PLAN = Trajectory((0.0, 0.0, 0.0), (0.0, 0.0, LENGTH_MM))


def a_bone(seed: int) -> AirAround:
    """Cells of about 1.5 mm, drawn at random along a plan."""
    corner = (-7.0, -7.0, -7.0)
    shape = (round((LENGTH_MM + 14) / STEP_MM) + 1, round(14 / STEP_MM) + 1, round(14 / STEP_MM) + 1)
    frequencies = np.meshgrid(*(np.fft.fftfreq(n, STEP_MM) for n in shape), indexing="ij")
    noise = np.fft.fftn(np.random.default_rng(seed).normal(size=shape))
    field = np.fft.ifftn(noise * np.exp(-2 * (np.pi * 0.45) ** 2 * sum(f**2 for f in frequencies))).real
    share = np.clip(0.5 + 2.5 * (field / field.std() - 0.5), 0, 1).astype(np.float32)
    by_z, by_y, by_x = np.gradient(share, STEP_MM)
    return AirAround(torch.tensor(np.stack([share, by_x, by_y, by_z])[None].astype(np.float32)), corner, LENGTH_MM)


def a_side(air: AirAround | None = None, axis: tuple[float, float] = (0.4, -0.3), turn_rad: float = 2.0) -> Observation:
    """What a camera sees of a bore through ``air``, 12 mm of it from a depth of 2 mm on."""
    z = np.arange(0, 12.01, 0.2)
    blank = Layer(0.0, np.zeros((z.size, 64), np.float32), np.ones((z.size, 64), np.float32))
    side = Observation("camera", z, RADIUS_MM, (blank,), 0.02, 0.7, 0.03, 0.02, handed=True, directed=True)
    if air is None:
        return side
    parameters = torch.zeros(SHARED + OF_SIDE, dtype=torch.float64)
    parameters[:2], parameters[SHARED], parameters[SHARED + TURN] = torch.tensor(axis), 8.0, turn_rad
    places, _ = wall_places(side, Sense(), LENGTH_MM / 2, parameters, 0.0)
    layer = Layer(0.0, air.share(places).numpy(), blank.weight)
    return Observation("camera", z, RADIUS_MM, (layer,), 0.02, 0.7, 0.03, 0.02, handed=True, directed=True)


@pytest.mark.parametrize("sense", [Sense(), Sense(-1, 1), Sense(1, -1), Sense(-1, -1)])
def test_places_move_as_their_derivatives_say(sense: Sense) -> None:
    side, rng = a_side(), np.random.default_rng(3)
    at = torch.tensor(rng.normal(size=SHARED + OF_SIDE) * 0.02)
    _, moved = wall_places(side, sense, LENGTH_MM / 2, at, 0.3)
    for number in range(SHARED + OF_SIDE):
        step = torch.zeros_like(at)
        step[number] = 1e-5
        ahead, behind = (wall_places(side, sense, LENGTH_MM / 2, at + sign * step, 0.3)[0] for sign in (1, -1))
        torch.testing.assert_close((ahead - behind) / 2e-5, moved[..., number], rtol=1e-6, atol=1e-6)


def test_some_samples_lie_where_they_do_on_the_whole_wall() -> None:
    side, at = a_side(), torch.tensor(np.random.default_rng(4).normal(size=SHARED + OF_SIDE) * 0.02)
    rows, columns = np.array([0, 17, 60, 17]), np.array([63, 0, 31, 63])
    whole = wall_places(side, Sense(-1, -1), LENGTH_MM / 2, at, 0.3)
    some = wall_places(side, Sense(-1, -1), LENGTH_MM / 2, at, 0.3, (rows, columns))
    for all_of_them, few in zip(whole, some, strict=True):
        torch.testing.assert_close(few, all_of_them[rows, columns])


def test_a_bare_wall_leaves_all_open() -> None:
    fit = fit_pose(a_bone(1), [a_side()], [Sense()], torch.zeros(SHARED + OF_SIDE, dtype=torch.float64))
    assert not fit.parameters.any()
    assert np.sqrt(np.diag(fit.covariance))[: SHARED + TURN + 1] == pytest.approx(FREE, rel=1e-3)


def test_layers_are_compared_where_they_lie_behind_the_wall() -> None:
    air, blank, true = a_bone(1), a_side(), torch.zeros(SHARED + OF_SIDE, dtype=torch.float64)
    true[:2], true[SHARED], true[SHARED + TURN] = torch.tensor([0.1, -0.2]), 8.0, 0.1
    shown = (air.share(wall_places(blank, Sense(), LENGTH_MM / 2, true, mm)[0]).numpy() for mm in (0.1, 0.8))
    weight = blank.layers[0].weight
    layers = tuple(Layer(mm, share, weight) for mm, share in zip((0.1, 0.8), shown, strict=True))
    start = true.clone()
    start[:2] += 0.1
    fit = fit_pose(air, [replace(blank, layers=layers)], [Sense()], start)
    assert fit.parameters[:2] == pytest.approx([0.1, -0.2], abs=0.01)
    assert fit.agreement[0] > 0.99


def test_a_pattern_is_found_where_it_was_cut_out_across_the_seam() -> None:
    wall = torch.tensor(np.random.default_rng(1).normal(size=(60, COLUMNS)).astype(np.float32))
    cut = torch.roll(wall, -40, dims=1)[17:47]
    pattern = Pattern(cut - cut.mean(), torch.ones_like(cut), Sense())
    (like,) = correlations(wall[None], [pattern])
    assert like.shape == (1, 31, COLUMNS)
    assert divmod(int(like[0].argmax()), COLUMNS) == (17, 40)
    assert float(like.max()) == pytest.approx(1, abs=1e-4)


def test_the_pattern_of_a_side_is_that_side() -> None:
    side = a_side(a_bone(1))
    pattern = pattern_of(side, Sense())
    assert pattern.air.shape == (1 + int(12 / ROWS_MM), COLUMNS)
    turned_back = pattern_of(side, Sense(-1, -1))
    back = torch.flip(turned_back.air, (0, 1)).roll(1, dims=1)
    torch.testing.assert_close(back, pattern.air)


def test_controls_keep_the_air_and_not_the_places() -> None:
    pattern = pattern_of(a_side(a_bone(1)), Sense())
    for control in [*turned_patterns(pattern), *shuffled_patterns(pattern)]:
        assert control.air.sum() == pytest.approx(float(pattern.air.sum()), abs=1e-2)
        assert not torch.equal(control.air, pattern.air)
    for control in turned_patterns(pattern):
        torch.testing.assert_close(control.air.mean(dim=1), pattern.air.mean(dim=1))
    assert torch.equal(turned_patterns(pattern)[3].air, turned_patterns(pattern)[3].air)


@pytest.fixture(scope="module")
def found() -> SidePose:
    return find_alone(a_bone(1), a_side(a_bone(1)))


def test_a_bore_is_found_in_its_own_bone(found: SidePose) -> None:
    assert found.reason is None
    pose = BorePose(PLAN, found.fit)
    axis = pose.axis_lps(np.array([0.0, LENGTH_MM]))
    true = np.array([[0.4, -0.3, 0.0], [0.4, -0.3, LENGTH_MM]]) @ PLAN.to_lps[:3, :3].T
    np.testing.assert_allclose(axis, true, atol=0.03)
    places = np.random.default_rng(2).uniform([0, 1, 0], [2 * np.pi, 11, 0.5], (50, 3))
    back = np.stack(pose.from_lps("camera", pose.to_lps("camera", *places.T)), axis=1)
    np.testing.assert_allclose(back, places, atol=1e-6)


@pytest.mark.parametrize(
    ("parameter", "value", "told"), [(0, 1.9, True), (1, 2.6, False), (2, 0.06, True), (3, 0.09, False)]
)
def test_an_axis_far_off_the_plan_is_not_told(found: SidePose, parameter: int, value: float, told: bool) -> None:
    moved = found.fit.parameters.copy()
    moved[:4] = 0
    moved[parameter] = value
    reason = replace(found, fit=replace(found.fit, parameters=moved)).reason
    assert (reason is None) == told
    assert told or (reason is not None and "off the plan" in reason)


@pytest.mark.parametrize(("aside_mm", "told"), [(0.03, True), (0.7, False)])
def test_two_sides_that_stand_out_and_contradict_each_other_tell_nothing(
    found: SidePose, aside_mm: float, told: bool
) -> None:
    moved = found.fit.parameters.copy()
    moved[0] += aside_mm
    aside = replace(found, fit=replace(found.fit, parameters=moved, agreement=(0.2,)))
    assert aside.reason is not None
    for sides in ([found, aside], [aside, found]):
        reason = answer(a_bone(1), PLAN, sides).reason
        assert (reason is None) == told
        assert told or (reason is not None and f"{aside_mm:.2f} mm apart" in reason)
    assert answer(a_bone(1), PLAN, [found, replace(aside, standing=0.5)]).reason is None


def test_a_side_that_cannot_tell_alone_is_doubted(found: SidePose) -> None:
    air = a_bone(1)
    assert answer(air, PLAN, [found, found]).doubts == ()
    told = answer(air, PLAN, [found, replace(found, standing=0.5)])
    assert told.reason is None
    assert [doubt.what.endswith("its own depth and turn may be wrong") for doubt in told.doubts] == [True]
    assert answer(air, PLAN, [replace(found, standing=0.5)]).doubts == ()


def test_a_side_that_cannot_tell_alone_does_not_move_the_axis(found: SidePose) -> None:
    """It shows another bone, and agrees somewhere by chance."""
    air = a_bone(1)
    other = find_alone(air, a_side(a_bone(2)))
    assert other.reason is not None
    together = answer(air, PLAN, [found, other]).pose.fit
    np.testing.assert_allclose(together.parameters[:SHARED], found.fit.parameters[:SHARED], atol=1e-3)
    deviations = [np.sqrt(np.diag(fit.covariance)[:SHARED]) for fit in (together, found.fit)]
    np.testing.assert_allclose(*deviations, rtol=0.05)


@pytest.mark.parametrize("seed", [2, 3])
def test_in_another_bone_it_cannot_be_told(seed: int) -> None:
    assert find_alone(a_bone(seed), a_side(a_bone(1))).reason is not None


def test_two_sides_that_err_alike_are_less_than_twice_as_good_as_one():
    one = np.array([[4.0, 1.0], [1.0, 2.0]]) * 1e-4
    np.testing.assert_allclose(_together([one]), one)
    np.testing.assert_allclose(_together([one, one]), (1 + ALIKE) / 2 * one)
    much_better = _together([one, 1e-6 * one])
    assert (np.diag(much_better) < 1e-5 * np.diag(one)).all()


def mirrored(air: AirAround) -> AirAround:
    """The same bone as a mirror shows it: y turned round, and the derivative by y with it."""
    turned = torch.flip(air.values, (3,)) * torch.tensor([1.0, 1.0, -1.0, 1.0])[:, None, None, None]
    return replace(air, values=turned)


def test_a_mirrored_ct_is_settled_by_the_side_whose_sense_is_known(found: SidePose) -> None:
    other, side = mirrored(a_bone(1)), a_side(a_bone(1))
    free = find_alone(other, replace(side, name="ranger", handed=False))
    assert free.reason is None  # in a mirror image it fits as well
    (first, *_) = answer(other, PLAN, [free]).doubts
    assert "sense of θ of ranger is not known" in first.what
    assert 'only if handedness is "mirrored" for ranger' in first.what  # which sense fits can be looked up
    here = find_alone(a_bone(1), replace(side, name="ranger", handed=False))
    assert 'only if handedness is "same" for ranger' in answer(a_bone(1), PLAN, [here]).doubts[0].what
    known = find_alone(other, side)
    assert known.reason is not None
    assert "fits the mirror image" in (answer(other, PLAN, [free, known]).reason or "")
    assert answer(a_bone(1), PLAN, [found]).doubts == ()


def test_a_side_of_another_bore_lets_nothing_be_told(found: SidePose) -> None:
    air = a_bone(1)
    stranger = find_alone(air, a_side(a_bone(2)))
    assert "of another bore" in (answer(air, PLAN, [found, stranger]).reason or "")


def test_a_stranger_that_agrees_by_chance_does_not_stand_out(found: SidePose, monkeypatch: pytest.MonkeyPatch) -> None:
    air = a_bone(1)
    monkeypatch.setattr(finding, "LEAST_BY_CELLS", -1.0)  # no correlation is too small
    strangers = [find_alone(air, a_side(a_bone(seed))) for seed in (2, 3)]
    reasons = [answer(air, PLAN, [found, replace(one, standing=0.5)]).reason for one in strangers]
    assert all("spreads above rearranged ones, 2 at least: of another bore" in (reason or "") for reason in reasons)
    mirrored = replace(found, standing=0.5, mirrored=True)  # nor is one that fits the mirror image of the CT
    assert "fits the mirror image" in (answer(air, PLAN, [found, mirrored]).reason or "")
    axis = found.fit.parameters[:SHARED]
    assert finding.standing_along(air, found.fit.sides[0], axis) > finding.LEAST_STANDING
