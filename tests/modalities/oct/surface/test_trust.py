"""Which A-scans show the wall."""

import numpy as np
import pytest

from endoct.modalities.oct.surface.evidence import Background
from endoct.modalities.oct.surface.trust import trusted, wall_sigmas
from tests.modalities.oct.surface.drawn_bscans import BACKGROUND, N_DEPTH, N_THETA, NO_LINE, SPACING, SPECKLE, speckled


def test_something_opaque_and_its_shadow_are_not_trusted() -> None:
    wall = np.full(N_THETA, 60)
    rng = np.random.default_rng(1)
    image = (np.where(np.arange(N_DEPTH) >= wall[:, None], 105, 50) + rng.normal(0, 5, (N_THETA, N_DEPTH))).astype(
        np.float32
    )
    image[100:140] = rng.normal(50, 5, (40, N_DEPTH))
    image[105:135, 40:60] = 200
    row = wall.copy()
    row[100:140], row[105:135] = N_DEPTH, 40
    good = trusted(image, row, BACKGROUND, SPACING)
    assert not good[102:138].any()
    assert good[:90].all()
    assert good[150:].all()


@pytest.mark.parametrize(("tail_sigmas", "untrusted"), [(1.0, False), (2.0, True), (6.0, True)])
@pytest.mark.parametrize("turn", [0, 300])
def test_darkness_behind_something_bright_says_something_where_walls_are_not_as_dark(
    tail_sigmas: float, untrusted: bool, turn: int
) -> None:
    """By the median of what is left 0.3 to 0.6 mm behind a wall, over the spread of the noise; also over the seam."""
    rng = np.random.default_rng(3)
    row = np.full(N_THETA, 50)
    depth = np.arange(N_DEPTH) - row[:, None]
    mean = np.where(depth >= 25, 50 + 15 * tail_sigmas, np.where(depth >= 0, 110.0, 50.0))
    mean[:40, 75:] = 50
    image = (mean + rng.normal(0, 5, mean.shape)).astype(np.float32)
    good = trusted(np.roll(image, turn - 20, axis=0), row, BACKGROUND, SPACING)
    opaque = np.roll(np.arange(N_THETA) < 40, turn - 20)
    assert (~good[opaque]).mean() == pytest.approx(float(untrusted), abs=0.1)
    assert good[~opaque].all()


ALL_AROUND = np.full(N_THETA, 100)


EVERYWHERE = np.ones(N_THETA, np.bool_)


@pytest.mark.parametrize("power", [1.0, 3.0, 9.0])
def test_a_wall_stands_out_by_its_power_in_standard_errors(power: float) -> None:
    image = speckled(np.full(N_THETA, power), ALL_AROUND)
    sigmas = wall_sigmas(image, ALL_AROUND, EVERYWHERE, SPECKLE, SPACING)
    samples = 8 * 20  # 0.1 mm around and 0.1 mm deep
    assert sigmas == pytest.approx((1 + power - 1.5) * np.sqrt(samples), rel=0.1)
    turned = wall_sigmas(np.roll(image, 77, axis=0), ALL_AROUND, EVERYWHERE, SPECKLE, SPACING)
    assert turned == pytest.approx(sigmas, rel=1e-9)


def test_a_wall_stands_out_of_darkness_that_was_cut_off() -> None:
    image = np.where(np.arange(N_DEPTH) < 100, np.zeros((N_THETA, 1)), 60).astype(np.float32)
    background = Background(noise=0.0, noise_sigma=0.0, wall=60.0, line_excess=NO_LINE, floor=NO_LINE)
    assert wall_sigmas(image, ALL_AROUND, EVERYWHERE, background, SPACING) > 100


def test_noise_does_not_stand_out_whatever_flecks_it_has() -> None:
    image = speckled(np.zeros(N_THETA), ALL_AROUND)
    image[:150, 100:110] += 25
    assert wall_sigmas(image, ALL_AROUND, EVERYWHERE, SPECKLE, SPACING) == 0
    assert wall_sigmas(image, np.full(N_THETA, N_DEPTH), EVERYWHERE, SPECKLE, SPACING) == 0
