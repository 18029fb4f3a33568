"""What belongs to the bone and what to the instrument: each figure is measured by ``benchmarks/physics/instrument``."""

import numpy as np
import pytest
from tolerances import (
    GHOST_DB,
    INSTRUMENT_REL,
    SPECKLE_CONTRAST_OF_SHEATH,
    SPECKLE_CORRELATION,
    SPECKLE_OVER_SPEED_REL,
    SPEED_REL,
)

from benchmarks.physics import instrument


def test_speckle_is_as_many_ascans_wide_as_the_catheter_turns_slowly() -> None:
    found = instrument.speckle_over_speed(slices=8)
    assert found.x.max() / found.x.min() > 1.3
    assert found.worst_rel < SPECKLE_OVER_SPEED_REL


def test_a_catheter_that_sticks_and_slips_shows_in_its_speckle() -> None:
    found = instrument.speed_from_speckle()
    assert found.expected.max() > 1.08
    assert np.sqrt(np.mean((found.measured / found.expected - 1) ** 2)) < SPEED_REL
    assert np.corrcoef(found.measured, found.expected)[0, 1] > 0.8


def test_speckle_of_an_offset_catheter_is_as_wide_as_beams_are_apart() -> None:
    found = instrument.speckle_around_an_offset(slices=4)
    assert found.expected.max() / found.expected.min() > 1.2
    assert found.worst_rel < INSTRUMENT_REL
    assert np.corrcoef(found.measured, found.expected)[0, 1] > 0.95


def test_slices_decorrelate_over_the_width_of_the_beam() -> None:
    found = instrument.speckle_over_place()
    np.testing.assert_allclose(found.measured, found.expected, atol=SPECKLE_CORRELATION)


def test_the_same_places_give_the_same_speckle_and_others_another() -> None:
    assert instrument.repeated() > 0.95
    # from 50 µm aside, scatterers in one spot add up with other phases
    assert abs(instrument.repeated(0.05)) < 0.1


def test_a_helical_scan_moves_on_within_its_turn() -> None:
    found = instrument.helical()
    np.testing.assert_allclose(found.measured, found.expected, atol=3 * SPECKLE_CORRELATION)


@pytest.mark.parametrize("lateral_mm", [0.02, 0.03])
def test_out_of_focus_little_light_is_lost_and_speckle_is_wider(lateral_mm: float) -> None:
    loss, width = instrument.focus(lateral_mm)
    assert 0.1 < loss.measured[2] < 0.55  # 1 mm from the focus
    np.testing.assert_allclose(loss.measured, loss.expected, rtol=INSTRUMENT_REL, atol=0.02)
    assert width.worst_rel < INSTRUMENT_REL


def test_an_off_axis_catheter_meets_both_faces_squarely_twice_a_turn() -> None:
    found = instrument.reflections()
    assert found.flares == found.slices
    assert found.off_rad < 0.01
    assert found.ghost_db[0] == pytest.approx(24, rel=INSTRUMENT_REL)
    for measured, expected in (found.ghost_db, found.double_pass_db):
        assert measured == pytest.approx(expected, abs=GHOST_DB)


def test_the_noise_floor_has_bands() -> None:
    assert instrument.noise_floor(2.6)[0] == pytest.approx(2.6, rel=INSTRUMENT_REL)


def test_the_sheath_is_a_band_of_speckle_that_fades() -> None:
    found = instrument.sheath(0.1)
    assert found.contrast == pytest.approx(1, abs=SPECKLE_CONTRAST_OF_SHEATH)
    assert found.thickness_mm == pytest.approx(0.1, rel=INSTRUMENT_REL)
    assert found.fades_db > 5
