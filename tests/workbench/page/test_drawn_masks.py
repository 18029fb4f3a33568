"""Masks drawn on the page: painted by the brush's radius in mm, on the circle, and saved as others read them."""

import json
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from workbench_page import application, post

from endoct.base.errors import EndoctError
from endoct.base.files.contents import seal
from endoct.fusion.files.masks import on_comparison, read_mask, score_surface
from endoct.fusion.files.store import load_comparison, save_comparison
from endoct.fusion.geometry.alignment import Alignment
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.store import load_panorama
from endoct.workbench.page import drawn_masks
from endoct.workbench.page.drawn_masks import Shape, painted, shapes_from
from endoct.workbench.page.saved_masks import flooded
from endoct.workbench.running.outputs import COMPARISON
from endoct.workbench.verifying import verify

STROKE = {"points": [[2.0, 1.5], [2.3, 1.5]], "adds": True, "radius_mm": 0.2}


@pytest.fixture
def folder(comparison: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(comparison, tmp_path / "result"))


def drawing(**changed: Any) -> dict[str, Any]:
    return {"side": "endoscope", "ground": "", "shapes": [STROKE], "rater": "anna", "session": "1", **changed}


def test_a_mask_is_saved_as_it_was_outlined_and_read_by_compare(folder: Path):
    seal(folder, COMPARISON)
    with application(folder) as served:
        status, said = post(served, "/masks.json", drawing())
        assert status == 200
        answer = json.loads(said)
        assert answer["saved"] == "anna_1"
        assert "--truth" in answer["command"]
        listed = json.loads(served.get("/masks.json")[1])
        assert listed == {"masks": {"endoscope": ["anna_1"], "oct": []}, "refused": ""}
        lines = json.loads(post(served, "/drawing.json", drawing())[1])["lines"]
    path = folder / "masks" / "endoscope" / "anna_1.png"
    panorama = load_panorama(folder / "panoramas" / "endoscope.zarr")
    picture = np.asarray(Image.open(path))
    assert (picture.dtype, picture.shape, set(np.unique(picture))) == (np.uint8, panorama.grid.shape, {0, 255})
    mask = read_mask(path, panorama)
    assert (mask.rater, mask.session) == ("anna", "1")
    assert (mask.mask == (picture > 0)).all()
    (line,) = lines
    places = np.array(line).reshape(-1, 2)
    assert places[:, 0].min() == pytest.approx(2.0 - 0.2 / panorama.grid.radius_mm, abs=2 * panorama.grid.dtheta_rad)
    assert places[:, 1].max() == pytest.approx(1.7, abs=panorama.grid.dz_mm)
    assert [verdict.intact for verdict in verify(folder)] == [True]  # a mask is the user's own


def test_no_mask_is_ever_replaced(folder: Path):
    with application(folder) as served:
        assert post(served, "/masks.json", drawing())[0] == 200
        before = (folder / "masks" / "endoscope" / "anna_1.png").read_bytes()
        status, said = post(served, "/masks.json", drawing(shapes=[{**STROKE, "radius_mm": 0.4}]))
        assert status == 409
        assert "exists already" in said
        assert (folder / "masks" / "endoscope" / "anna_1.png").read_bytes() == before
        erased = [{**STROKE, "points": [[2.0, 1.5]], "adds": False}]
        assert post(served, "/masks.json", drawing(ground="anna_1", shapes=erased, session="2"))[0] == 200
    first, second = (np.asarray(Image.open(folder / "masks" / "endoscope" / f"anna_{k}.png")) > 0 for k in (1, 2))
    assert 0 < second.sum() < first.sum()
    assert (first | ~second).all()


