"""The one wall of two sides: who is followed where, depths with their errors, and contradictions."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bore_pairs import Pair, make_pair
from numpy.typing import NDArray
from wall_sides import GRID, NAMES, ROWS_MM, disc, sides

from benchmarks.wall import FOREIGN, worsened
from benchmarks.wall_planted import contradictions_in, is_at, planted
from endoct.base.doubt import Doubt
from endoct.base.numeric.distance import signed_distance
from endoct.fusion.comparison import place_sides
from endoct.fusion.evidence.light_alone import depth_of_side
from endoct.fusion.evidence.network import Network, answers
from endoct.fusion.evidence.side import DrawnMask, two_sides
from endoct.fusion.parameters import CompareParameters
from endoct.fusion.scoring.overlap import jaccard
from endoct.fusion.wall.both_sides import both_sides_of, cell_features
from endoct.fusion.wall.cells import cells_of, contradictions_of, join, write_wall_cells
from endoct.fusion.wall.wall import (
    BY_BOTH,
    BY_DEPTH,
    BY_LIGHT,
    NOBODY,
    cells_from,
    depth_features,
    known_depth,
    wall_from,
)
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.store import load_panorama, save_panorama


def test_what_both_show_is_the_wall_over_the_seam_too() -> None:
    cell = disc(2.5, 0.05, 0.4)
    wall = wall_from(sides(cell, cell))
    assert jaccard(wall.cells, cell, np.ones(GRID.shape, np.bool_)) == pytest.approx(1, abs=0.03)
    assert wall.cells[:, 0].any()
    assert wall.cells[:, -1].any()
    assert (wall.decided[disc(2.5, 0.05, 0.3)] == BY_BOTH).all()
    assert np.median(wall.relief_mm[wall.cells]) == pytest.approx(0.3, abs=0.03)
    assert abs(np.median(wall.relief_mm[~wall.cells])) < 0.003
    assert np.median(wall.error_mm[~wall.cells]) == pytest.approx(0.004, rel=0.1)  # the noise of the plain wall


def test_where_everything_is_a_cell_no_plain_wall_is_measured() -> None:
    everywhere = np.ones(GRID.shape, np.bool_)
    wall = wall_from(sides(everywhere, everywhere))
    assert wall.cells.all()
    assert (wall.relief_mm > 0.1).all()
    assert np.isfinite(wall.error_mm).all()


@pytest.mark.parametrize(
    ("deep_mm", "log_error", "error_mm"),
    [(0.5, -3, 1.4), (1.0, -3, 1.4), (1.2, -3, 2.0), (1.4, -3, 2.6), (2.0, -3, 2.6), (0.5, -9, None), (0.5, 3, None)],
)
def test_the_error_of_a_depth_grows_beyond_the_reach_and_has_bounds(
    deep_mm: float, log_error: float, error_mm: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fixed(network: Network, features: NDArray[np.float32]) -> NDArray[np.float32]:
        n = features.shape[1]
        return answers(network, features) if network == "cell" else np.array([np.zeros(n), np.full(n, log_error)])

    monkeypatch.setattr("endoct.fusion.wall.wall.answers", fixed)
    cell = disc(2.5, 0.05, 0.4)
    given = sides(cell, cell)
    wall = wall_from(replace(given, relief_mm=np.where(cell, np.float32(deep_mm), given.relief_mm)))
    inner = disc(2.5, 0.05, 0.3)
    expected = error_mm * np.exp(log_error) if error_mm else 0.005 if log_error < 0 else 1.0
    np.testing.assert_allclose(wall.relief_mm[inner], deep_mm, rtol=1e-6)
    np.testing.assert_allclose(wall.error_mm[inner], expected, rtol=1e-5)


def test_rolling_both_sides_rolls_the_wall() -> None:
    light, depth = disc(2.0, 1.0, 0.4) | disc(3.0, 4.0, 0.2), disc(2.0, 1.1, 0.35)
    rolled = wall_from(sides(np.roll(light, 170, 1), np.roll(depth, 170, 1), np.zeros(GRID.shape)))
    plain = wall_from(sides(light, depth, np.zeros(GRID.shape)))
    same = np.roll(plain.cells, 170, 1)
    assert jaccard(rolled.cells, same, np.ones(GRID.shape, np.bool_)) == pytest.approx(1, abs=0.02)  # but for the noise


def test_a_floor_that_light_does_not_show_is_a_cell_by_depth() -> None:
    lit = disc(2.5, 3.0, 0.4)
    wall = wall_from(sides(np.zeros(GRID.shape, np.bool_), lit, probability=np.full(GRID.shape, 0.3, np.float32)))
    assert (wall.cells & lit).sum() > 0.8 * lit.sum()
    assert (wall.decided[wall.cells & lit] == BY_DEPTH).all()


def test_a_side_with_light_that_misses_and_invents_cells_is_not_followed() -> None:
    true = disc(1.8, 1.0, 0.35) | disc(2.8, 3.0, 0.3) | disc(3.2, 0.05, 0.35)
    light = disc(1.8, 1.0, 0.35) | disc(2.2, 4.5, 0.4) | disc(3.3, 5.2, 0.3)  # one right, two missed, two that are none
    wall = wall_from(sides(light, true))
    assert jaccard(wall.cells, true, np.ones(GRID.shape, np.bool_)) > 0.85


@pytest.mark.parametrize("seed", range(4))
def test_to_learn_from_an_endoscope_is_made_worse_in_patches_and_nothing_else_is(seed: int) -> None:
    none, seen = np.zeros(GRID.shape, np.bool_), np.broadcast_to(GRID.z_mm[:, None] < 3.5, GRID.shape)
    probability = np.full(GRID.shape, 0.1, np.float32)
    given = sides(none, disc(2.5, 0.05, 0.4), probability=probability, observed=(seen, ~none))
    narrower = SurfaceGrid.full_circle(100, 300, z0_mm=1.0, dz_mm=0.02, radius_mm=1.25)
    other = replace(
        given, grid=narrower, cells=(~none[:100, :300], none[:100, :300]), probability=1 - probability[:100, :300]
    )
    worse = worsened(given, other, np.random.default_rng(seed))
    foreign = worse.probability > 0.5
    assert FOREIGN[0] <= foreign.mean() <= FOREIGN[1]
    assert np.count_nonzero(foreign != np.roll(foreign, 1, 1)) < 0.02 * foreign.size  # patches, across the seam too
    assert np.array_equal(worse.cells[0], foreign & seen)
    assert np.array_equal(worse.cells[1], given.cells[1])
    assert np.array_equal(worse.relief_mm, given.relief_mm, equal_nan=True)


def test_an_outline_is_that_of_light_where_depth_shows_part_of_a_cell() -> None:
    whole, part = disc(2.5, 3.0, 0.25), disc(2.5, 3.0, 0.15)
    alike = disc(2.0, 0.05, 0.4) | disc(3.2, 5.0, 0.3)
    wall = wall_from(sides(whole | alike, part | alike))
    assert (wall.cells & whole).sum() > 0.7 * whole.sum()
    assert (wall.decided[wall.cells & whole & ~part] == BY_LIGHT).all()


def test_where_one_side_alone_saw_the_wall_its_cells_are_the_walls() -> None:
    light, depth = disc(1.5, 1.0, 0.3), disc(3.5, 1.0, 0.3)
    upper = np.broadcast_to(GRID.z_mm[:, None] < 2.5, GRID.shape)
    neither = np.broadcast_to(GRID.theta_rad > 5.5, GRID.shape)
    wall = wall_from(sides(light, depth, observed=(upper & ~neither, ~upper & ~neither)))
    assert np.array_equal(wall.cells, light | depth)
    assert (wall.decided[upper & ~neither] == BY_LIGHT).all()
    assert (wall.decided[~upper & ~neither] == BY_DEPTH).all()
    assert (wall.decided[neither] == NOBODY).all()
    assert np.isnan(wall.probability[neither]).all()
    assert not wall.observed[neither].any()
    assert np.isnan(wall.relief_mm[upper & ~light]).all()  # nobody measured the plain wall there


def test_depth_is_taken_by_parallax_where_none_was_measured() -> None:
    cell = disc(2.5, 3.0, 0.4)
    nowhere = np.full(GRID.shape, np.nan, np.float32)
    made = replace(
        sides(cell, np.zeros(GRID.shape, np.bool_)),
        observed=(np.ones(GRID.shape, np.bool_), np.zeros(GRID.shape, np.bool_)),
        relief_mm=nowhere,
        parallax_mm=np.where(cell, np.float32(0.4), np.float32(0)),
        parallax_error_mm=np.full(GRID.shape, 0.02, np.float32),
    )
    assert np.nanmedian(known_depth(made)[cell]) == pytest.approx(0.4)
    wall = wall_from(made)
    assert np.nanmedian(wall.relief_mm[wall.cells]) == pytest.approx(0.4, abs=0.1)
    assert (wall.error_mm[wall.cells & np.isfinite(wall.relief_mm)] >= 0.005).all()


def test_where_nobody_measured_a_cell_its_depth_is_that_by_light() -> None:
    lit, deep = disc(2.5, 3.0, 0.3), disc(1.5, 0.05, 0.2)
    upper = np.broadcast_to(GRID.z_mm[:, None] < 2.5, GRID.shape)
    given = sides(
        lit | deep,
        deep,
        np.where(upper, np.where(deep, 0.3, 0.0), np.nan),
        observed=(np.ones(GRID.shape, np.bool_), upper),
        light_mm=np.where(lit | deep, np.float32(0.7), np.float32(0.01)),
        light_error_mm=np.full(GRID.shape, 0.25, np.float32),
    )
    wall = wall_from(given)
    alone = wall.cells & ~upper
    assert alone.any()
    assert (wall.relief_mm[alone] == np.float32(0.7)).all()
    assert (wall.error_mm[alone] == np.float32(0.25)).all()
    for of, by_light in ((wall.relief_mm, 0.7), (wall.error_mm, 0.25)):
        assert (of[upper] != np.float32(by_light)).all(), "what was measured counts where it is known"
        assert np.isfinite(of[upper]).all()
        assert np.isnan(of[~upper & ~wall.cells]).all()


def test_a_sides_own_depth_is_by_all_that_light_shows_and_the_walls_network_gets_parallax(pair: Pair) -> None:
    told = pair.cells_a & np.broadcast_to(pair.a.grid.z_mm[:, None] > 2.0, pair.cells_a.shape)
    rng = np.random.default_rng(3)
    depth_mm = (np.where(told, 0.1, 0.0) + rng.normal(0, 0.004, told.shape)).astype(np.float32)
    depth_mm[:, 60:100] = np.nan
    error_mm = np.where(np.isfinite(depth_mm), np.float32(0.2), np.float32(np.nan))
    seen = replace(pair.a, parallax_depth_mm=depth_mm, parallax_error_mm=error_mm)
    placed = place_sides(*two_sides(seen, pair.b), CompareParameters())
    made, own = both_sides_of(placed), placed.sides[0]
    assert made is not None
    assert own.relief_mm is not None
    assert own.relief_error_mm is not None
    of_side = depth_of_side(placed.both[0], placed.cells[0].mask)
    for of, expected in zip((own.relief_mm, own.relief_error_mm), of_side, strict=True):
        placement = placed.samplings[0].onto(placed.grid)
        np.testing.assert_array_equal(of, placement.known(expected, np.isfinite(expected)))
    assert made.light_mm is own.relief_mm
    assert made.light_error_mm is own.relief_error_mm
    inner = signed_distance(own.mask, (placed.grid.dz_mm, placed.grid.dtheta_mm), 0.3) > 0.1
    assert np.isfinite(own.relief_mm[inner]).all(), "light shows where frames do not agree"
    assert np.isnan(made.parallax_mm[inner]).any()
    known = inner & np.isfinite(made.parallax_mm)
    assert np.nanmedian(made.parallax_mm[known]) == pytest.approx(0.1, abs=0.02)
    assert np.median(own.relief_mm[known]) > 0.2, "darkness says so"
    far = signed_distance(own.mask, (placed.grid.dz_mm, placed.grid.dtheta_mm), 0.3) < -0.1
    np.testing.assert_allclose(own.relief_mm[far], made.parallax_mm[far], atol=1e-6)
    np.testing.assert_allclose(own.relief_error_mm[far], made.parallax_error_mm[far], atol=1e-6)


def test_where_cells_are_bright_darkness_says_nothing_of_their_depth() -> None:
    bright = make_pair(bright_cells=True)
    depth_mm = np.where(bright.cells_a, np.float32(0.3), np.float32(0))
    seen = replace(bright.a, parallax_depth_mm=depth_mm, parallax_error_mm=np.full_like(depth_mm, 0.02))
    placed = place_sides(*two_sides(seen, bright.b), CompareParameters())
    assert placed.cells[0].polarity == "bright"
    own, made = placed.sides[0], both_sides_of(placed)
    assert made is not None
    np.testing.assert_array_equal(own.relief_mm, made.parallax_mm)
    nowhere = np.full_like(depth_mm, np.nan)
    unknown = replace(bright.a, parallax_depth_mm=nowhere, parallax_error_mm=nowhere)
    placed = place_sides(*two_sides(unknown, bright.b), CompareParameters())
    assert (placed.sides[0].relief_mm, placed.sides[0].relief_error_mm) == (None, None)


@pytest.mark.parametrize(("beyond_mm", "scale"), [(0.1, 1.4), (0.9, 2.0), (1.3, 2.6)])
def test_probabilities_bound_cells_at_a_half_and_errors_are_lengths(
    beyond_mm: float, scale: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell = disc(2.5, 3.0, 0.4)

    def answered(network: str, features: NDArray[np.float32]) -> NDArray[np.float32]:
        odds = np.full((1, features.shape[1]), np.log(0.6 / 0.4), np.float32)  # a cell, by six to four
        return (
            odds if network == "cell" else np.vstack([0 * odds + beyond_mm, 0 * odds + np.log(0.05)]).astype(np.float32)
        )

    monkeypatch.setattr("endoct.fusion.wall.wall.answers", answered)
    monkeypatch.setattr("endoct.fusion.wall.wall.AT_ONCE", 97)
    wall = wall_from(sides(cell, cell))
    assert (wall.cells >= cell).all()
    assert np.median(wall.relief_mm[cell]) == pytest.approx(0.3 + beyond_mm, abs=0.01)  # beyond what was measured
    assert np.median(wall.error_mm[cell]) == pytest.approx(scale * 0.05, rel=0.02)


def test_cells_of_under_a_hundredth_of_a_square_millimetre_are_none(monkeypatch: pytest.MonkeyPatch) -> None:
    kept, lost = disc(2.0, 1.0, 0.06), disc(3.0, 4.0, 0.053)  # 0.0113 and 0.0088 mm²
    sample_mm2 = GRID.dz_mm * GRID.dtheta_mm
    assert lost.sum() * sample_mm2 < 0.0098
    assert 0.0102 < kept.sum() * sample_mm2 < 0.0125

    monkeypatch.setattr("endoct.fusion.wall.wall.answers", lambda _, features: 99 * features[:1])  # cells of light
    probability, cells = cells_from(sides(kept | lost, np.zeros(GRID.shape, np.bool_)))
    assert np.array_equal(cells, kept)
    assert np.array_equal(probability > 0.5, kept | lost)


def test_shares_of_all_cells_are_of_what_both_sides_observed() -> None:
    both, light, depth = disc(2.5, 0.05, 0.3), disc(1.8, 3.0, 0.3), disc(3.2, 3.0, 0.2)
    everywhere, nowhere = np.ones(GRID.shape, np.bool_), np.zeros(GRID.shape, np.bool_)
    of_depth, of_light = (float(both.sum() / (both | other).sum()) for other in (depth, light))
    for given, shares in (
        (sides(both | light, both | depth), (of_depth, of_light)),
        (sides(both | light, both | depth, observed=(~depth, everywhere)), (1, of_light)),
        (sides(both | light, both | depth, observed=(everywhere, ~light)), (of_depth, 1)),
        (sides(both, nowhere), (1, 0)),
        (sides(nowhere, both), (0, 1)),
    ):
        of_all = cell_features(given)[1][6:]
        assert of_all.min(axis=1) == pytest.approx(shares)
        assert of_all.max(axis=1) == pytest.approx(shares)


def test_features_are_those_that_the_networks_were_trained_on() -> None:
    cell, other = disc(2.5, 3.0, 0.4), disc(2.5, 3.0, 0.2)
    made = sides(cell, other)
    near, features = cell_features(made)
    assert features.shape == (8, near.sum())
    assert (near >= disc(2.5, 3.0, 0.68)).all()
    assert not (near & ~disc(2.5, 3.0, 0.72)).any()  # 0.3 mm around it
    middle_row, middle_column = 75, np.argmin(np.abs(GRID.theta_rad - 3.0))
    middle = features[:, near[: middle_row + 1].sum() - near[middle_row, middle_column:].sum()]
    assert middle[0] == pytest.approx(0.3)  # capped
    assert middle[1] == pytest.approx(0.2, abs=0.03)
    assert middle[2] == pytest.approx(np.log(0.99 / 0.03), abs=1e-3)
    assert middle[3] == pytest.approx(0.3, abs=0.02)
    assert middle[4] == 1  # light covers all of depth's cell
    assert middle[5] == pytest.approx(0.25, abs=0.03)  # of light's cell depth covers a quarter
    assert features[4:6, 0].tolist() == [1, 1]  # far from both
    assert (features[6] == 1).all()
    assert features[7] == pytest.approx(middle[5], abs=0.03)  # there is no other cell
    of_depth = depth_features(made, other)(np.flatnonzero(other))
    assert of_depth.shape == (24, other.sum())
    assert of_depth[0] == pytest.approx(made.relief_mm[other])
    assert of_depth[1].min() > 0
    assert of_depth[1].max() == pytest.approx(0.2, abs=0.03)
    assert of_depth[2].max() == pytest.approx(0.1, abs=1e-6)  # rows lie 0.2 mm apart
    assert (of_depth[[3, 4, 6]] == 0).all()  # no parallax
    assert (of_depth[5] == 1).all()
    assert of_depth[7] == pytest.approx(1)
    nearer, farther = of_depth[12:18], of_depth[18:]
    on_row = of_depth[2] < 0.001
    assert nearer[0, on_row] == pytest.approx(of_depth[0, on_row])
    assert (nearer[1, on_row] == 1).all()
    assert set(nearer[1]) == {0, 1}
    assert nearer[3, on_row] == pytest.approx(0.3, abs=0.006)
    assert np.median(nearer[4, on_row]) == pytest.approx(0.004, rel=0.4)  # its noise
    assert farther[1].mean() < nearer[1].mean()  # the farther row often lies beyond the cell
    median_mm, high_mm, is_known, radius_mm = of_depth[8:12]
    assert median_mm == pytest.approx(0.3, abs=0.002)
    assert 0.303 < high_mm[0] < 0.308  # the ninth decile of noise of 4 µm
    assert (is_known == 1).all()
    assert radius_mm == pytest.approx(0.2, abs=0.005)


def test_what_lies_around_a_sample_counts_over_the_seam_and_beyond_what_is_not_known() -> None:
    cell = disc(2.5, 0.0, 0.3)
    made = sides(cell, cell)
    row, column = np.indices(GRID.shape)
    known = (row + column) % 2 == 0  # every second sample
    parallax_mm = np.where(known, np.where(column < GRID.n_theta // 2, 0.2, 0.6), np.nan).astype(np.float32)
    brightness = np.where(np.arange(GRID.n_theta) < GRID.n_theta // 2, np.float32(2), np.float32(-4))
    rows = replace(made.rows, brightness=np.broadcast_to(brightness, made.rows.relief_mm.shape))
    made = replace(made, parallax_mm=parallax_mm, parallax_error_mm=np.full(GRID.shape, 0.15, np.float32), rows=rows)
    features = depth_features(made, cell)(np.flatnonzero(cell))
    at_row, at_column = np.nonzero(cell)
    middle = np.abs(at_row - 75) < 4
    beside_seam, inside = middle & (at_column % (GRID.n_theta - 1) == 0), middle & (at_column == 20)
    assert features[4] == pytest.approx(0.25)  # the trust in parallax: 0.05 mm over that and its error
    assert features[6, beside_seam].mean() == pytest.approx(0.4, abs=0.01)
    assert features[6, inside] == pytest.approx(0.2, abs=0.01)
    assert features[17, beside_seam].mean() == pytest.approx(-1, abs=0.05)
    wider = replace(made, grid=replace(GRID, radius_mm=2.5))
    features = depth_features(wider, cell)(np.flatnonzero(cell))
    one_sigma = middle & (at_column == 1)  # 0.06 mm from the seam, of 0.2 and 0.6 on either side of it
    assert features[6, one_sigma] == pytest.approx(0.4 - 0.2 * 0.68, abs=0.01)
    assert features[17, inside] == pytest.approx(2, abs=0.01)


def test_rows_that_lie_far_off_say_nothing_of_a_sample() -> None:
    whole = np.ones(GRID.shape, np.bool_)  # a cell up to either end
    made = sides(whole, whole)
    assert (depth_features(made, whole)(np.arange(3))[8:] != 0).any(axis=1).sum() > 8
    off = replace(made, rows=replace(made.rows, z_mm=made.rows.z_mm + 9))
    features = depth_features(off, whole)(np.flatnonzero(whole))
    assert features[2] == pytest.approx(0.3)  # as far as it counts
    assert (features[8:11] == 0).all()
    assert (features[12:] == 0).all()


def test_a_sample_is_answered_alike_among_many() -> None:
    rng = np.random.default_rng(0)
    features = rng.normal(0, 0.3, (8, 70_000)).astype(np.float32)
    together = answers("cell", features)
    assert together.shape == (1, 70_000)
    assert together.min() < 0 < together.max()
    assert answers("cell", features[:, 65_530:65_540]) == pytest.approx(together[:, 65_530:65_540], abs=1e-4)
    assert answers("depth", np.zeros((24, 3), np.float32)).shape == (2, 3)


def test_cells_have_area_volume_and_errors(tmp_path: Path) -> None:
    cell = disc(2.5, 0.0, 0.4)
    wall = replace(
        wall_from(sides(cell, cell)),
        cells=cell,
        probability=np.where(cell, np.float32(0.9), np.float32(0.1)),
        relief_mm=np.where(cell, np.float32(0.3), np.float32(0)),
        error_mm=np.full(GRID.shape, 0.02, np.float32),
    )
    (found,) = cells_of(wall)
    area_mm2 = np.pi * 0.4**2
    assert found.area_mm2 == pytest.approx(area_mm2, rel=0.02)
    assert found.area_error_mm2 == 0
    assert min(found.theta_rad, 2 * np.pi - found.theta_rad) < 0.02
    assert found.z_mm == pytest.approx(2.5, abs=0.011)
    assert (found.mean_depth_mm, found.greatest_depth_mm) == pytest.approx((0.3, 0.3))
    assert found.volume_mm3 == pytest.approx(0.3 * area_mm2, rel=0.02)
    assert found.volume_error_mm3 == pytest.approx(0.02 * area_mm2, rel=0.02)
    unsure = replace(wall, probability=np.where(disc(2.5, 0.0, 0.2), 0.9, 0.6).astype(np.float32))
    assert cells_of(unsure)[0].area_error_mm2 == pytest.approx(0.75 * area_mm2, rel=0.04)
    wide_mm2 = 0.75 * area_mm2
    assert cells_of(unsure)[0].volume_error_mm3 == pytest.approx(np.hypot(0.02 * area_mm2, 0.3 * wide_mm2), rel=0.04)
    write_wall_cells([found, replace(found, id=2, mean_depth_mm=float("nan"))], tmp_path / "cells.csv")
    rows = list(csv.DictReader((tmp_path / "cells.csv").read_text("utf-8").splitlines()))
    assert [row["id"] for row in rows] == ["1", "2"]
    assert float(rows[0]["mean_depth_mm"]) == pytest.approx(0.3)
    assert rows[1]["mean_depth_mm"] == ""


def test_what_both_are_sure_of_and_disagree_about_is_found() -> None:
    stain, fluid, doubtful = disc(1.5, 0.0, 0.25), disc(2.5, 2.0, 0.3), disc(3.5, 4.0, 0.3)
    probability = np.where(stain, 0.98, np.where(doubtful, 0.6, 0.02)).astype(np.float32)
    made = sides(stain | doubtful, fluid, probability=probability)
    first, second = contradictions_of(made, NAMES)
    assert (first.shown_by, second.shown_by) == ("oct", "endoscope")
    assert first.relief_mm == pytest.approx(0.3, abs=0.01)
    assert first.probability == pytest.approx(0.02)
    assert second.relief_mm == pytest.approx(0.0, abs=0.002)
    assert second.area_mm2 == pytest.approx(np.pi * 0.25**2, rel=0.05)
    assert min(second.theta_rad, 2 * np.pi - second.theta_rad) < 0.02
    assert first.z_mm == pytest.approx(2.5, abs=0.011)
    both_see = sides(stain | fluid, stain | fluid)
    assert contradictions_of(both_see, NAMES) == ()
    far = replace(made, rows=replace(made.rows, z_mm=ROWS_MM[5:20] + 5.0))
    assert contradictions_of(far, NAMES) == ()  # no measured row speaks of them


def test_contradictions_planted_into_a_pair_are_found_where_they_are(pair: Pair) -> None:
    plain = place_sides(*two_sides(pair.a, pair.b), CompareParameters())
    a, b, plants = planted(pair.a, pair.b, plain, 0)
    kinds = ["fluid", "painted", "shadow", "stain"]
    assert sorted(plant.kind for plant in plants) == kinds
    for placed, there in ((plain, []), (place_sides(*two_sides(a, b), CompareParameters()), kinds)):
        light, depth = placed.cells
        sure = replace(light, probability=np.where(light.mask, 0.98, 0.02).astype(np.float32))  # this pair has no eye
        found = contradictions_in(replace(placed, cells=(sure, depth)))
        of = [[plant.kind for plant in plants if is_at(plant, each, pair.a.grid.radius_mm)] for each in found]
        assert sorted(kind for one in of for kind in one) == there
        assert [] not in of


def test_a_pair_has_a_wall_and_neither_side_is_changed_by_it(pair: Pair, tmp_path: Path) -> None:
    placed = place_sides(*two_sides(pair.a, pair.b), CompareParameters())
    before = [(side.mask.copy(), cells.mask.copy()) for side, cells in zip(placed.sides, placed.cells, strict=True)]
    joined = join(placed)
    assert joined is not None
    for (on_grid, own), side, cells in zip(before, placed.sides, placed.cells, strict=True):
        assert np.array_equal(side.mask, on_grid)
        assert np.array_equal(cells.mask, own)
    assert joined.doubts == ()
    assert joined.summary.cells == len(joined.cells) > 5
    assert joined.summary.area_mm2 == pytest.approx(sum(cell.area_mm2 for cell in joined.cells))
    save_panorama(joined.wall.as_panorama(placed), tmp_path / "wall.zarr")
    read = load_panorama(tmp_path / "wall.zarr")
    assert (read.modality, read.frame_dim, read.depth_mm is None) == ("wall", "row", False)
    assert read.per_frame["cell_probability"].values.shape == read.grid.shape
    known = np.isfinite(joined.wall.relief_mm)
    assert np.array_equal(read.valid, known)
    assert np.array_equal(read.depth_mm[known], joined.wall.relief_mm[known])  # type: ignore[index]


def test_what_was_measured_lies_on_the_rows_it_was_measured_on(pair: Pair) -> None:
    placed = place_sides(*two_sides(pair.a, pair.b), CompareParameters())
    made = both_sides_of(placed)
    assert made is not None
    depth, rows, where = placed.both[1], made.rows, placed.samplings[1].where
    assert np.nanmedian(made.darkness[made.cells[0]]) > np.nanmedian(made.darkness[~made.cells[0]]) + 0.2
    assert rows.z_mm == pytest.approx(where.z_to_a(depth.panorama.z_mm))
    columns = np.rint(placed.grid.column_of(where.theta_to_a(depth.panorama.grid.theta_rad))).astype(int)
    columns %= placed.grid.n_theta
    assert np.nanmedian(np.abs(rows.relief_mm[:, columns] - depth.relief.values)) < 0.005  # type: ignore[union-attr]
    own = placed.cells[1].mask
    assert rows.cells[:, columns][own].mean() > 0.95
    assert rows.cells[:, columns][~own].mean() < 0.05
    light = depth.panorama.intensity
    sigma = 1.4826 * np.median(np.abs(light[~own] - np.median(light[~own])))
    expected = np.clip((light - np.median(light[~own])) / sigma, -8, 4)
    assert np.median(np.abs(rows.brightness[:, columns] - expected)) < 0.5  # columns lie up to half of one aside
    assert np.corrcoef(rows.brightness[:, columns].ravel(), expected.ravel())[0, 1] > 0.7
    nearer, farther = rows.neighbours(rows.z_mm[3:6] + np.array([0.0, 0.04, 0.16]))
    assert (nearer.tolist(), farther.tolist()) == ([3, 4, 6], [2, 5, 5])


def test_no_wall_is_made_of_sides_that_do_not_complement_each_other(pair: Pair) -> None:
    parameters = CompareParameters()
    placed = place_sides(*two_sides(pair.a, pair.b), parameters)
    assert both_sides_of(placed) is not None
    assert join(replace(placed, outcome=replace(placed.outcome, alignment=None))) is None
    for alone in (pair.a, pair.b):
        assert join(place_sides(*two_sides(alone, alone), parameters)) is None
    drawn = DrawnMask(pair.a.grid, pair.cells_a, "me", "1", pair.a)
    assert join(place_sides(*two_sides(drawn, pair.a), parameters)) is None


def test_a_drawn_mask_takes_the_place_of_the_side_with_light(pair: Pair, monkeypatch: pytest.MonkeyPatch) -> None:
    doubt = Doubt("cells-end-short", "They do.", "camera")
    monkeypatch.setattr("endoct.fusion.wall.cells.doubt_of_short_ends", lambda *_: doubt)
    drawn = DrawnMask(pair.a.grid, pair.cells_a, "me", "1", pair.a)
    placed = place_sides(*two_sides(drawn, pair.b), CompareParameters())
    joined = join(placed)
    assert joined is not None
    assert joined.doubts == ()  # a drawing does not miss what is lit
    both = placed.sides[0].valid & placed.sides[1].valid
    assert jaccard(joined.wall.cells & both, placed.sides[0].mask & both, both) > 0.95  # type: ignore[operator]
    panorama = joined.wall.as_panorama(placed)
    assert (panorama.intensity == 1).all()
    of_camera = join(place_sides(*two_sides(pair.a, pair.b), CompareParameters()))
    assert of_camera is not None
    assert of_camera.doubts == (doubt,)
