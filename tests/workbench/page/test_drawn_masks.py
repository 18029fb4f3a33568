"""Masks that the page saves: on the samples of a side's panorama, as other programs and `endoct compare` read them."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from workbench_page import post, serving

from endoct.base.files.contents import seal
from endoct.fusion.files.masks import read_mask
from endoct.fusion.files.store import load_comparison
from endoct.stitching.store import load_panorama
from endoct.workbench.running.kinds import COMPARISON
from endoct.workbench.verifying import verify

STROKE = {"points": [[2.0, 1.5], [2.3, 1.5]], "adds": True, "radius_mm": 0.2}


@pytest.fixture
def folder(comparison: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(comparison, tmp_path / "result"))


def drawing(**changed: Any) -> dict[str, Any]:
    return {"side": "endoscope", "ground": "", "shapes": [STROKE], "rater": "anna", "session": "1", **changed}


def test_a_mask_is_saved_as_it_was_outlined_and_read_by_compare(folder: Path):
    seal(folder, COMPARISON)
    with serving(folder) as served:
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
    with serving(folder) as served:
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
    with serving(folder) as served:
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
    with serving(folder) as served:
        status, answer = post(served, "/masks.json", drawing(**changed))
    if changed != {"rater": None}:  # which is a name like another
        assert status == 409
        assert said in answer
        assert sorted(folder.rglob("*.png")) == before


def test_what_is_no_json_is_called_so(folder: Path):
    with serving(folder) as served:
        for body in (b"{", b"[]", b'"x"'):
            status, said = post(served, "/masks.json", body)
            assert status == 409
            assert "session" not in said


def test_another_page_draws_nothing(folder: Path):
    with serving(folder) as served:
        for path in ("/masks.json", "/drawing.json"):
            assert post(served, path, drawing(), Origin="http://evil.example")[0] == 403
            assert post(served, path, drawing(), Origin=None)[0] == 403
        assert post(served, "/masks.json?of=0", drawing())[0] == 410
    assert not (folder / "masks").exists()


def test_a_link_is_not_followed(folder: Path, tmp_path: Path):
    (tmp_path / "elsewhere").mkdir()
    (folder / "masks").symlink_to(tmp_path / "elsewhere")
    with serving(folder) as served:
        assert post(served, "/masks.json", drawing())[0] == 409
    assert list((tmp_path / "elsewhere").iterdir()) == []


def test_a_panorama_alone_has_no_masks(folder: Path):
    with serving(folder / "panoramas" / "oct.zarr") as served:
        assert served.get("/masks.json")[0] == 404
