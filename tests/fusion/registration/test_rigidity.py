"""Parts of a wall that do not lie where a rigid alignment puts them."""

from dataclasses import replace

import numpy as np
import pytest
from bore_pairs import Pair, make_pair, panorama

from endoct.fusion.evidence.evidence import Evidence, prepare
from endoct.fusion.geometry.alignment import Bend
from endoct.fusion.geometry.placement import IN_PLACE
from endoct.fusion.registration.rigidity import NEAR, STEP_MM, LoosePart, fit_part, part_of, parts_out_of_place
from endoct.stitching.panorama import Panorama

ROWS, ROW_MM, TURN_RAD = 45, 0.2, 0.3


def out_of_place(pair: Pair, b: Panorama | None = None) -> tuple[LoosePart, ...]:
    return parts_out_of_place(prepare(pair.a), prepare(b or pair.b), pair.truth)


def rearranged(b: Panorama, rows: np.ndarray) -> Panorama:
    """``b`` with its rows in another order, or some of them twice."""
    assert b.depth_mm is not None
    return replace(b, intensity=b.intensity[rows], depth_mm=b.depth_mm[rows])


def turned(b: Panorama, where: tuple[slice, slice], turn_rad: float = TURN_RAD) -> Panorama:
    """``b`` whose part ``where`` is that which lies ``turn_rad`` before it."""
    assert b.depth_mm is not None
    columns = round(turn_rad / b.grid.dtheta_rad)
    images = [image.copy() for image in (b.intensity, b.depth_mm)]
    for image in images:
        image[where] = np.roll(image, columns, axis=1)[where]
    return replace(b, intensity=images[0], depth_mm=images[1])


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    "way", [{}, {"mirrored": True}, {"z_reversed": True}, {"mirrored": True, "z_reversed": True, "z_scale": 1.02}]
)
def test_a_rigid_wall_lies_as_one_piece(seed: int, way: dict) -> None:
    assert out_of_place(make_pair(seed, rows=ROWS, **way)) == ()


