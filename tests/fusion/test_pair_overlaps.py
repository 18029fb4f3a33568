"""The overlap by Li's threshold alone, beside that of the cells that were found."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from bore_pairs import Pair
from skimage.filters import threshold_li

from endoct.fusion.comparison import CompareParameters, compare_panoramas, compare_placed
from endoct.fusion.evidence.side import DrawnMask, two_sides
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.segmentation.li_alone import above_li
from endoct.fusion.segmentation.side_cells import segment_side
from endoct.stitching.panorama import Panorama

COARSE = CompareParameters(n_theta=512)
ALONE = COARSE.model_copy(update={"outlines": False})
PLAIN = ALONE.model_copy(
    update={
        "contrast_floor_sigmas": 0.0,
        "contrast_cap": 50.0,
        "relief_floor_mm": -10.0,
        "relief_cap_mm": 10.0,
        "smooth_mm": 0.0,
        "open_mm": 0.0,
        "close_mm": 0.0,
        "smallest_mm2": 0.0,
    }
)


@pytest.mark.parametrize("bright", [False, True])
def test_it_is_what_both_sides_have_without_outlines(pair_of: Callable[..., Pair], bright: bool) -> None:
    pair = pair_of(bright_cells=bright)
    found, alone = (compare_panoramas(pair.a, pair.b, parameters).result for parameters in (COARSE, ALONE))
    assert found.polarity["camera"] == ("bright" if bright else "dark")
    assert (found.by_li.grid, found.by_li.own_rows) == (alone.scores.grid, alone.scores.own_rows)
    assert found.by_li == alone.by_li
    assert found.by_li.threshold == {name: alone.threshold[name].value for name in alone.sides}
    assert (found.by_li.grid == found.scores.grid) is bright  # only dark cells have outlines
    assert 0.5 < found.by_li.grid.jaccard < 1


def test_the_threshold_is_that_of_scikit_image(pair: Pair) -> None:
    result = compare_panoramas(pair.a, pair.b, PLAIN).result
    for side, kind, floor in zip(two_sides(pair.a, pair.b), ("darkness", "relief"), (0, -10), strict=True):
        assert side.evidence.kind == kind
        values = np.maximum(side.evidence.values[side.evidence.valid], floor)
        assert result.by_li.threshold[side.name] == pytest.approx(
            threshold_li(values), abs=float(np.ptp(values)) / 65536
        )


def test_where_there_is_nothing_to_threshold_there_is_none(panorama_of: Callable[..., Panorama], pair: Pair) -> None:
    drawn = DrawnMask(pair.a.grid, pair.cells_a, "anna", "1", pair.a)
    for one, other in ((pair.a, drawn), (drawn, pair.a)):
        result = compare_panoramas(one, other, COARSE).result
        assert result.aligned
        assert result.by_li is None
        assert result.to_json()["scores"]["by_li"] is None
    # a relief that is flat within its bounds, with cells that somebody found
    flat = replace(pair.b, depth_mm=np.zeros(pair.b.grid.shape, np.float32))
    sides = two_sides(pair.a, flat)
    cells = segment_side(sides[0], COARSE, "dark"), segment_side(two_sides(pair.a, pair.b)[1], COARSE, "dark")
    by_method = replace(cells[1], threshold=None, by="method")
    theirs = COARSE.model_copy(update={"segmentation_method": "theirs"})
    result = compare_placed(sides, (cells[0], by_method), pair.truth, theirs).result
    assert result.jaccard > 0.5
    assert result.by_li is None


def test_it_does_not_depend_on_whoever_found_the_cells(pair: Pair) -> None:
    sides = two_sides(pair.a, pair.b)
    ours = [segment_side(side, COARSE, "dark") for side in sides]
    theirs = [
        replace(cells, mask=np.zeros_like(cells.mask), threshold=None, polarity=None, by="method") for cells in ours
    ]
    by_method = COARSE.model_copy(update={"segmentation_method": "theirs"})
    usual = compare_placed(sides, (ours[0], ours[1]), pair.truth, COARSE).result
    empty = compare_placed(sides, (theirs[0], theirs[1]), pair.truth, by_method).result
    assert empty.jaccard is None
    assert empty.by_li == usual.by_li
    # and looks for bright cells where that is what was said
    bright = compare_placed(
        sides, (theirs[0], theirs[1]), pair.truth, by_method.model_copy(update={"polarity": "bright"})
    )
    assert bright.result.by_li.grid.jaccard < 0.1


def test_both_samplings_count_what_lies_there(panorama_of: Callable[..., Panorama]) -> None:
    """By hand: squares of depth, B turned by a quarter and 4 rows on, of which it lacks one column in six."""
    n, rows = 512, 4
    depth = np.zeros((40, n))
    depth[10:20, 100:200] = 0.5
    depth[5:12, 300:340] = 0.5
    smaller = depth.copy()
    smaller[10:20, 185:200] = 0
    a = panorama_of(np.ones(depth.shape), dz_mm=0.2, depth_mm=depth)
    b = panorama_of(np.ones((36, n)), dz_mm=0.2, depth_mm=np.roll(smaller, -128, axis=1)[rows:], modality="ranger")
    sides = two_sides(a, b)
    parameters = PLAIN.model_copy(update={"dz_mm": 0.2})
    cells = tuple(segment_side(side, parameters, "dark") for side in sides)
    nothing = tuple(replace(each, mask=np.zeros_like(each.mask), by="method") for each in cells)
    theirs = parameters.model_copy(update={"segmentation_method": "theirs"})
    of_li = compare_placed(sides, nothing, Alignment(np.pi / 2, 0.2 * rows), theirs).result.by_li
    for overlap in (of_li.grid, of_li.own_rows):
        assert overlap.jaccard == pytest.approx((850 + 280) / (1000 + 280), abs=0.002)
        assert overlap.only_b_mm2 == pytest.approx(0, abs=0.02)
    assert of_li.own_rows.rows_of == "ranger"


@pytest.mark.parametrize(("deep", "raised"), [(0.0, True), (0.3, False)])
def test_a_threshold_within_the_walls_own_relief_is_raised_and_said_to_be(
    panorama_of: Callable[..., Panorama], deep: float, raised: bool
) -> None:
    depth = np.random.default_rng(0).normal(0, 0.01, (40, 512))
    depth[10:20, 100:200] += deep
    (side, _) = two_sides(panorama_of(np.ones(depth.shape), dz_mm=0.05, depth_mm=depth), panorama_of(depth, dz_mm=0.05))
    parameters = COARSE.model_copy(update={"smooth_mm": 0.0})
    found = segment_side(side, parameters, "dark")
    assert ("raised to 4 times the spread" in found.of) is raised
    assert above_li(side.evidence, parameters).was_raised is raised
    assert found.mask.any() is np.bool_(not raised)
