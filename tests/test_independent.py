"""The independent generator and its judge: held against Fermat's principle, closed forms and trivial unrolling."""

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize
from tolerances import (
    COORDINATE_ATOL,
    INDEPENDENT_LOSS,
    INDEPENDENT_PATH_MM,
    INDEPENDENT_PLACE_MM,
    INDEPENDENT_PLACE_RAD,
    INDEPENDENT_PLACE_SCALE,
    INDEPENDENT_SEEN,
)

from benchmarks import independent
from benchmarks.independent import BoreRecipe, CatheterRecipe, MirrorRecipe, Recipe, make_pair, write_pair
from benchmarks.independent.bore import Bore, drill
from benchmarks.independent.catheter import beam_paths, pull_back
from benchmarks.independent.judge import (
    Wall,
    against_truth,
    jaccard,
    loss_of_alignment,
    measured_place,
    misplaced,
    pair_jaccard,
    true_cells,
    wrong_share,
)
from benchmarks.independent.mirror import focal_px, look, seen_at, wall_brightness, wall_z_mm
from benchmarks.independent.ours import endoct_oct
from benchmarks.independent.pair import write_pullback
from benchmarks.independent.run import scores
from benchmarks.independent.sets import SETS, recipe_of
from benchmarks.independent.simplest import simplest_answer
from benchmarks.independent.truth import Place, between, oct_place

FOLDER = Path(independent.__file__).parent
SMALL = CatheterRecipe(slices=16, pitch_mm=0.1, a_scans=240, depths=320, start_mm=1.0)
PROBE = MirrorRecipe(size_px=240, outer_px=105.0, length_mm=1.4, start_mm=0.8)
SHORT = BoreRecipe(length_mm=4.0, cells=8, cells_mm=(0.9, 2.6), size_mm=(0.3, 0.8), depth_mm=(0.3, 0.9))


@pytest.fixture(scope="module")
def bore() -> Bore:
    return drill(replace(SHORT, cells=12), np.random.default_rng(5))


def test_shares_nothing_with_the_simulator_or_a_plugin():
    of_fusion = {"evidence.side", "segmentation.parameters", "segmentation.segment", "segmentation.side_cells", "sides"}
    ours = {"endoct.workbench", *(f"endoct.fusion.{name}" for name in of_fusion)}
    allowed = {"ours.py": ours, "run.py": {"endoct.base.errors"}}
    for path in FOLDER.glob("*.py"):
        names = set()
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.ImportFrom):
                names.add(node.module or "")
            elif isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
        assert {n for n in names if n.split(".")[0] == "endoct"} <= allowed.get(path.name, set()), path.name


def test_one_seed_one_pair_and_another_seed_another():
    recipe = Recipe(SHORT, replace(SMALL, slices=3), PROBE)
    first, second, other = make_pair(recipe, 3), make_pair(recipe, 3), make_pair(recipe, 4)
    assert np.array_equal(first.oct.samples, second.oct.samples)
    assert np.array_equal(first.endoscope.frames, second.endoscope.frames)
    assert not np.array_equal(first.oct.samples, other.oct.samples)
    assert not np.array_equal(first.bore.level, other.bore.level)


@pytest.mark.parametrize("name", SETS)
def test_every_set_draws_recipes_that_differ(name: str):
    drawn = [recipe_of(name, seed) for seed in range(20)]
    assert drawn[0] == recipe_of(name, 0)
    assert len({repr(one) for one in drawn}) == 20


