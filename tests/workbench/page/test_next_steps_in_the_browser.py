"""What to do next, on the page in a real browser: its tools open, and words are explained."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from page_browser import opened
from workbench_page import serving, written

from endoct.base.doubt import Doubt
from endoct.fusion.files.store import load_comparison, save_comparison


@pytest.fixture(scope="module")
def doubted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = Doubt("step-along-the-bore", "It steps.", "oct", 0.4, "mm", (0.0, 0.1), z_mm=(2.2, 2.2))
    return written(tmp_path_factory.mktemp("doubted") / "bore", doubts=(place, Doubt("cells-faint", "Faint.", "oct")))


def test_steps_lead_to_the_tools_of_the_page(chromium: Any, doubted: Path):
    with serving(doubted) as served, opened(chromium, served.url) as watched:
        page = watched.page
        page.click(".next button:has-text('z = 2.2 mm')")
        watched.settle()
        assert page.locator(".drawer:not([hidden])").count() == 1  # the frames there
        page.click(".next button:has-text('landmarks')")
        assert page.locator(".landmarks").is_visible()
        page.click(".next button:has-text('Correct the cells of oct')")
        assert page.locator(".masks").is_visible()
        page.click(".next a:has-text('frame of oct')")
        assert page.locator("#quality-oct").get_attribute("open") is not None


def test_words_are_explained_by_keys_and_lead_to_the_manuals(chromium: Any, doubted: Path):
    with serving(doubted) as served, opened(chromium, served.url) as watched:
        page = watched.page
        page.locator(".scores .explain summary").first.focus()
        page.keyboard.press("Enter")
        said = page.locator(".scores .explain[open] span")
        assert said.inner_text().startswith("|A ∩ B|")
        address = said.locator("a").get_attribute("href")
        page.keyboard.press("Escape")
        assert page.locator(".explain[open]").count() == 0
        assert "faint" not in page.locator(".cells h2 .explain").inner_text()
        page.goto(served.url + address)
        assert "Jaccard" in page.locator("main.manual").inner_text()


def test_cells_that_are_not_counted_are_listed_and_ringed(chromium: Any, tmp_path: Path):
    store = written(tmp_path / "bore") / "comparison.zarr"
    found = load_comparison(store)
    shutil.rmtree(store)
    first, *others = found.cells
    save_comparison(replace(found, cells=(replace(first, observed_by_other=0.4), *others)), store)
    with serving(tmp_path / "bore") as served, opened(chromium, served.url) as watched:
        page = watched.page
        said = page.locator(".uncounted").inner_text()
        assert said.startswith("1 of 4 cells is not counted. Of endoscope: 1 of which oct observed less than half.")
        ringed = """() => [...document.querySelectorAll('.pane canvas')].filter((canvas) => {
          const {data} = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
          return data.some((red, k) => k % 4 === 0 && red === 214 && data[k + 1] === 0 && data[k + 2] === 122);
        }).length"""
        assert page.evaluate(ringed) == 0
        page.click("text=show these cells")
        watched.settle()
        assert page.evaluate(ringed) == page.locator(".pane").count() == 3
        assert page.locator(".cells tbody tr").all_inner_texts()[0].endswith("not counted")
        assert page.locator(".cells tbody tr").count() == 1
        page.get_by_label("which cells are listed").select_option("all")
        watched.settle()
        assert page.evaluate(ringed) == 0
