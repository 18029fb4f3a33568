"""Cells up to their clearest outline: stains, bright floors, blurred rims, the seam of θ."""

from dataclasses import replace

import numpy as np
import pytest

from endoct.base.numeric.circle import gaussian
from endoct.fusion.evidence.evidence import Evidence
from endoct.fusion.segmentation.parameters import SegmentParameters
from endoct.fusion.segmentation.segment import find_cells

N_ROWS, N_THETA, STEP_MM = 150, 400, 0.02
ROWS, COLUMNS = np.mgrid[:N_ROWS, :N_THETA]


def disc(row: float, column: float, radius_mm: float) -> np.ndarray:
    across = np.mod(COLUMNS - column + N_THETA / 2, N_THETA) - N_THETA / 2
    return np.hypot(ROWS - row, across) * STEP_MM <= radius_mm


def darkness(values: np.ndarray) -> Evidence:
    noise = np.random.default_rng(5).normal(0, 0.05, values.shape).astype(np.float32)
    values = gaussian(values.astype(np.float32), 1.5, 1.5) + gaussian(noise, 1, 1)
    radius_mm = N_THETA * STEP_MM / (2 * np.pi)
    z_mm = STEP_MM * np.arange(N_ROWS)
    return Evidence(values, np.ones(values.shape, np.bool_), z_mm, STEP_MM, 0.0, radius_mm, "darkness")


DEEP, SHALLOW = disc(50, 4, 0.4), disc(90, 200, 0.4)
RIM = SHALLOW & ~disc(90, 200, 0.3)
STAIN = np.exp(-0.5 * ((ROWS - 40) ** 2 + (COLUMNS - 120) ** 2) * (STEP_MM / 0.25) ** 2)
SCENE = np.where(DEEP, 1.2, np.where(RIM, 0.35, np.where(SHALLOW, 0.05, 0.3 * STAIN)))


def test_deep_and_shallow_cells_are_as_large_as_they_are_and_a_stain_is_none() -> None:
    mask = find_cells(darkness(SCENE), SegmentParameters()).mask
    truth = DEEP | SHALLOW
    assert (mask & truth).sum() / (mask | truth).sum() > 0.93
    assert not mask[disc(40, 120, 0.3)].any()
    assert mask[SHALLOW & ~RIM].all()


def test_lis_threshold_alone_takes_the_stain() -> None:
    alone = find_cells(darkness(SCENE), SegmentParameters(outlines=False))
    both = find_cells(darkness(SCENE), SegmentParameters())
    assert alone.threshold == both.threshold
    assert alone.mask[disc(40, 120, 0.1)].any()
    assert "outline" in both.of
    assert "outline" not in alone.of


def test_cells_turn_with_the_wall() -> None:
    evidence = darkness(SCENE)
    turned = replace(evidence, values=np.roll(evidence.values, 137, axis=1))
    cells = [find_cells(one, SegmentParameters()).mask for one in (evidence, turned)]
    np.testing.assert_array_equal(np.roll(cells[0], 137, axis=1), cells[1])


def test_rows_too_far_apart_for_outlines_are_left_to_lis_threshold() -> None:
    evidence = darkness(SCENE)
    far = replace(evidence, values=evidence.values[::8], valid=evidence.valid[::8], z_mm=evidence.z_mm[::8], dz_mm=0.16)
    assert "outline" not in find_cells(far, SegmentParameters()).of


def textured(values: np.ndarray, spread: float) -> Evidence:
    """Return blurred ``values`` on a wall uneven at 40 and at 250 µm, of this standard deviation."""
    rng = np.random.default_rng(7)
    fine, coarse = (gaussian(rng.normal(size=values.shape).astype(np.float32), s, s) for s in (2, 12))
    wall = 0.75 * fine / fine.std() + 0.65 * coarse / coarse.std()
    clean = darkness(values)
    return replace(clean, values=clean.values + np.float32(spread) * wall)


def agreement(evidence: Evidence, truth: np.ndarray, parameters: SegmentParameters | None = None) -> float:
    mask = find_cells(evidence, parameters or SegmentParameters()).mask
    return float((mask & truth).sum() / (mask | truth).sum())


GREY, DARK = -np.log(0.65), -np.log(0.1)
"""Darkness of floors 0.65 and 0.1 times as bright as the wall."""


def test_a_grey_cell_is_found_beside_very_dark_ones() -> None:
    grey, dark = disc(75, 200, 0.8), disc(40, 60, 0.4) | disc(110, 330, 0.4)
    evidence = textured(GREY * grey + DARK * dark, 0.1)
    assert agreement(evidence, grey | dark) > 0.88
    mask = find_cells(evidence, SegmentParameters()).mask
    assert mask[grey].mean() > 0.88
    assert mask[dark].mean() > 0.9


@pytest.mark.parametrize("row", [75, 0, 149], ids=["inside", "at-the-first-row", "at-the-last-row"])
@pytest.mark.parametrize("grey", [0.3, GREY])
def test_a_wide_cell_with_a_dark_core_keeps_its_grey_rest_also_at_the_end(row: int, grey: float) -> None:
    wide = disc(row, 200, 0.7)
    core = disc(row, 212, 0.35) & wide
    assert agreement(textured(np.where(core, DARK, grey * wide), 0.05), wide) > 0.9


@pytest.mark.parametrize("row", [4, 145])
def test_a_dark_cell_that_touches_the_end_is_found(row: int) -> None:
    cell, other = disc(row, 100, 0.5), disc(75, 300, 0.4)
    assert agreement(textured(1.2 * cell + 0.8 * other, 0.1), cell | other) > 0.88


def test_noise_in_the_dark_has_no_outline() -> None:
    cell = disc(75, 200, 0.6)
    stripes = np.where(ROWS % 12 < 6, 0.9, 2.2)
    assert agreement(textured(np.where(cell, stripes, 0), 0.03), cell) > 0.93


def test_a_grey_cell_with_one_blurred_rim_is_found() -> None:
    """As a slanted view shows it: the wall below the rim fades over 1 mm."""
    wide, dark = disc(75, 200, 0.8), disc(30, 40, 0.4)
    fade = np.clip((ROWS - (75 - 40)) * STEP_MM / 1.0, 0, 1)
    evidence = textured(0.5 * fade * wide + DARK * dark, 0.12)
    mask = find_cells(evidence, SegmentParameters()).mask
    assert mask[wide & (ROWS > 75)].mean() > 0.9
    assert mask[~wide & ~dark].mean() < 0.01