@pytest.mark.parametrize("offset", [(0.0, 0.0), (0.21, 0.0), (-0.1, 0.16)])
def test_beams_take_the_shortest_optical_path_through_the_glass(offset: tuple[float, float]):
    angle = np.linspace(0, 2 * np.pi, 9)
    start = np.array(offset)
    to_inner, to_outer, place, way = beam_paths(SMALL, angle, start)
    outer = SMALL.capillary_outer_mm / 2
    inner, beyond = outer - SMALL.glass_mm, 0.5
    for k in range(angle.size):
        end = place[k] + beyond * way[k]

        def length(crossings: np.ndarray, end: np.ndarray = end) -> float:
            a = inner * np.array([np.cos(crossings[0]), np.sin(crossings[0])])
            b = outer * np.array([np.cos(crossings[1]), np.sin(crossings[1])])
            return float(np.hypot(*(a - start)) + SMALL.glass_index * np.hypot(*(b - a)) + np.hypot(*(end - b)))

        first = start + to_inner[k] * np.array([np.cos(angle[k]), np.sin(angle[k])])
        guess = [np.arctan2(first[1], first[0]), np.arctan2(place[k, 1], place[k, 0])]
        # from a little beside, so that finding it is no matter of the guess
        shortest = minimize(
            length, np.array(guess) + 0.03, method="Nelder-Mead", options={"xatol": 1e-8, "fatol": 1e-12}
        )
        assert shortest.fun == pytest.approx(to_outer[k] + beyond, abs=INDEPENDENT_PATH_MM)
        assert np.hypot(*place[k]) == pytest.approx(outer, abs=COORDINATE_ATOL)


@pytest.mark.parametrize(("half_angle_deg", "distance_mm"), [(36.0, 30.0), (45.0, 5.0), (45.0, 1.1), (53.0, 2.0)])
def test_the_mirror_obeys_fermat_and_the_closed_form(half_angle_deg: float, distance_mm: float):
    recipe = replace(PROBE, half_angle_deg=half_angle_deg, distance_mm=distance_mm)
    focal, radius, half = focal_px(recipe), 1.25, np.deg2rad(half_angle_deg)
    in_image = np.linspace(30, 105, 6)
    z = wall_z_mm(recipe, radius, focal, in_image)
    psi = np.arctan(in_image / focal)
    closed = -distance_mm * np.cos(2 * half) + (radius + distance_mm * np.sin(2 * half)) / np.tan(2 * half - psi)
    assert z == pytest.approx(closed, abs=COORDINATE_ATOL)
    for k, target in enumerate(z):

        def length(along: np.ndarray, target: float = target) -> float:
            rho, depth = along[0] * np.tan(half), along[0]
            return float(np.hypot(rho, depth + distance_mm) + np.hypot(radius - rho, target - depth))

        found = minimize(length, [0.3], method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-13}).x[0]
        seen = focal * found * np.tan(half) / (found + distance_mm)
        assert seen == pytest.approx(in_image[k], abs=0.02)  # px; a minimum is found to the root of its precision


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("states_handedness", [False, True])
def test_true_cells_lie_where_a_centred_pullback_has_no_wall(mirrored: bool, states_handedness: bool):
    recipe = replace(SMALL, offset_mm=0.0, mirrored=mirrored, states_handedness=states_handedness, signal_db=30)
    pair = make_pair(Recipe(SHORT, recipe, PROBE), 11)
    wall_at = pair.bore.radius_mm + (recipe.glass_index - 1) * recipe.glass_mm
    row = round((wall_at - recipe.first_sample_mm) / recipe.axial_pixel_mm)
    bright = pair.oct.samples[::-1, row + 3 : row + 14].astype(float).mean(axis=1)
    if mirrored and states_handedness:
        bright = bright[:, -np.arange(recipe.a_scans) % recipe.a_scans]
    theta = 2 * np.pi * np.arange(recipe.a_scans) / recipe.a_scans
    z = recipe.pitch_mm * np.arange(recipe.slices)
    wall = Wall(bright, bright < 80, np.ones(bright.shape, bool), z, theta)
    assert against_truth(pair.bore, pair.oct_place, wall) > INDEPENDENT_SEEN
    assert against_truth(pair.bore, replace(pair.oct_place, theta_rad=2.5), wall) < 0.5


