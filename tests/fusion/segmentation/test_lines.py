"""Shallow cells by the thin dark lines around them: gaps, the ends of z, the seam of θ, drops, a textured wall."""

import numpy as np
import pytest

from endoct.base.numeric.circle import gaussian
from endoct.fusion.evidence.evidence import Evidence
from endoct.fusion.segmentation.outlines import enclosed_by_lines
from endoct.fusion.segmentation.parameters import SegmentParameters
from endoct.fusion.segmentation.segment import find_cells

N_ROWS, N_THETA, DZ_MM, COLUMN_MM = 120, 400, 0.02, 0.01
ROWS, COLUMNS = np.mgrid[:N_ROWS, :N_THETA]
NO_CELLS = np.zeros((N_ROWS, N_THETA), np.bool_)


def from_middle(row: float, column: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the distance, mm, and the direction, rad, from a place on the wall."""
    around = (np.mod(COLUMNS - column + N_THETA / 2, N_THETA) - N_THETA / 2) * COLUMN_MM
    along = (ROWS - row) * DZ_MM
    return np.hypot(around, along), np.arctan2(along, around)


def shallow(row: float, column: float, floor: float = 0.04, gap_rad: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return a cell 0.7 mm wide and its darkness: a line of 40 µm, open over ``gap_rad``, around a floor."""
    distance, direction = from_middle(row, column)
    cell = distance <= 0.35
    line = cell & (distance > 0.31) & (np.abs(direction) >= gap_rad / 2)
    return cell, np.where(line, 0.35, np.where(cell, floor, 0.0))


def wall(darkness: np.ndarray, texture: float = 0.05) -> Evidence:
    """Return ``darkness`` on a wall uneven at 40 µm by this standard deviation."""
    noise = gaussian(np.random.default_rng(3).normal(size=darkness.shape).astype(np.float32), 2, 4)
    values = gaussian(darkness.astype(np.float32), 0.5, 1) + np.float32(texture) * noise / noise.std()
    valid = np.ones(values.shape, np.bool_)
    radius_mm = N_THETA * COLUMN_MM / (2 * np.pi)
    return Evidence(values, valid, DZ_MM * np.arange(N_ROWS), DZ_MM, 0.3, radius_mm, "darkness")


def lines(evidence: Evidence) -> np.ndarray:
    return enclosed_by_lines(evidence, NO_CELLS, SegmentParameters())


def agreement(mask: np.ndarray, cell: np.ndarray) -> float:
    return float((mask & cell).sum() / (mask | cell).sum())


@pytest.mark.parametrize("column", [200, 2], ids=["inside", "over-the-seam"])
@pytest.mark.parametrize("row", [60, 0, 119], ids=["inside", "at-the-first-row", "at-the-last-row"])
def test_a_floor_as_bright_as_the_wall_is_found_by_the_line_around_it(row: int, column: int) -> None:
    cell, darkness = shallow(row, column)
    assert agreement(lines(wall(darkness)), cell) > 0.88


def test_a_gap_of_a_tenth_of_a_millimetre_does_not_open_a_cell() -> None:
    cell, darkness = shallow(60, 200, gap_rad=0.3)
    assert agreement(lines(wall(darkness)), cell) > 0.88


def test_half_a_ring_encloses_next_to_nothing() -> None:
    cell, darkness = shallow(60, 200, gap_rad=np.pi)
    assert lines(wall(darkness))[cell].mean() < 0.1


def test_a_drop_is_brighter_than_the_wall() -> None:
    assert not lines(wall(shallow(60, 200, floor=-0.3)[1])).any()


def test_a_textured_wall_encloses_nothing() -> None:
    assert lines(wall(np.zeros(NO_CELLS.shape), texture=0.2)).mean() < 0.002


def test_seams_around_the_bore_enclose_nothing() -> None:
    assert not lines(wall(np.where(ROWS % 12 < 2, 0.2, 0.0))).any()


def test_samples_too_far_apart_show_no_lines() -> None:
    evidence = wall(shallow(60, 200)[1])
    coarse = Evidence(
        evidence.values[::2], evidence.valid[::2], evidence.z_mm[::2], 2 * DZ_MM, 0.3, evidence.radius_mm, "darkness"
    )
    assert not enclosed_by_lines(coarse, NO_CELLS[::2], SegmentParameters()).any()


def test_shallow_and_deep_cells_together() -> None:
    cell, darkness = shallow(60, 200)
    deep = from_middle(60, 60)[0] <= 0.35
    mask = find_cells(wall(darkness + 1.2 * deep), SegmentParameters()).mask
    assert agreement(mask, cell | deep) > 0.88
    assert mask[cell].mean() > 0.9
