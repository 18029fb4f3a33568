"""A plan through solid bone, a ring or a repeating pattern cannot be told; the wall's facts are those of the wall."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from endoct.fusion.pose.air import STEP_MM, AirAround
from endoct.fusion.pose.outlook import LARGEST_ERROR_MM, Prospect, Tried, facts_of, rehearsed, wall_of_plan
from endoct.fusion.pose.rehearsal import BY_CELLS, WITH_DEPTH, rehearse
from endoct.fusion.pose.search import COLUMNS, ROWS_MM
from endoct.fusion.pose.wall import RIMS, SHARED

LENGTH_MM, RADIUS_MM, SEEN_MM = 12.0, 1.25, 10.0
GOOD = Tried(None, True, 0.1, 0.5, 0.1, 0.7, None)


def air_of(share: np.ndarray) -> AirAround:
    """The air of a share (z, y, x) sampled around a plan."""
    by_z, by_y, by_x = np.gradient(share, STEP_MM)
    values = np.stack([share, by_x, by_y, by_z]).astype(np.float32)
    return AirAround(torch.from_numpy(values)[None], (-7.0, -7.0, -7.0), LENGTH_MM)


def places() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    across = STEP_MM * np.arange(round(14 / STEP_MM) + 1) - 7
    along = STEP_MM * np.arange(round((LENGTH_MM + 14) / STEP_MM) + 1) - 7
    z, y, x = np.meshgrid(along, across, across, indexing="ij")
    return z, y, x


def a_bone(pattern: str) -> AirAround:
    z = places()[0]
    if pattern == "solid":
        return air_of(np.zeros(z.shape))
    return air_of(np.clip(0.5 + (0.8 - np.abs(z - 6)) / 0.3, 0, 1))


def cells() -> AirAround:
    shape = places()[0].shape
    frequencies = np.meshgrid(*(np.fft.fftfreq(n, STEP_MM) for n in shape), indexing="ij")
    noise = np.fft.fftn(np.random.default_rng(1).normal(size=shape))
    field = np.fft.ifftn(noise * np.exp(-2 * (np.pi * 0.45) ** 2 * sum(f**2 for f in frequencies))).real
    return air_of(np.clip(0.5 + 2.5 * (field / field.std() - 0.5), 0, 1))


@pytest.fixture(scope="module")
def bone() -> AirAround:
    return cells()


def test_a_wall_is_what_the_ct_has_and_like_itself_where_it_repeats(bone: AirAround) -> None:
    solid = facts_of(wall_of_plan(a_bone("solid"), RADIUS_MM))
    assert (solid.air, solid.cells, solid.likeness, solid.turn_deg) == (0, 0, None, None)
    assert solid.longest_bare_mm == pytest.approx(LENGTH_MM, abs=2 * ROWS_MM)
    ring = facts_of(wall_of_plan(a_bone("ring"), RADIUS_MM))
    assert (ring.cells, ring.likeness) == (1, pytest.approx(1.0, abs=1e-3))
    wall = wall_of_plan(bone, RADIUS_MM)
    assert facts_of(wall).likeness is not None
    assert float(facts_of(wall).likeness or 0) < 0.6
    twice = np.concatenate([wall[:, : COLUMNS // 2]] * 2, axis=1)
    assert facts_of(twice).likeness == pytest.approx(1.0, abs=1e-5)
    assert facts_of(twice).turn_deg == 180
    turned = np.roll(wall, 17, axis=1)
    assert facts_of(turned).cells == facts_of(wall).cells
    assert facts_of(turned).likeness == pytest.approx(facts_of(wall).likeness)


def test_a_rehearsal_is_a_bore_near_its_plan_and_the_same_for_the_same_seed(bone: AirAround) -> None:
    for instrument in (WITH_DEPTH, BY_CELLS):
        one, again, other = (
            rehearse(bone, instrument, RADIUS_MM, SEEN_MM, np.random.default_rng(seed)) for seed in (3, 3, 4)
        )
        assert torch.equal(one.parameters, again.parameters)
        assert len(one.shown.layers) == len(instrument.layers_mm)
        for layer, same, third in zip(one.shown.layers, again.shown.layers, other.shown.layers, strict=True):
            np.testing.assert_array_equal(layer.air, same.air)
            assert not np.array_equal(layer.air, third.air)
            assert 0 <= layer.air.min() <= layer.air.max() <= 1
        tilt = np.hypot(*one.parameters[2:4].tolist())
        assert tilt <= np.radians(2.0)
        entry = one.parameters[:2].numpy() - LENGTH_MM / 2 * np.array([one.parameters[3], -one.parameters[2]])
        assert np.hypot(*entry) <= 1.0


def test_rims_make_what_a_rehearsal_shows_longer_or_shorter(bone: AirAround) -> None:
    for seed in (3, 4, 5):
        sharp, soft = (
            rehearse(bone, replace(WITH_DEPTH, rims_mm=rims_mm), RADIUS_MM, SEEN_MM, np.random.default_rng(seed))
            for rims_mm in (0.0, 0.3)
        )
        assert sharp.parameters[SHARED + RIMS] == 0
        more = soft.shown.layers[0].air.sum() - sharp.shown.layers[0].air.sum()
        assert np.sign(more) == np.sign(float(soft.parameters[SHARED + RIMS]))


def test_in_good_bone_a_rehearsal_is_told_at_its_place(bone: AirAround) -> None:
    tried = rehearsed(bone, WITH_DEPTH, RADIUS_MM, SEEN_MM, 0)
    assert (tried.told, tried.right) == (True, True)
    assert tried.error_mm < 0.4
    assert abs(tried.turn_deg) < 8
    assert 0 < tried.deviation_mm < 0.5
    assert tried == rehearsed(bone, WITH_DEPTH, RADIUS_MM, SEEN_MM, 0)


@pytest.mark.parametrize("pattern", ["solid", "ring"])
def test_where_there_is_no_pattern_nothing_is_told(pattern: str) -> None:
    tried = rehearsed(a_bone(pattern), BY_CELLS, RADIUS_MM, SEEN_MM, 0)
    assert tried.reason is not None
    assert np.isfinite([tried.error_mm, tried.deviation_mm, tried.agreement]).all()


@pytest.mark.parametrize(
    ("tried", "level"),
    [
        ([GOOD] * 6, "well"),
        ([GOOD] * 5 + [replace(GOOD, error_mm=LARGEST_ERROR_MM + 0.1)], "poorly"),
        ([GOOD] * 5 + [replace(GOOD, reason="no")], "poorly"),
        ([GOOD] * 5 + [replace(GOOD, right=False)], "poorly"),
        ([GOOD] * 3 + [replace(GOOD, reason="no")] * 3, "poorly"),
        ([GOOD] * 2 + [replace(GOOD, reason="no")] * 4, "hardly"),
        ([replace(GOOD, right=False)] * 6, "hardly"),
    ],
)
def test_the_level_is_that_of_the_rehearsals(tried: list[Tried], level: str) -> None:
    assert Prospect("depth", tuple(tried)).level == level