@pytest.mark.parametrize(("ahead", "travel"), [(True, "in"), (False, "in"), (True, "out")])
def test_true_cells_lie_where_the_endoscope_sees_the_dark(ahead: bool, travel: str):
    probe = replace(
        PROBE, ahead=ahead, travel=travel, bore_offset_mm=0.0, roll_rad=0.0, noise=0.0, light_around=0.0, ring=0.0
    )
    pair = make_pair(Recipe(replace(SHORT, texture=0.0, floor_brightness=(0.2, 0.3)), SMALL, probe), 2)
    optics, place = pair.endoscope.optics, pair.endoscope_place
    middle = sum(optics.band_mm) / 2
    radii = np.linspace(optics.inner_px + 1, probe.outer_px - 1, 2000)
    radius = np.interp(middle, wall_z_mm(probe, pair.bore.radius_mm, optics.focal_px, radii), radii)
    theta = np.linspace(0, 2 * np.pi, 360, endpoint=False)
    column = np.rint(optics.centre_px[0] + radius * np.cos(theta)).astype(int)
    row = np.rint(optics.centre_px[1] + radius * np.sin(theta)).astype(int)
    seen = pair.endoscope.frames[:, row, column].astype(float)
    z = pair.endoscope.apex_mm - pair.endoscope.apex_mm.min()
    order = np.argsort(z)
    wall = Wall(seen[order], (seen < 0.75 * np.median(seen))[order], np.ones(seen.shape, bool), z[order], theta)
    assert against_truth(pair.bore, place, wall) > INDEPENDENT_SEEN


def test_the_sides_of_a_cell_are_no_brighter_than_its_floor_allows():
    recipe = BoreRecipe(
        length_mm=3.0, cells=1, cells_mm=(1.5, 1.5), size_mm=(0.8, 0.8), depth_mm=(0.5, 0.5), ragged=0.0,
        floor_brightness=(0.3, 0.3), texture=0.0, floor_slope=0.0,
    )  # fmt: skip
    bore = drill(recipe, np.random.default_rng(0))
    optics = look(replace(PROBE, half_angle_deg=40.0), bore.radius_mm, np.random.default_rng(1))
    apex = 1.5 - sum(optics.band_mm) / 2
    seen = wall_brightness(bore, optics, apex, 0.0, 1.0)
    level = bore.at(bore.level, *seen_at(optics, optics.reach_mm, apex, 0.0, 1.0))
    assert (level < 0.9).sum() > 100
    assert seen[level < 0.9].max() < 0.85
    assert seen[level > 1.1] == pytest.approx(1)
    assert np.median(seen[level < 0.5]) == pytest.approx(0.3, abs=0.05)


def test_texture_lies_on_the_surface_that_is_seen():
    """Of a floor as bright as the wall, a slanted ray sees what lies where it ends, not where it leaves the bore."""
    recipe = BoreRecipe(
        length_mm=3.0, cells=1, cells_mm=(1.5, 1.5), size_mm=(1.0, 1.0), depth_mm=(0.5, 0.5), ragged=0.0,
        floor_brightness=(1.0, 1.0), texture=0.15, floor_slope=0.0,
    )  # fmt: skip
    bore = drill(recipe, np.random.default_rng(0))
    optics = look(replace(PROBE, half_angle_deg=36.0), bore.radius_mm, np.random.default_rng(1))
    apex = 1.5 - sum(optics.band_mm) / 2
    seen = wall_brightness(bore, optics, apex, 0.0, 1.0)
    theta, z = seen_at(optics, optics.reach_mm, apex, 0.0, 1.0)
    behind = seen_at(optics, optics.reach_mm + 0.5, apex, 0.0, 1.0)
    on_floor = (bore.at(bore.level, theta, z) < 0.6) & (bore.at(bore.level, *behind) < 0.6)
    assert on_floor.sum() > 100
    assert np.corrcoef(seen[on_floor], bore.at(bore.albedo, *behind)[on_floor])[0, 1] > 0.95
    assert np.corrcoef(seen[on_floor], bore.at(bore.albedo, theta, z)[on_floor])[0, 1] < 0.5
    on_wall = bore.at(bore.level, theta, z) > 1.1
    assert seen[on_wall] == pytest.approx(bore.at(bore.albedo, theta, z)[on_wall])


