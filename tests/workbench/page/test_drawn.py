"""Masks drawn by hand on the page: layers and outlines where they were drawn, and nothing made of damaged ones."""

import io
import json
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from bore_pairs import make_pair
from mock_comparison import GRID
from page_browser import opened
from PIL import Image
from workbench_page import application, serving, written

from endoct.base.errors import EndoctError
from endoct.fusion.files.masks import DRAWN_STORE, read_drawn, save_drawings
from endoct.fusion.scoring.raters import Drawing
from endoct.workbench import compare
from endoct.workbench.page.layers import DRAWN_COLOURS
from endoct.workbench.page.opening import open_shown

HTML = "<img src=x onerror=alert(1)>"
EVERYWHERE = np.ones(GRID.shape, np.bool_)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A comparison on which two people drew: one from 100° to 200° around z = 1.5 mm, the other nothing."""
    made = written(tmp_path / "drawn-on")
    theta_deg, z_mm = np.meshgrid(np.degrees(GRID.theta_rad), GRID.z_mm)
    square = (np.abs(theta_deg - 150) < 50) & (np.abs(z_mm - 1.5) < 0.5)
    drawings = [Drawing("anna", "1", square, EVERYWHERE), Drawing(HTML, "may", ~EVERYWHERE, EVERYWHERE)]
    save_drawings(drawings, GRID, made / DRAWN_STORE)
    return made


def test_drawn_masks_are_layers_and_outlines(folder: Path):
    with application(folder) as served:
        description = json.loads(served.get("/description.json")[1])
        titles = {layer["key"]: layer["title"] for layer in description["layers"]}
        assert titles["drawn.1"] == "drawn: anna"
        assert titles["drawn.2"] == f"drawn: {HTML}, may"
        drawn = [one for one in description["outlines"] if one["is_drawn"]]
        assert [one["title"] for one in drawn] == ["drawn: anna", f"drawn: {HTML}, may"]
        assert len(description["outlines"]) == 4
        picture = Image.open(io.BytesIO(served.get("/tiles/v/drawn.1/0/0_0.png")[1])).convert("RGB")
        middle = picture.getpixel((1 + round(256 * 150 / 360), picture.height // 2))
        assert middle == DRAWN_COLOURS[0]
        assert picture.getpixel((1 + round(256 * 300 / 360), picture.height // 2)) != middle
        (line,) = json.loads(served.get("/outlines.json")[1])["drawn.1"]
        theta_deg = np.degrees(line[::2])
        assert (theta_deg.min(), theta_deg.max()) == (pytest.approx(100, abs=2), pytest.approx(200, abs=2))


def test_a_drawn_mask_is_switched_on_and_read_out(chromium: Any, folder: Path):
    with serving(folder) as served, opened(chromium, served.url) as page:
        switch = page.page.locator(".toolbar button", has_text="drawn: anna")
        assert switch.get_attribute("aria-pressed") == "false"  # of two, whose lines would hide each other
        switch.click()
        assert switch.get_attribute("aria-pressed") == "true"
        page.page.locator(".pane").first.locator("header select").first.select_option("drawn.1")
        page.settle()
        box = page.page.locator(".view").first.bounding_box()
        page.page.mouse.move(box["x"] + box["width"] / 2 - 8, box["y"] + box["height"] / 2)  # near 180°, 1.5 mm
        page.page.wait_for_function("() => /drawn: anna\\ncell/.test(document.querySelector('.readout').innerText)")
        assert page.page.locator("img").count() == 0


def test_one_drawn_mask_is_outlined_from_the_outset(chromium: Any, tmp_path: Path):
    made = written(tmp_path / "once")
    save_drawings([Drawing("anna", "1", EVERYWHERE, EVERYWHERE)], GRID, made / DRAWN_STORE)
    with serving(made) as served, opened(chromium, served.url) as page:
        switch = page.page.locator(".toolbar button", has_text="drawn: anna")
        assert switch.get_attribute("aria-pressed") == "true"


@pytest.mark.usefixtures("without_report")
def test_compare_leaves_what_was_drawn_to_be_looked_at(tmp_path: Path):
    pair = make_pair(2, theta_shift_rad=1.0)
    masks = []
    for name, cells in (("anna", pair.cells_a), ("ben_2", np.roll(pair.cells_a, 3, axis=1))):
        masks.append(tmp_path / f"{name}.png")
        cv2.imwrite(str(masks[-1]), cells.astype(np.uint8) * 255)
    compare(pair.a, pair.b, tmp_path / "result", truth=masks, settings={"n_theta": 512}, progress=False)
    drawn = read_drawn(tmp_path / "result")
    assert drawn is not None
    assert drawn.titles == ("anna", "ben, 2", "most raters")
    keys = [layer.key for layer in open_shown(tmp_path / "result").description.layers]
    assert [key for key in keys if key.startswith("drawn.")] == ["drawn.1", "drawn.2", "drawn.3"]


@pytest.mark.parametrize("part", ["zarr.json", "mask/zarr.json", "valid", "rater"])
def test_a_damaged_store_is_one_line(folder: Path, part: str):
    path = folder / DRAWN_STORE / part
    shutil.rmtree(path) if path.is_dir() else path.write_text("{}")
    with pytest.raises(EndoctError) as refused:
        open_shown(folder)
    assert "\n" not in str(refused.value)