@pytest.mark.parametrize("side", ["endoscope", "oct"])
def test_the_cells_of_either_side_are_corrected(folder: Path, side: str):
    with application(folder) as served:
        shapes = [{"points": [[5.5, 0.7]], "adds": True, "radius_mm": 0.1}]
        assert post(served, "/masks.json", drawing(side=side, ground="cells", shapes=shapes))[0] == 200
    saved = np.asarray(Image.open(folder / "masks" / side / "anna_1.png")) > 0
    found = next(each for each in load_comparison(folder / "comparison.zarr").sides if each.name == side)
    assert saved.shape == load_panorama(folder / "panoramas" / f"{side}.zarr").grid.shape
    assert saved.mean() == pytest.approx(found.mask.mean(), abs=0.02)
    assert saved.sum() > 0.9 * found.mask.mean() * saved.size


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"side": "ct"}, "no such side"),
        ({"side": ["oct"]}, "no such side"),
        ({"rater": "../../x"}, "needs a name"),
        ({"rater": ".hidden"}, "needs a name"),
        ({"session": ""}, "needs a name"),
        ({"rater": None}, ""),
        ({"ground": "../../../x_1"}, "no such mask"),
        ({"ground": "anna_9"}, ""),
        ({"shapes": []}, "shows no cells"),
        ({"shapes": "x"}, "cannot be used"),
        ({"shapes": [{**STROKE, "points": [[2.0, 99.0]]}]}, "shows no cells"),
    ],
)
def test_what_is_no_mask_is_refused(folder: Path, changed: dict[str, Any], said: str):
    before = sorted(folder.rglob("*.png"))
    with application(folder) as served:
        status, answer = post(served, "/masks.json", drawing(**changed))
    if changed != {"rater": None}:  # which is a name like another
        assert status == 409
        assert said in answer
        assert sorted(folder.rglob("*.png")) == before


def test_what_is_no_json_is_called_so(folder: Path):
    with application(folder) as served:
        for body in (b"{", b"[]", b'"x"'):
            status, said = post(served, "/masks.json", body)
            assert status == 409
            assert "session" not in said


def test_another_page_draws_nothing(folder: Path):
    with application(folder) as served:
        for path in ("/masks.json", "/drawing.json"):
            assert post(served, path, drawing(), Origin="http://evil.example")[0] == 403
            assert post(served, path, drawing(), Origin=None)[0] == 403
        assert post(served, "/masks.json?of=0", drawing())[0] == 410
    assert not (folder / "masks").exists()


def test_a_link_is_not_followed(folder: Path, tmp_path: Path):
    (tmp_path / "elsewhere").mkdir()
    (folder / "masks").symlink_to(tmp_path / "elsewhere")
    with application(folder) as served:
        assert post(served, "/masks.json", drawing())[0] == 409
    assert list((tmp_path / "elsewhere").iterdir()) == []


def test_a_panorama_alone_has_no_masks(folder: Path):
    with application(folder / "panoramas" / "oct.zarr") as served:
        assert served.get("/masks.json")[0] == 404


GRID = SurfaceGrid.full_circle(60, 200, z0_mm=0.5, dz_mm=0.05, radius_mm=1.25)
UNEVEN = GRID.with_rows(0.5 + 0.05 * np.arange(60) + 0.02 * np.sin(np.arange(60)))


def brush(*points: tuple[float, float], radius_mm: float = 0.3, adds: bool = True) -> Shape:
    return Shape(np.array(points), adds, radius_mm)


@pytest.mark.parametrize("grid", [GRID, UNEVEN])
def test_a_dot_holds_the_samples_within_its_radius(grid: SurfaceGrid):
    mask = painted([brush((1.0, 2.0))], grid)
    apart = np.hypot((grid.theta_rad - 1.0) * 1.25, grid.z_mm[:, None] - 2.0)
    assert (mask == (apart <= 0.3)).all()
    assert mask.any()


@given(st.floats(-6.0, 6.0), st.floats(0.6, 3.3), st.floats(0.05, 0.6), st.integers(-2, 2))
def test_a_stroke_does_not_know_where_the_seam_is(theta_rad: float, z_mm: float, length_rad: float, turns: int):
    around = 2 * np.pi
    stroke = [(theta_rad, z_mm), (theta_rad + length_rad, z_mm + 0.1)]
    mask = painted([brush(*stroke)], GRID)
    elsewhere = painted([brush(*[(theta + turns * around, z) for theta, z in stroke])], GRID)
    assert abs(int(mask.sum()) - int(elsewhere.sum())) <= 2  # of samples just at the radius
    assert (mask != elsewhere).sum() <= 2
    step = 37
    moved = painted([brush(*[(theta + step * GRID.dtheta_rad, z) for theta, z in stroke])], GRID)
    assert (np.roll(mask, step, axis=1) != moved).sum() <= 4