def test_one_place_in_another_is_what_both_are_in_the_bore():
    a = Place(0.4, 2.0, 1.02, mirrored=True, reversed=False)
    b = Place(2.9, 5.0, 0.97, mirrored=False, reversed=True)
    theta, z = np.linspace(0, 6, 7), np.linspace(0, 5, 7)
    of_b = b.to_bore(theta, z)
    through_a = a.to_bore(*between(a, b).to_bore(theta, z))
    assert np.exp(1j * through_a[0]) == pytest.approx(np.exp(1j * of_b[0]), abs=COORDINATE_ATOL)
    assert through_a[1] == pytest.approx(of_b[1], abs=COORDINATE_ATOL)
    back = a.from_bore(*a.to_bore(theta, z))
    assert np.array(back) == pytest.approx(np.array([theta, z]), abs=COORDINATE_ATOL)


def _perfect(bore: Bore, place: Place, rows: int, columns: int, step_mm: float) -> Wall:
    z, theta = step_mm * np.arange(rows), np.linspace(0, 2 * np.pi, columns, endpoint=False)
    blank = Wall(
        np.ones((rows, columns), np.float32), np.zeros((rows, columns), bool), np.ones((rows, columns), bool), z, theta
    )
    return replace(blank, cells=true_cells(bore, place, blank))


def test_perfect_sides_reach_one_and_shifted_ones_lose_what_is_lost(bore: Bore):
    a, b = Place(0.0, 0.5), Place(1.0, 0.5)
    one, two = _perfect(bore, a, 300, 900, 0.01), _perfect(bore, b, 300, 900, 0.01)
    assert against_truth(bore, a, one) == 1
    assert pair_jaccard(one, two, between(a, b)) > 1 - INDEPENDENT_LOSS
    assert loss_of_alignment(bore, one, two, a, b, between(a, b)) == pytest.approx(0, abs=COORDINATE_ATOL)
    shifted = replace(between(a, b), z_mm=0.04)
    lost = loss_of_alignment(bore, one, two, a, b, shifted)
    assert lost == pytest.approx(1 - pair_jaccard(one, two, shifted), abs=INDEPENDENT_LOSS)


def test_a_round_cell_laid_beside_itself_loses_what_two_circles_lose():
    recipe = BoreRecipe(length_mm=3.0, cells=1, cells_mm=(1.5, 1.5), size_mm=(0.8, 0.8), ragged=0.0)
    bore = drill(recipe, np.random.default_rng(0))
    wall = _perfect(bore, Place(0, 0), 300, 900, 0.01)
    shift, radius = 0.1, 0.4
    lens = 2 * radius**2 * np.arccos(shift / 2 / radius) - shift / 2 * np.sqrt(4 * radius**2 - shift**2)
    expected = 1 - lens / (2 * np.pi * radius**2 - lens)
    lost = loss_of_alignment(bore, wall, wall, Place(0, 0), Place(0, 0), Place(0, shift))
    assert lost == pytest.approx(expected, abs=INDEPENDENT_LOSS)


def test_jaccard_counts_only_what_was_observed():
    one, other, where = np.array([1, 1, 0, 1], bool), np.array([1, 0, 0, 0], bool), np.array([1, 1, 1, 0], bool)
    assert jaccard(one, other, where) == 0.5
    assert np.isnan(jaccard(~where, ~where, where))


def test_the_place_of_a_picture_is_measured(bore: Bore):
    true, guess = Place(0.32, 0.61, 1.012), Place(0.3, 0.55)
    wall = _perfect(bore, true, 140, 500, 0.02)
    theta, z = true.to_bore(*np.meshgrid(wall.theta_rad, wall.z_mm))
    rng = np.random.default_rng(1)
    picture = bore.at(bore.albedo, theta, z) * np.where(wall.cells, 0.4, 1) + 0.05 * rng.normal(size=theta.shape)
    found, fit = measured_place(bore, replace(wall, intensity=picture.astype(np.float32)), guess)
    middle = float(wall.z_mm.mean())
    assert fit > 0.8
    assert found.theta_rad == pytest.approx(true.theta_rad, abs=INDEPENDENT_PLACE_RAD)
    assert found.to_bore(0.0, middle)[1] == pytest.approx(true.to_bore(0.0, middle)[1], abs=INDEPENDENT_PLACE_MM)
    assert found.scale == pytest.approx(true.scale, abs=INDEPENDENT_PLACE_SCALE)
    noise = replace(wall, intensity=rng.normal(1, 0.1, theta.shape).astype(np.float32))
    assert measured_place(bore, noise, guess)[0] == guess


