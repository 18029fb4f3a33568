"""What to do next, on the page in a real browser: its tools open, and words are explained."""

from pathlib import Path
from typing import Any

import pytest
from page_browser import opened
from workbench_page import serving, written

from endoct.base.doubt import Doubt


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
