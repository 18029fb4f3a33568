"""Cells on the circle, and doubts about them."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from bore_pairs import Pair

from endoct.base.errors import EndoctError
from endoct.fusion.evidence.evidence import Evidence, prepare
from endoct.fusion.segmentation.parameters import SegmentParameters
from endoct.fusion.segmentation.segment import believability_of, doubts_of_cells, find_cells
from endoct.fusion.segmentation.side_cells import segment
from endoct.fusion.segmentation.threshold import li_threshold
from endoct.stitching.panorama import Panorama


def test_a_wall_that_is_all_cells_is_doubted_however_little_was_observed() -> None:
    for rows, told in ((5, []), (7, ["wall-mostly-cells"])):
        mask = np.zeros((10, 8), np.bool_)
        mask[:rows] = True
        found = believability_of(np.ones(mask.shape, np.bool_), mask.astype(np.float32), mask, 0.5, with_outlines=True)
        assert [doubt.code for doubt in doubts_of_cells(found)] == told


def test_what_stands_out_like_noise_faintly_or_without_an_outline_is_doubted() -> None:
    rng = np.random.default_rng(0)
    smooth, valid = np.abs(rng.normal(0, 1, (50, 200))).astype(np.float32), np.ones((50, 200), np.bool_)
    smooth[::2] *= -1  # of standard deviation 1, on either side of the wall
    mask = np.zeros(smooth.shape, np.bool_)
    mask[:10] = True

    def codes(cell: float, unclaimed_rows: int = 0, before_rows: int = 0) -> list[str]:
        seen = smooth.copy()
        seen[: 10 + unclaimed_rows] = cell
        seen[50 - before_rows :] = -cell
        found = believability_of(valid, seen, mask, 4.5, with_outlines=True)
        assert believability_of(valid, seen, mask, 4.5, with_outlines=False).unclaimed == 0
        assert found.spread == pytest.approx(1 / cell, rel=0.05) or before_rows
        return [doubt.code for doubt in doubts_of_cells(found)]

    assert codes(7.0) == []
    assert codes(5.0) == ["cells-faint"]
    assert codes(7.0, unclaimed_rows=1) == []
    assert codes(7.0, unclaimed_rows=2) == ["cells-without-outline"]
    assert codes(12.0, before_rows=1) == ["cells-in-noise"]


def test_cells_of_depth_and_of_brightness_are_found(pair: Pair) -> None:
    for panorama, truth in ((pair.a, pair.cells_a), (pair.b, pair.cells_b)):
        found = segment(panorama)
        assert (found & truth).sum() / (found | truth).sum() > 0.85


def test_bright_cells_are_found_when_they_are_said_to_be_bright(pair_of: Callable) -> None:
    pair = pair_of(bright_cells=True)
    found = segment(pair.a, polarity="bright")
    assert (found & pair.cells_a).sum() / (found | pair.cells_a).sum() > 0.8


def test_invalid_samples_are_no_cells_and_do_not_move_the_threshold(pair: Pair, panorama_of: Callable) -> None:
    a: Panorama = pair.a
    valid = np.ones(a.grid.shape, np.bool_)
    valid[:, 200:240] = False
    spoilt = a.intensity.copy()
    spoilt[~valid] = 1e4
    one = find_cells(prepare(panorama_of(spoilt, dz_mm=0.05, valid=valid)), SegmentParameters())
    two = find_cells(prepare(panorama_of(a.intensity, dz_mm=0.05, valid=valid)), SegmentParameters())
    assert one.threshold == two.threshold
    assert not one.mask[~valid].any()


def test_a_blank_side_has_no_cells_to_threshold(panorama_of: Callable) -> None:
    with pytest.raises(EndoctError, match="constant"):
        segment(panorama_of(np.ones((20, 64)), dz_mm=0.1))
    with pytest.raises(EndoctError, match="no cells"):
        segment(panorama_of(np.ones((20, 64)), depth_mm=np.zeros((20, 64)), dz_mm=0.1))


def uneven_wall(n_cell_rows: int, cell: float) -> Evidence:
    """Return a wall of spread 0.1 whose first rows are a cell of darkness ``cell``; nothing is next to itself."""
    values = np.random.default_rng(3).normal(0, 0.1, (100, 400)).astype(np.float32)
    values[:n_cell_rows] += np.float32(cell)
    z_mm = 0.1 * np.arange(100)
    return Evidence(values, np.ones(values.shape, np.bool_), z_mm, 0.1, 0.0, 0.1 * 400 / (2 * np.pi), "darkness")


@pytest.mark.parametrize("cell", [0.5, 2.3])
@pytest.mark.parametrize("n_cell_rows", [2, 30])
def test_lis_threshold_lies_between_the_walls_spread_and_the_cells(n_cell_rows: int, cell: float) -> None:
    li = SegmentParameters(smooth_mm=0, outlines=False)
    found = find_cells(uneven_wall(n_cell_rows, cell), li)
    assert found.threshold is not None
    assert 0.27 < found.threshold < 0.45
    assert [doubt.code for doubt in found.doubts] == (["cells-faint"] if cell < 0.6 else [])


def test_li_on_the_plain_contrast_stays_available() -> None:
    evidence = uneven_wall(2, 2.3)
    plain = SegmentParameters(smooth_mm=0, outlines=False, contrast_floor_sigmas=0, contrast_cap=50)
    assert find_cells(evidence, plain).threshold == li_threshold(np.maximum(evidence.values, 0))


def test_a_wall_within_its_own_spread_is_still_thresholded() -> None:
    values = np.tile(np.where(np.arange(400) % 2, 0.1, -0.1).astype(np.float32), (100, 1))
    evidence = replace(uneven_wall(2, 0.5), values=values)
    assert find_cells(evidence, SegmentParameters(smooth_mm=0, outlines=False)).threshold is not None


@pytest.mark.parametrize("cell_mm", [0.0, 0.15])
def test_a_wall_without_cells_has_none(cell_mm: float) -> None:
    """Relief that is noise of 8 µm, a stripe of it not observed; one cell of 0.3 × 0.3 mm across the seam, or none."""
    rng = np.random.default_rng(5)
    values = rng.normal(0, 0.008, (60, 400)).astype(np.float32)
    truth = np.zeros(values.shape, np.bool_)
    truth[20:26, np.arange(-3, 3)] = cell_mm > 0
    values[truth] += np.float32(cell_mm)
    valid = np.ones(values.shape, np.bool_)
    valid[:, 100:140] = False
    evidence = Evidence(values, valid, 0.05 * np.arange(60), 0.05, 0.0, 0.05 * 400 / (2 * np.pi), "relief")
    found = find_cells(evidence, SegmentParameters(smooth_mm=0))
    assert np.array_equal(found.mask, truth)
    assert found.doubts == ()
    assert found.threshold is not None
    assert found.threshold > 0.03
