"""From nominal angles to those of beams, and back."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from endoct.base.numeric.circle import wrap_rad
from endoct.modalities.oct.turning.rotation import Rotation, even_rotation

rotations = st.builds(
    lambda stretch, factors, lost: replace(
        even_rotation(1),
        stretch=np.array([stretch]),
        smooth_rad=np.array([factors]) * np.repeat(1 / np.arange(1, 5), 2),
        lost_at_rad=np.array([2.0 if lost else np.nan]),
        lost_rad=np.array([lost]),
    ),
    st.floats(-0.04, 0.04),
    st.lists(st.floats(-0.06, 0.06), min_size=8, max_size=8),
    st.sampled_from([0.0, 0.03, 0.1]),
)


@settings(max_examples=60, deadline=None)
@given(rotations)
def test_every_ascan_is_found_again_where_it_looked(rotation: Rotation) -> None:
    nominal = 2 * np.pi * np.arange(500) / 500
    beam = rotation.beam_rad(0, nominal)
    nominal_again, seen = rotation.nominal_rad(0, np.mod(beam, 2 * np.pi), 500)
    assert seen.all()
    # a direction may be recorded twice; either A-scan looks there
    again = np.abs(wrap_rad(rotation.beam_rad(0, nominal_again) - beam))
    away_from_gap = np.abs(nominal - rotation.lost_at_rad[0]) > 0.03 if rotation.lost_rad[0] else np.ones(500, bool)
    assert again[away_from_gap].max() < 2e-4
    assert nominal_again.min() >= -np.pi / 500 - 1e-12
    assert nominal_again.max() <= 2 * np.pi - np.pi / 500 + 1e-12


@pytest.mark.parametrize(("stretch", "lost"), [(-0.03, 0.0), (0.0, 0.1), (-0.02, 0.08)])
def test_what_no_ascan_looked_at_is_not_seen(stretch: float, lost: float) -> None:
    """A turn short by 3 % leaves 3 % of directions out, a lost block its own angle; less one A-scan's width each."""
    rotation = replace(
        even_rotation(1),
        stretch=np.array([stretch - lost / (2 * np.pi)]),
        lost_at_rad=np.array([2.0 if lost else np.nan]),
        lost_rad=np.array([lost]),
    )
    _, seen = rotation.nominal_rad(0, 2 * np.pi * np.arange(4000) / 4000, 500)
    n_gaps = (stretch < 0) + (lost > 0)
    assert np.mean(~seen) == pytest.approx(-stretch + lost / (2 * np.pi), abs=0.0025 * n_gaps)