def test_errors_are_stated_in_standard_errors_at_the_middle_of_b():
    z = np.linspace(0, 8, 41)
    wall = Wall(
        np.zeros((41, 4), np.float32), np.zeros((41, 4), bool), np.ones((41, 4), bool), z, np.arange(4) * np.pi / 2
    )
    stated, true = Place(0.1, 1.0, 1.01), Place(2 * np.pi, 1.0)
    covariance = np.diag([0.05**2, 0.03**2, 0.005**2])
    error = misplaced(stated, true, wall, covariance)
    assert error.theta_sigmas == pytest.approx(2)
    assert error.scale_sigmas == pytest.approx(2)
    assert error.z_mm == pytest.approx(0.04)
    assert error.z_sigmas == pytest.approx(0.04 / np.hypot(0.03, 4 * 0.005))
    assert error.right_way
    assert not misplaced(replace(stated, mirrored=True), true, wall, None).right_way


def test_a_written_pair_is_what_was_made(tmp_path: Path):
    import tifffile

    pair = make_pair(Recipe(SHORT, replace(SMALL, fault="pitch", fault_size=1.25, slices=3), PROBE), 3)
    write_pair(pair, tmp_path / "pair")
    assert np.array_equal(tifffile.imread(tmp_path / "pair/oct/pullback.tif"), pair.oct.samples)
    assert len(list((tmp_path / "pair/endoscope").glob("*.png"))) == len(pair.endoscope.frames)
    assert "pullback_pitch_mm = 0.125" in (tmp_path / "pair/oct/acquisition.toml").read_text("utf-8")


@pytest.mark.parametrize(
    ("fault", "size"), [("lost_slices", 4.0), ("swapped_slices", 2.0), ("start_jump", 0.3), ("upside_down", 0.0)]
)
def test_a_fault_of_the_pullback_is_in_its_truth(fault: str, size: float):
    sound = make_pair(Recipe(SHORT, SMALL, PROBE), 1).oct
    broken = make_pair(Recipe(SHORT, replace(SMALL, fault=fault, fault_size=size), PROBE), 1).oct
    steps = -np.diff(broken.z_mm)
    if fault == "lost_slices":
        assert steps.max() == pytest.approx((size + 1) * SMALL.pitch_mm)
    if fault == "swapped_slices":
        assert (np.abs(steps - SMALL.pitch_mm) > 1e-6).sum() > 1
        assert sorted(broken.z_mm) == pytest.approx(sorted(sound.z_mm))
    if fault == "start_jump":
        assert np.abs(np.diff(broken.angle_rad[:, 0])).max() == pytest.approx(size)
    if fault == "upside_down":
        assert np.array_equal(broken.samples[:, ::-1], sound.samples)


@pytest.mark.parametrize(("name", "seed", "least"), [("few", 2900, 0.85), ("tiny", 2900, 0.65), ("sparse", 2900, None)])
def test_bores_with_few_or_tiny_cells_keep_their_wall(tmp_path: Path, name: str, seed: int, least: float | None):
    """A slice of the gate: where hardly any A-scan meets an opening, bone is no noise, and wall no cell."""
    recipe = recipe_of(name, seed)
    bore = drill(recipe.bore, np.random.default_rng([seed, 0]))
    pullback = pull_back(bore, recipe.oct, np.random.default_rng([seed, 1]))
    write_pullback(pullback, recipe, tmp_path)
    wall, doubts = endoct_oct(tmp_path)
    place = oct_place(recipe.oct, pullback)
    assert doubts == ()
    assert wrong_share(bore, place, wall) < 0.01
    if least is None:
        assert not wall.cells.any(), "there are no cells"
    else:
        assert against_truth(bore, place, wall) > least


@pytest.mark.slow
def test_the_simplest_chain_finds_a_pair():
    pair = make_pair(recipe_of("usual", 5), 5)
    row = scores(pair, simplest_answer(pair))
    assert row["error_right_way"]
    assert row["jaccard_oct"] > 0.7
    assert row["jaccard_pair"] > 0.5