def test_a_stroke_covers_what_lies_along_it():
    mask = painted([brush((6.0, 1.0), (7.0, 1.0), (7.0, 2.0))], GRID)  # over the seam
    for theta_rad, z_mm in ((6.2, 1.0), (0.05, 1.1), (7.0 - 2 * np.pi, 1.8)):
        assert mask[np.argmin(abs(GRID.z_mm - z_mm)), round(float(GRID.column_of(theta_rad))) % 200]
    assert not mask[:, 100].any()
    area_mm2 = mask.sum() * GRID.dz_mm * GRID.dtheta_mm
    assert area_mm2 == pytest.approx(2 * 0.3 * (1.25 + 1.0) + np.pi * 0.3**2, rel=0.08)


def test_a_polygon_is_filled_over_the_seam():
    corners = [(-0.4, 1.0), (0.4, 1.0), (0.4, 2.0), (-0.4, 2.0)]
    mask = painted([Shape(np.array(corners), True, None)], GRID)
    assert mask[20, 0]
    assert mask[20, -5]
    assert not mask[20, 100]
    assert mask.sum() * GRID.dz_mm * GRID.dtheta_mm == pytest.approx(0.8 * 1.25, rel=0.1)


def test_later_shapes_lie_over_earlier_ones_and_over_the_ground():
    ground = np.zeros(GRID.shape, np.bool_)
    ground[10:50, 50:150] = True
    erased = painted([brush((np.pi, 2.0), radius_mm=0.5, adds=False)], GRID, ground)
    assert not erased[30, 100]
    assert erased[12, 60]
    again = painted([brush((np.pi, 2.0), radius_mm=0.5, adds=False), brush((np.pi, 2.0), radius_mm=0.1)], GRID, ground)
    assert again[30, 100]
    assert ground[30, 100]  # which is not changed


def test_what_lies_beyond_the_ends_paints_nothing():
    assert not painted([brush((1.0, -5.0)), brush((1.0, 99.0))], GRID).any()
    assert painted([brush((1.0, 0.4))], GRID).any()


def stroke(points: object, radius_mm: object = 1.0, adds: object = True) -> list[object]:
    return [{"points": points, "radius_mm": radius_mm, "adds": adds}]


@pytest.mark.parametrize(
    "posted",
    [
        None,
        {},
        [1],
        [{"adds": True}],
        stroke([[0, 1]], adds=1),
        stroke([[0, 1]], radius_mm=None),
        stroke([[0, 1]], radius_mm=-1),
        stroke([[0, 1]], radius_mm=float("nan")),
        stroke([]),
        stroke([[0, float("inf")]]),
        stroke([[1e9, 1]]),
        stroke([[True, 1]]),
        stroke([[0, 1, 2]]),
        stroke([[0, 1]] * 20_001),
        stroke([[0, 1]]) * 5001,
    ],
)
def test_what_is_no_drawing_is_refused(posted: object):
    with pytest.raises(EndoctError):
        shapes_from(posted)


