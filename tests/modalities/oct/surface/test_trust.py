"""Whether a surface is the wall's, and what samples as recorded say against it."""

from dataclasses import replace

import numpy as np
import pytest

from endoct.modalities.oct.surface.background import Background
from endoct.modalities.oct.surface.trust import (
    RawLevels,
    SecondLook,
    look_again,
    measure_raw_levels,
    trusted,
    wall_sigmas,
)
from tests.modalities.oct.surface.drawn_bscans import (
    BACKGROUND,
    N_DEPTH,
    N_THETA,
    NO_LINE,
    PIXEL_MM,
    SPACING,
    SPECKLE,
    speckled,
)
from tests.modalities.oct.turning.drawn_slices import ACQUISITION, BORE_MM, N_NOISE, faces_of, noisy_slice
from tests.modalities.oct.turning.drawn_slices import PIXEL_MM as SLICE_PIXEL_MM

WALL_ROW, OPEN = 80, 40
LEVELS = RawLevels(darkness=-2.5, bone=10.5)
"""Of noise of mean power 1 in dB, and of bone of 20 times that."""
WALL_MM = np.full(N_THETA, WALL_ROW * PIXEL_MM)
NO_LINES = np.zeros(N_DEPTH, np.bool_)
EVERYWHERE = np.ones(N_THETA, np.bool_)


def around_the_seam(n: int) -> np.ndarray:
    return np.arange(-(n // 2), n - n // 2) % N_THETA


def wall_with_opening() -> tuple[np.ndarray, np.ndarray]:
    """A B-scan and its true surface: bone, and an opening of 60 columns across the seam, 0.2 mm deep."""
    row = np.full(N_THETA, WALL_ROW)
    row[around_the_seam(60)] += OPEN
    return speckled(np.full(N_THETA, 20.0), row), row


def looked(image: np.ndarray, row: np.ndarray, **other: object) -> SecondLook:
    given = {"wall_mm": WALL_MM, "trusted": EVERYWHERE, "lines": NO_LINES, "levels": LEVELS, "spacing": SPACING}
    return look_again(image, row, **(given | other))  # type: ignore[arg-type]


def test_a_true_surface_is_not_contradicted() -> None:
    image, row = wall_with_opening()
    look = looked(image, row)
    assert look.openings == pytest.approx(60 / N_THETA)
    assert look.bone_before == 0
    assert look.dark_wall == 0


@pytest.mark.parametrize("none_there", [False, True])
def test_bone_before_a_surface_contradicts_it(none_there: bool) -> None:
    image, row = wall_with_opening()
    erased = np.arange(200, 260)
    row[erased] = N_DEPTH if none_there else WALL_ROW + OPEN
    look = looked(image, row)
    assert look.openings == pytest.approx(120 / N_THETA)
    assert look.bone_before == pytest.approx(60 / N_THETA, abs=0.01)
    turned = looked(np.roll(image, 130, axis=0), np.roll(row, 130))
    assert turned.bone_before == pytest.approx(look.bone_before, abs=1e-9)


def test_darkness_behind_the_wall_contradicts_it() -> None:
    image, _ = wall_with_opening()
    look = looked(image, np.full(N_THETA, WALL_ROW))
    assert look.openings == 0
    assert look.dark_wall == pytest.approx(60 / N_THETA, abs=0.02)


def test_what_is_not_trusted_and_what_lies_under_lines_does_not_count() -> None:
    image, row = wall_with_opening()
    row[200:260] = N_DEPTH
    untrusted = EVERYWHERE.copy()
    untrusted[200:260] = False
    assert looked(image, row, trusted=untrusted).bone_before == 0
    lit = image.copy()
    lit[:, WALL_ROW + 5 : WALL_ROW + 12] += 20
    true_row = wall_with_opening()[1]
    assert looked(lit, true_row).bone_before > 0.05
    lines = NO_LINES.copy()
    lines[WALL_ROW + 5 : WALL_ROW + 12] = True
    assert looked(lit, true_row, lines=lines).bone_before == 0


def test_without_levels_nothing_is_contradicted() -> None:
    image, row = wall_with_opening()
    row[200:260] = N_DEPTH
    assert looked(image, row, levels=RawLevels(np.nan, np.nan)).bone_before == 0


@pytest.mark.parametrize("open_share", [0.0, 0.5])
def test_levels_are_those_of_gap_and_bone(open_share: float) -> None:
    rng = np.random.default_rng(2)
    depth_mm = np.arange(500) * SLICE_PIXEL_MM
    slices = [noisy_slice(np.ones((N_NOISE, 500)), 0.15 + 0j, i) for i in range(12)]
    faces = faces_of(slices)
    for i, empty in enumerate(slices):
        wall = replace(faces.capillary.circle(i), radius_mm=BORE_MM).depth_mm(empty.ascan_angle_rad)
        bone = (depth_mm > wall[:, None]) & (rng.random(N_NOISE) >= open_share)[:, None]
        slices[i] = noisy_slice(rng.exponential(np.where(bone, 100.0, 1.0)), 0.15 + 0j, i)
    lines = np.zeros(500, np.bool_)
    levels = measure_raw_levels(slices, faces, lines, ACQUISITION)
    mean_log_db = 10 / np.log(10) * 0.5772  # the mean of the logarithm lies so far below that of the mean
    assert levels.darkness == pytest.approx(-mean_log_db, abs=0.2)
    assert levels.bone == pytest.approx(20 - mean_log_db, abs=1.5)
    narrow = ACQUISITION.model_copy(update={"bore_diameter_mm": 2 * 0.85 + 0.2})
    assert np.isnan(measure_raw_levels(slices, faces, lines, narrow).darkness)


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