def test_a_recording_that_turned_on_its_way_is_out_of_place_from_there() -> None:
    pair = make_pair(rows=ROWS)
    worst = out_of_place(pair, turned(pair.b, (slice(ROWS // 2, None), slice(None))))[0]
    assert worst.kind == "band"
    assert worst.around_mm == pytest.approx(-TURN_RAD * pair.a.grid.radius_mm, abs=0.05)
    assert abs(worst.along_mm) < 0.1


def test_a_step_within_every_turn_shows_in_sectors() -> None:
    pair = make_pair(rows=ROWS)
    half = pair.b.grid.n_theta // 2
    parts = out_of_place(pair, turned(pair.b, (slice(None), slice(half, None))))
    sectors = [part for part in parts if part.kind == "sector"]
    assert sectors
    assert sectors[0].around_mm == pytest.approx(-TURN_RAD * pair.a.grid.radius_mm, abs=0.05)


@pytest.mark.parametrize(("step_rad", "seen"), [(0.03, False), (0.15, True), (-0.2, True)])
def test_a_small_step_shows_where_directions_are_held_against_each_other(step_rad: float, seen: bool) -> None:
    pair = make_pair(rows=ROWS)
    half = pair.b.grid.n_theta // 2
    # aligned halfway between both parts, as the best rigid place is
    aligned = replace(pair.truth, theta_shift_rad=pair.truth.theta_shift_rad - step_rad / 2)
    stepped = turned(pair.b, (slice(None), slice(half, None)), step_rad)
    parts = parts_out_of_place(prepare(pair.a), prepare(stepped), aligned)
    assert bool(parts) == seen
    if seen:
        (turn,) = (part for part in parts if part.kind == "turn")
        # sectors that lie across the step, two of eight, lie anywhere between
        assert 0.6 < abs(turn.around_mm) / (abs(step_rad) * pair.a.grid.radius_mm) < 1.1
        assert turn.along_mm == 0
        assert turn.off_mm > turn.limit_mm


def test_arcs_that_lie_apart_in_one_half_of_the_bore_only_are_no_step_of_every_turn() -> None:
    pair = make_pair(rows=ROWS)
    half = pair.b.grid.n_theta // 2
    aligned = replace(pair.truth, theta_shift_rad=pair.truth.theta_shift_rad - 0.1)
    for rows, seen in ((slice(None), True), (slice(ROWS // 2, None), False)):
        stepped = turned(pair.b, (rows, slice(half, None)), 0.2)
        parts = parts_out_of_place(prepare(pair.a), prepare(stepped), aligned)
        assert any(part.kind == "turn" for part in parts) == seen


@pytest.mark.parametrize("seed", range(3))
def test_two_slices_that_changed_places_are_found_by_each_other(seed: int) -> None:
    pair = make_pair(seed, rows=ROWS)
    rows = np.arange(ROWS)
    rows[[8, 9, 24, 25]] = [24, 25, 8, 9]
    parts = out_of_place(pair, rearranged(pair.b, rows))
    assert {round(part.along_mm / (16 * ROW_MM)) for part in parts} == {-1, 1}
    assert all(abs(part.along_mm) == pytest.approx(16 * ROW_MM, abs=0.16) for part in parts)


def test_lost_slices_shift_what_follows() -> None:
    pair = make_pair(rows=ROWS)
    rows = np.r_[0:20, 24:ROWS, [ROWS - 1] * 4]
    worst = out_of_place(pair, rearranged(pair.b, rows))[0]
    assert worst.along_mm == pytest.approx(4 * ROW_MM, abs=0.1)


def test_swapped_slices_are_found_where_they_belong() -> None:
    pair = make_pair(rows=ROWS)
    rows = np.r_[0:10, 25:30, 15:25, 10:15, 30:ROWS]
    parts = out_of_place(pair, rearranged(pair.b, rows))
    assert {round(part.along_mm / (15 * ROW_MM)) for part in parts} == {-1, 1}


def partly_lit(cells: int, moved_mm: float, *, lit: bool, seed: int) -> tuple[Panorama, Panorama]:
    """Two sides of a bore of ``cells``, one over the seam; B's lie ``moved_mm`` on. ``lit``: A misses a part."""
    rng = np.random.default_rng(seed)
    z_mm, theta = 0.05 * np.arange(180), 2 * np.pi / 512 * np.arange(512)
    middles = np.array([[4.5, 0.0], [4.3, 2.2], [4.8, 4.4]])[:cells]

    def relief(on_mm: float, half: bool) -> np.ndarray:
        depth = np.zeros((z_mm.size, theta.size))
        for z, turn in middles:
            across = 1.25 * np.mod(theta - turn + np.pi, 2 * np.pi) - 1.25 * np.pi
            inside = np.hypot((z_mm - z - on_mm)[:, None], across) < 0.6
            depth[inside & ((z_mm > z - 0.2)[:, None] | (not half))] = 0.5
        return depth

    dark = np.exp(-relief(0.0, lit) / 0.4 + 0.4 * rng.normal(size=(180, 512)))
    deep = relief(moved_mm, half=False) + 0.01 * rng.normal(size=dark.shape)
    valid = np.ones(dark.shape, np.bool_)
    valid[60:70, 480:] = False
    return panorama(dark, dz_mm=0.05, valid=valid), panorama(np.ones(deep.shape), dz_mm=0.05, depth_mm=deep)


@pytest.mark.parametrize(
    ("cells", "moved_mm", "lit", "found"),
    [(1, 0.0, True, False), (1, 0.4, False, True), (3, 0.4, False, True), (3, 0.0, False, False)],
)
def test_a_single_cell_must_fit_elsewhere_more_clearly_than_several(
    cells: int, moved_mm: float, lit: bool, found: bool
) -> None:
    """Where light reaches a third of its floor, a cell fits somewhat farther on better than in its place."""
    a, b = partly_lit(cells, moved_mm, lit=lit, seed=1)
    assert bool(parts_out_of_place(prepare(a), prepare(b), IN_PLACE)) == found


def test_light_in_a_part_of_one_cell_would_pass_for_a_part_out_of_place(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("endoct.fusion.registration.rigidity.LONE_CLEAR", NEAR.clear)
    a, b = partly_lit(1, 0.0, lit=True, seed=0)
    assert parts_out_of_place(prepare(a), prepare(b), IN_PLACE)


@pytest.mark.parametrize(("rows", "columns"), [(0, 0.0), (3, 0.4), (-2, -5.3), (4, 6.0)])
def test_a_part_is_found_to_a_fraction_of_a_column(rows: int, columns: float) -> None:
    """A wave pattern that is moved by hand, and a band of it."""
    n_z, n_theta, radius_mm = 60, 256, 1.2
    z, theta = np.arange(n_z)[:, None], 2 * np.pi / n_theta * np.arange(n_theta)

    def wall(along: float, around: float) -> Evidence:
        turned = theta - around * 2 * np.pi / n_theta
        values = np.cos(5 * turned + 0.21 * (z - along)) + np.cos(3 * turned - 0.37 * (z - along))
        z_mm = STEP_MM * np.arange(n_z)
        return Evidence(values.astype(np.float32), values < 9, z_mm, STEP_MM, 0.0, radius_mm, "darkness")

    band = part_of(wall(-rows, -columns), (z > 20) & (z < 40) & (theta < 9))
    found = fit_part(wall(0, 0), band, 6 * STEP_MM, 10 * 2 * np.pi / n_theta)
    assert found.along_mm == pytest.approx(rows * STEP_MM, abs=1e-9)
    assert found.around_mm == pytest.approx(columns * 2 * np.pi / n_theta * radius_mm, abs=0.05 * STEP_MM)
    assert found.correlation[0] == pytest.approx(1, abs=2e-3)
    assert (found.correlation[1] == found.correlation[0]) is (rows == 0)


@pytest.mark.parametrize("way", [{}, {"mirrored": True}, {"z_reversed": True, "mirrored": True}])
def test_what_a_bend_follows_is_in_place(way: dict) -> None:
    pair = make_pair(rows=ROWS, **way)
    b = turned(pair.b, (slice(ROWS // 2, None), slice(None)))
    half_mm = float(pair.truth.z_to_a(ROW_MM * (ROWS / 2 - 0.5)))
    roll_rad = -TURN_RAD * (-1 if pair.truth.mirrored else 1)
    rolls = (roll_rad, 0.0) if pair.truth.z_reversed else (0.0, roll_rad)
    bend = Bend((half_mm - 0.01, half_mm + 0.01), (0.0, 0.0), rolls, (0.0, 0.0), (0.0, 0.0))
    sides = prepare(pair.a), prepare(b)
    assert parts_out_of_place(*sides, pair.truth)
    assert parts_out_of_place(*sides, replace(pair.truth, bend=bend)) == ()
