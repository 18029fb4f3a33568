"""The parameters drawn: never easier than agreed, whatever the seed and the preset."""

import numpy as np
import pytest

from endoct.base.errors import EndoctError
from endoct.synthetic.draw import STICK_ORDERS, draw, rotation_error
from endoct.synthetic.sample.parameters import Bore, Endoscope, Oct, Sample
from endoct.synthetic.sample.presets import PRESETS
from endoct.synthetic.sample.ranges import PARTS, allowed_range, choices, default_ranges
from endoct.synthetic.specimen_files import endoscope_sidecar, oct_sidecar
from tests.synthetic.fingerprints import changed

SEEDS = range(8)
TURN = np.linspace(0, 2 * np.pi, 4000, endpoint=False)


@pytest.fixture(scope="module")
def drawn() -> list[Sample]:
    return [draw(preset, seed) for preset in PRESETS if preset != "paper" for seed in SEEDS] + [draw("paper", 0)]


@pytest.mark.parametrize("kind", PRESETS)
def test_a_seed_draws_what_it_drew_when_sets_were_published(kind: str) -> None:
    assert changed("sample", kind) == []


def test_catheter_is_off_axis_drifts_and_fits_into_the_capillary(drawn: list[Sample]) -> None:
    for sample in drawn:
        offset = np.array(sample.oct.offset_mm)
        assert offset.min() >= 0.06
        assert offset.max() <= (0.40 if sample.preset == "hard" else 0.30)
        assert np.ptp(offset) > 0.01
        inside = sample.oct.capillary_outer_diameter_mm / 2 - sample.oct.glass_mm
        assert offset.max() + sample.oct.sheath[-1].radius_mm <= inside + 1e-12


def test_the_recordings_share_60_to_100_percent_of_the_shorter(drawn: list[Sample]) -> None:
    for sample in drawn:
        spans = []
        half, turn_mm = sample.endoscope.visible_length_mm / 2, abs(sample.oct.z_advance_mm)
        for part, before, after in ((sample.oct, 0.0, turn_mm), (sample.endoscope, half, half)):
            spans.append((min(part.z_mm) - before, max(part.z_mm) + after))
        shared = min(spans[0][1], spans[1][1]) - max(spans[0][0], spans[1][0])
        assert 0.58 <= shared / min(b - a for a, b in spans) <= 1.001
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
        assert 0.49 <= np.rad2deg(max(peaks)) <= (5.1 if sample.preset == "hard" else 2.6)


def test_orientations_and_what_the_sidecars_say_of_them_vary(drawn: list[Sample]) -> None:
    assert {s.oct.sense for s in drawn} == {-1, 1}
    assert {s.oct.travel for s in drawn} == {s.endoscope.travel for s in drawn} == {"in", "out"}
    assert {s.oct.states_handedness for s in drawn} == {True, False}
    assert "unknown" in {s.oct.stated_travel for s in drawn}
    assert {s.endoscope.states_optics for s in drawn} == {True, False}


@pytest.mark.parametrize("part", sorted(PARTS))
def test_every_word_that_can_be_varied_is_what_the_sample_then_has(part: str) -> None:
    for name, words in choices(PARTS[part]).items():
        for word in words:
            drawn = draw("learning", 3, ranges={f"{part}.{name}": (word,)})
            value = getattr(getattr(drawn, part), name)
            assert (str(value).lower() if isinstance(value, bool) else value) == word, name


def test_the_sidecars_state_the_travel_that_is_varied() -> None:
    ranges = {f"{part}.stated_travel": ("out",) for part in ("oct", "endoscope")}
    ranges |= {f"{part}.travel": ("in",) for part in ("oct", "endoscope")}
    sample = draw("learning", 3, ranges=ranges)
    assert oct_sidecar(sample)["travel"] == endoscope_sidecar(sample)["travel"] == "out"


def test_feed_jitters_by_ten_percent(drawn: list[Sample]) -> None:
    steps = np.concatenate([np.abs(np.diff(sample.endoscope.z_mm)) for sample in drawn])
    steps = steps[steps < 1.5 * PRESETS["quick"].pitch_mm]  # the others are double, a frame between was dropped
    assert 0.08 < steps.std() / PRESETS["quick"].pitch_mm < 0.12


def test_sample_survives_json_exactly(drawn: list[Sample]) -> None:
    for sample in drawn:
        assert Sample.model_validate_json(sample.model_dump_json()) == sample


def test_every_parameter_says_what_it_is() -> None:
    for model in (Bore, Oct, Endoscope):
        for name, field in model.model_fields.items():
            assert field.description or name in ("cells", "lost_ascans"), f"{model.__name__}.{name}"


