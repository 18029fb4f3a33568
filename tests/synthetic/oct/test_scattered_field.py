"""Ablations: what a parameter does not concern stays as it is, to the bit."""

from collections.abc import Mapping

import numpy as np
import pytest

from endoct.synthetic.bone.wall import build_wall
from endoct.synthetic.draw import draw
from endoct.synthetic.oct.bscan import render_bscan
from endoct.synthetic.oct.scattered_field import Scattered, scattered
from endoct.synthetic.oct.scatterers import lattice
from endoct.synthetic.oct.sweep import build_appearance, sweeps
from endoct.synthetic.sample.parameters import Oct, Sample
from endoct.synthetic.sample.ranges import Range

SEED, SLICE = 11, 5
BASE: Mapping[str, Range] = {
    "oct.wall_db": (18.0, 18.0), "oct.scan": ("step",), "bore.bone": ("phantom",), "bore.roughness_mm": (0.004, 0.004),
    "oct.lost_blocks": (0.0, 0.0), "oct.flare_db": (20.0, 20.0), "oct.stated_travel": ("in",),
}  # fmt: skip


def _sample(**varied: Range) -> Sample:
    return draw(
        "learning", SEED, ranges={**BASE, **{name.replace("__", "."): range_ for name, range_ in varied.items()}}
    )


def _scattered(sample: Sample) -> Scattered:
    wall = build_wall(sample)
    return scattered(next(sweeps(sample, wall, build_appearance(sample, wall), [SLICE]))[0])


@pytest.fixture(scope="module")
def plain() -> Scattered:
    return _scattered(_sample())


def test_brighter_bone_has_the_same_speckle(plain: Scattered) -> None:
    sample = _sample(oct__wall_db=(18.1, 18.1))
    brighter = _scattered(sample)
    # the sheath ends before the capillary begins
    first = round((0.6 - sample.oct.first_sample_mm) / sample.oct.axial_pixel_mm)
    np.testing.assert_array_equal(brighter.bone[:, :first], plain.bone[:, :first])
    seen = (np.abs(plain.bone) > 0) & (np.arange(plain.bone.shape[1]) >= first)
    np.testing.assert_allclose(brighter.bone[seen] / plain.bone[seen], 10 ** (0.1 / 20), rtol=2e-5, atol=1e-5)
    # glints belong to the wall; faces, sheath and lines do not
    same = np.all(brighter.amplitude == plain.amplitude, axis=1)
    assert same.sum() >= plain.amplitude.shape[0] - 1
    np.testing.assert_array_equal(brighter.delay_px, plain.delay_px)


def test_a_rougher_wall_shows_the_same_scatterers_and_reflections(plain: Scattered) -> None:
    rougher = _scattered(_sample(bore__roughness_mm=(0.0045, 0.0045)))
    sure = np.abs(plain.bone) ** 2 > np.quantile(np.abs(plain.bone) ** 2, 0.5)
    alike = np.abs(np.vdot(plain.bone[sure], rougher.bone[sure]))
    assert alike / np.linalg.norm(plain.bone[sure]) / np.linalg.norm(rougher.bone[sure]) > 0.97
    instrument = 2 + len(_sample().oct.sheath) + 1
    np.testing.assert_array_equal(rougher.amplitude[:instrument], plain.amplitude[:instrument])
    np.testing.assert_array_equal(rougher.amplitude[plain.n_optical :], plain.amplitude[plain.n_optical :])


@pytest.mark.parametrize(
    ("name", "range_"),
    [
        ("oct__stated_travel", ("unknown",)),
        ("oct__states_handedness", ("true",)),
        ("endoscope__exposure", (0.5, 0.5)),
        ("endoscope__gloss", (0.2, 0.2)),
    ],
)
def test_what_does_not_concern_the_oct_leaves_its_bytes(name: str, range_: Range) -> None:
    bscans = []
    for sample in (_sample(), _sample(**{name: range_})):
        wall = build_wall(sample)
        bscans.append(render_bscan(sample, wall, build_appearance(sample, wall), SLICE))
    np.testing.assert_array_equal(*bscans)


@pytest.mark.parametrize(
    ("name", "range_", "moved"),
    [
        ("oct__wall_db", (9.0, 9.0), {"wall_db"}),
        ("oct__start", ("free",), {"start", "start_angle_rad"}),
        ("oct__lost_blocks", (6.0, 6.0), {"lost_blocks", "lost_ascans"}),
        ("oct__turn_jitter", (0.01, 0.01), {"turn_jitter", "turn_length"}),
        ("oct__stick_slip", (0.0, 0.0), {"stick_slip", "rotation_error_rad"}),
        ("oct__stated_travel", ("unknown",), {"stated_travel"}),
        ("oct__sheath_fade_db", (0.0, 0.0), {"sheath_fade_db"}),
    ],
)
def test_a_parameter_moves_what_it_is_for_and_nothing_else(name: str, range_: Range, moved: set[str]) -> None:
    first, second = _sample(), _sample(**{name: range_})
    differ = {field for field in Oct.model_fields if getattr(first.oct, field) != getattr(second.oct, field)}
    assert differ <= moved
    assert name.removeprefix("oct__") in differ
    assert first.endoscope == second.endoscope
    assert first.bore == second.bore


def test_scatterers_are_those_of_their_place() -> None:
    places = lattice(7, 1.25, draw("learning", 1).oct)
    np.testing.assert_array_equal(places.layer(400, range(300, 500))[100:], places.layer(400, range(400, 500)))
    one, other = places.layer(400, range(300, 320)), places.layer(401, range(300, 320))
    assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 0.02
    assert abs(np.corrcoef(one[:-1].ravel(), one[1:].ravel())[0, 1]) < 0.02
    # whichever usual instrument looks
    assert {lattice(7, 1.25, draw("quick", seed).oct) for seed in range(5)} == {places}


@pytest.mark.parametrize("finer", [1, 2])
@pytest.mark.parametrize("with_line", [True, False])
def test_the_field_is_a_sum_of_waves(finer: int, with_line: bool) -> None:
    """Pixel k turns k times in n samples; a reflector as often as its delay says, seen from the middle of these."""
    rng, n = np.random.default_rng(2), 12
    bone = rng.normal(size=(130, n, 2)).view(np.complex128)[..., 0].astype(np.complex64)
    delay_px, amplitude = rng.uniform(-3, 3, (2, 130)), rng.normal(size=(2, 130, 2)).view(np.complex128)[..., 0]
    returned = Scattered(bone, delay_px, amplitude, n_optical=1)
    for first_m, n_m in ((0, n), (0, 7), (3, n), (-2, 5)):
        m = first_m + np.arange(n_m) / finer
        expected = bone @ np.exp(2j * np.pi * np.outer(np.arange(n), m) / n)
        for k in range(2 if with_line else 1):
            turns = np.outer(delay_px[k], m - (n - 1) / 2) / n
            expected = expected + amplitude[k][:, None] * np.exp(2j * np.pi * turns)
        for columns, field in returned.field(first_m, finer, n_m, with_line):
            np.testing.assert_allclose(field, expected[columns], atol=2e-4)