def test_a_save_that_was_killed_leaves_no_mask_without_its_place(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """At most a sidecar, which the same save takes over; and its scratch, which the next save clears."""
    grid = SurfaceGrid.full_circle(4, 8, z0_mm=0.5, dz_mm=0.1, radius_mm=1.0)
    mask, masks, before = np.ones(grid.shape, bool), folder / "masks" / "oct", []

    def refused(path: Path, kind: str) -> Any:
        if path.suffix == ".png":
            before.append([one.name for one in masks.iterdir()])
            raise OSError(28, "no space left")
        return real(path, kind)

    real = drawn_masks.new_output
    monkeypatch.setattr(drawn_masks, "new_output", refused)
    with pytest.raises(EndoctError, match="no space left"):
        drawn_masks._write(folder, "oct", "anna_1", mask, grid)
    assert before == [["anna_1.toml"]]
    assert list(masks.iterdir()) == []
    monkeypatch.undo()
    (masks / "anna_1.toml").write_bytes(drawn_masks._sidecar(grid))
    stale = masks / ".endoct-ben_1.png-x"
    (stale / "new").mkdir(parents=True)
    (stale / "lock").write_text("process 1 on a machine\n")
    with pytest.raises(EndoctError, match="exists already"):
        drawn_masks._write(folder, "oct", "anna_1", mask, replace(grid, z0_mm=0.7))
    drawn_masks._write(folder, "oct", "anna_1", mask, grid)
    assert sorted(path.name for path in masks.iterdir()) == ["anna_1.png", "anna_1.toml"]
    assert tomllib.loads((masks / "anna_1.toml").read_text())["z0_mm"] == 0.5


def test_a_mask_that_another_window_saves_meanwhile_keeps_its_place(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    grid = SurfaceGrid.full_circle(4, 8, z0_mm=0.5, dz_mm=0.1, radius_mm=1.0)
    masks = folder / "masks" / "oct"

    def after_another(path: Path, kind: str) -> Any:
        if path.suffix == ".png":
            path.write_bytes(b"another's")
        return real(path, kind)

    real = drawn_masks.new_output
    monkeypatch.setattr(drawn_masks, "new_output", after_another)
    with pytest.raises(EndoctError, match="exists"):
        drawn_masks._write(folder, "oct", "anna_1", np.eye(4, 8, dtype=bool), grid)
    assert sorted(path.name for path in masks.iterdir()) == ["anna_1.png", "anna_1.toml"]
    assert (masks / "anna_1.png").read_bytes() == b"another's"


RING = SurfaceGrid.full_circle(7, 12, z0_mm=0.0, dz_mm=0.1, radius_mm=1.25)
"""A cell with a hole over the seam of θ, a cell without, and one that is open to the end of the bore."""
PICTURE = np.array([[letter == "#" for letter in row] for row in (
    "..........#.",
    "##........##",
    ".#.##.....#.",
    ".#.##.....#.",
    "##........##",
    "....###.....",
    "....#.#.....",
)])  # fmt: skip


def click(row: int, column: int, *, adds: bool) -> np.ndarray[Any, Any]:
    place = [[float(RING.theta_rad[column]) - 2 * np.pi, float(RING.z_mm[row]) + 0.03]]
    return painted(shapes_from([{"points": place, "adds": adds, "radius_mm": 0}]), RING, PICTURE)


@pytest.mark.parametrize("column", [0, 11])
def test_a_click_fills_a_hole_over_the_seam_and_nothing_else(column: int):
    changed = click(2, column, adds=True) ^ PICTURE
    assert sorted(zip(*(axis.tolist() for axis in np.nonzero(changed)), strict=True)) == [
        (2, 0), (2, 11), (3, 0), (3, 11),
    ]  # fmt: skip


def test_a_click_takes_a_whole_cell_away_also_over_a_corner():
    assert np.count_nonzero(PICTURE) - np.count_nonzero(click(2, 3, adds=False)) == 4
    over_corners = click(0, 10, adds=False) ^ PICTURE
    assert over_corners.sum() == PICTURE[:5].sum() - 4  # all of the ring, both of its halves
    assert (click(0, 0, adds=False) == PICTURE).all()  # there is no cell
    assert (click(2, 3, adds=True) == PICTURE).all()  # nor a hole


@pytest.mark.parametrize(("row", "column"), [(0, 0), (6, 5), (2, 7)])
def test_what_no_cell_encloses_is_not_filled(row: int, column: int):
    with pytest.raises(EndoctError, match="no cell encloses"):
        click(row, column, adds=True)


def test_a_cell_is_connected_over_corners_and_a_hole_is_not():
    cell = np.zeros((5, 12), np.bool_)
    cell[[1, 2, 2, 3], [5, 4, 6, 5]] = True
    filled = flooded(cell, 2, 5, adds=True) ^ cell
    assert np.argwhere(filled).tolist() == [[2, 5]]
    assert not flooded(cell, 1, 5, adds=False).any()


def test_a_mask_of_either_side_is_scored_where_that_side_lies(folder: Path):
    found = load_comparison(folder / "comparison.zarr")
    shutil.rmtree(folder / "comparison.zarr")
    moved = Alignment(1.0, 0.2, confidence=0.6, correlation=0.9, ratio=3.0)
    save_comparison(replace(found, alignment=moved), folder / "comparison.zarr")
    with application(folder) as served:
        for side in ("endoscope", "oct"):
            drawn = drawing(side=side, ground="cells", shapes=[])
            assert post(served, "/masks.json", drawn)[0] == 200
            scores = json.loads(post(served, "/score.json", {"side": side, "mask": "anna_1"})[1])["scores"]
            assert scores[side]["jaccard"] > 0.95  # it is that side's own cells


def test_a_click_has_one_place():
    with pytest.raises(EndoctError, match="one place"):
        shapes_from([{"points": [[0, 1], [0, 1]], "adds": True, "radius_mm": 0}])


def test_a_saved_mask_is_a_layer_an_outline_and_a_score(folder: Path):
    with application(folder) as served:
        for side in ("endoscope", "oct"):
            assert post(served, "/masks.json", drawing(side=side, ground="cells", session="2"))[0] == 200
        before = served.get("/description.json")[1]
        assert served.get("/")[0] == 200  # loaded anew
        description = json.loads(served.get("/description.json")[1])
        assert "saved: anna_2" not in before.decode()
        keys = ["drawn.endoscope.anna_2", "drawn.oct.anna_2"]
        assert [layer["key"] for layer in description["layers"] if layer["title"] == "saved: anna_2"] == keys
        outlines = json.loads(served.get("/outlines.json")[1])
        assert all(len(outlines[key]) >= 2 for key in keys)
        tiles = [served.get(f"/tiles/1/{key}/0/0_0.png") for key in keys]
        assert all(status == 200 for status, *_ in tiles)
        answers = [
            json.loads(post(served, "/score.json", {"side": side, "mask": "anna_2"})[1])
            for side in ("endoscope", "oct")
        ]
    drawn = read_mask(
        folder / "masks" / "endoscope" / "anna_2.png", load_panorama(folder / "panoramas" / "endoscope.zarr")
    )
    comparison = load_comparison(folder / "comparison.zarr")
    expected = score_surface(comparison, on_comparison(comparison, drawn), 0.1)
    for side, scores in answers[0]["scores"].items():
        assert scores["jaccard"] == expected[side].jaccard
    assert answers[0]["scores"]["endoscope"]["jaccard"] > answers[0]["scores"]["oct"]["jaccard"]  # drawn on its cells
    assert answers[1]["scores"]["oct"]["jaccard"] > answers[1]["scores"]["endoscope"]["jaccard"]
    assert "--truth" in answers[0]["command"]


def test_masks_that_cannot_be_read_are_no_layers_and_say_why(folder: Path):
    place = folder / "masks" / "endoscope"
    place.mkdir(parents=True)
    (place / "anna_1.png").write_bytes(b"no picture")
    Image.fromarray(np.eye(5, dtype=np.uint8) * 255).save(place / "anna_2.png")
    with application(folder) as served:
        assert "saved:" not in served.get("/description.json")[1].decode()
        for mask, said in (("anna_1", "anna_1"), ("anna_2", "not of this panorama"), ("../x", "no such mask"),
                           ("anna_9", "anna_9"), ("a\x1b_1", "no such mask"), (None, "no such mask")):  # fmt: skip
            status, answer = post(served, "/score.json", {"side": "endoscope", "mask": mask})
            assert (status, said in answer) == (409, True), answer
        assert post(served, "/score.json", {"side": "../oct", "mask": "anna_1"})[0] == 409
        shutil.rmtree(folder)
        assert post(served, "/score.json", {"side": "endoscope", "mask": "anna_1"})[0] == 410
