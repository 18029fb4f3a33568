"""The parameters drawn: never easier than agreed, whatever the seed and the preset."""

import numpy as np
import pytest

from endoct.synthetic.draw import draw
from endoct.synthetic.parameters import Endoscope, Oct, Sample
from endoct.synthetic.presets import PRESETS

SEEDS = range(16)


@pytest.fixture(scope="module")
def drawn() -> list[Sample]:
    return [draw("quick", seed) for seed in SEEDS] + [draw("paper", 0)]


def test_catheter_is_off_axis_drifts_and_fits_into_the_capillary(drawn: list[Sample]) -> None:
    for sample in drawn:
        offset = np.array(sample.oct.offset_mm)
        assert offset.min() >= 0.06
        assert offset.max() <= 0.30
        assert np.ptp(offset) > 0.01
        inside = sample.oct.capillary_outer_diameter_mm / 2 - sample.oct.glass_mm
        assert offset.max() + sample.oct.sheath[-1].radius_mm <= inside + 1e-12


def test_the_recordings_share_60_to_100_percent_of_the_shorter(drawn: list[Sample]) -> None:
    for sample in drawn:
        spans = []
        for part, half in ((sample.oct, 0.0), (sample.endoscope, sample.endoscope.visible_length_mm / 2)):
            spans.append((min(part.z_mm) - half, max(part.z_mm) + half))
        shared = min(spans[0][1], spans[1][1]) - max(spans[0][0], spans[1][0])
        assert 0.599 <= shared / min(b - a for a, b in spans) <= 1.001
        assert min(spans[0][0], spans[1][0]) > 0.5
        assert max(spans[0][1], spans[1][1]) < sample.bore.length_mm - 0.5


def test_rotation_error_is_half_a_degree_to_a_few_and_never_turns_back(drawn: list[Sample]) -> None:
    turn = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    for sample in drawn:
        peaks = []
        for harmonics in sample.oct.rotation_error_rad:
            error = np.zeros_like(turn)
            for order, (cos, sin) in enumerate(harmonics, 1):
                error += cos * np.cos(order * turn) + sin * np.sin(order * turn)
            peaks.append(np.abs(error).max())
            assert np.all(np.diff(turn + error) > 0)
        assert 0.49 <= np.rad2deg(max(peaks)) <= 2.6


def test_orientations_and_what_the_sidecars_say_of_them_vary(drawn: list[Sample]) -> None:
    assert {s.oct.sense for s in drawn} == {-1, 1}
    assert {s.oct.travel for s in drawn} == {s.endoscope.travel for s in drawn} == {"in", "out"}
    assert {s.oct.states_handedness for s in drawn} == {True, False}
    assert "unknown" in {s.oct.stated_travel for s in drawn}
    assert {s.endoscope.states_optics for s in drawn} == {True, False}


def test_feed_jitters_by_ten_percent(drawn: list[Sample]) -> None:
    steps = np.concatenate([np.abs(np.diff(sample.endoscope.z_mm)) for sample in drawn])
    assert 0.08 < steps.std() / PRESETS["quick"].pitch_mm < 0.12


def test_sample_survives_json_exactly(drawn: list[Sample]) -> None:
    for sample in drawn:
        assert Sample.model_validate_json(sample.model_dump_json()) == sample


def test_every_parameter_says_what_it_is() -> None:
    for model in (Oct, Endoscope):
        for name, field in model.model_fields.items():
            assert field.description, f"{model.__name__}.{name}"