def test_what_is_drawn_lies_within_what_is_allowed() -> None:
    for model in (Bore, Oct, Endoscope):
        for name, (low, high) in default_ranges(model).items():
            least, most = allowed_range(model, name)
            assert least <= low <= high <= most, f"{model.__name__}.{name}"


def test_presets_draw_only_harder_ranges_of_known_parameters(drawn: list[Sample]) -> None:
    for sample in drawn:
        if sample.preset == "hard":
            assert 5 <= sample.oct.wall_db <= 10
            assert max(sample.oct.offset_mm) > 0.2


def test_one_bore_can_be_recorded_several_times() -> None:
    first, second = (draw("learning", seed, bore_seed=77) for seed in (1, 2))
    assert first.bore == second.bore
    assert first.oct != second.oct
    assert first.endoscope.z_mm != second.endoscope.z_mm


def test_ranges_replace_what_is_drawn_from_and_nothing_else() -> None:
    ranges = {"oct.wall_db": (5.0, 6.0), "oct.start": ("free",), "oct.scan": ("helical",), "bore.dust": (1.0, 1.0)}
    chosen, plain = draw("learning", 3, ranges=ranges), draw("learning", 3)
    assert 5 <= chosen.oct.wall_db <= 6
    assert (chosen.oct.start, chosen.oct.scan) == ("free", "helical")
    assert np.ptp(chosen.oct.start_angle_rad) > 1
    assert abs(chosen.oct.z_advance_mm) == PRESETS["learning"].pitch_mm
    assert chosen.oct.axial_pixel_mm == plain.oct.axial_pixel_mm


@pytest.mark.parametrize("travel", ["in", "out"])
def test_turns_of_a_helical_scan_lie_beyond_where_those_of_steps_are(travel: str) -> None:
    """Each from the place of a step on by one pitch inward, whichever way the catheter is pulled."""
    step, helix = (
        draw("learning", 3, ranges={"oct.scan": (scan,), "oct.travel": (travel,)}).oct for scan in ("step", "helical")
    )
    ends_mm = np.sort([helix.z_mm, np.array(helix.z_mm) + helix.z_advance_mm], axis=0)
    np.testing.assert_allclose(ends_mm[0], step.z_mm, atol=1e-9)
    np.testing.assert_allclose(ends_mm[1] - ends_mm[0], PRESETS["learning"].pitch_mm, atol=1e-9)


@pytest.mark.parametrize(
    ("ranges", "named"),
    [
        ({"oct.wal_db": (1.0, 2.0)}, "oct.wall_db"),
        ({"wall_db": (1.0, 2.0)}, "wall_db"),
        ({"oct.wall_db": (2.0, 1.0)}, "2.0..1.0"),
        ({"oct.wall_db": (0.0, 1000.0)}, "-5..40"),
        ({"oct.wall_db": ("bright",)}, "bright"),
        ({"oct.scan": ("spiral",)}, "step or helical"),
    ],
)
def test_impossible_wishes_are_refused(ranges: dict[str, tuple[float, float]], named: str) -> None:
    with pytest.raises(EndoctError, match=named):
        draw("learning", 0, ranges=ranges)


def _error_rad(stick_slip: float, seed: int) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    harmonics = np.array(rotation_error(np.random.default_rng(seed), 12, 0.087, stick_slip))
    orders = np.arange(1, harmonics.shape[1] + 1)
    waves = np.stack([np.cos(np.outer(orders, TURN)), np.sin(np.outer(orders, TURN))], axis=1)
    return np.asarray(np.einsum("nkc,kct->nt", harmonics, waves))


@pytest.mark.parametrize("stick_slip", [0.0, 0.4, 1.0])
def test_the_peak_is_what_was_asked_for_and_the_catheter_never_turns_back(stick_slip: float) -> None:
    for seed in range(4):
        error = _error_rad(stick_slip, seed)
        assert np.abs(error).max() == pytest.approx(0.087, rel=0.02)
        assert np.all(np.diff(TURN + error, axis=1) > 0)


def test_a_catheter_that_sticks_falls_behind_slowly_and_catches_up_fast() -> None:
    speed = np.gradient(_error_rad(1.0, 1), TURN, axis=1)
    assert speed.max() > 2 * -speed.min()
    assert np.mean(speed < 0) > 2 * np.mean(speed > -speed.min())


def test_without_sticking_four_harmonics_are_left() -> None:
    harmonics = np.array(rotation_error(np.random.default_rng(1), 5, 0.05, 0.0))
    assert harmonics.shape == (5, STICK_ORDERS, 2)
    assert not harmonics[:, 4:].any()
