"""What the panes show is in the address, so that a link or a bookmark brings it back."""

from pathlib import Path
from typing import Any
from urllib.parse import quote

import pytest
from page_browser import Watched, opened
from workbench_page import Served, serving


def address(watched: Watched) -> str:
    """Return the address once it notes a view."""
    for _ in range(60):
        if "#view=" in watched.page.url:
            return str(watched.page.url)
        watched.page.wait_for_timeout(100)
    pytest.fail("the address notes nothing")


def test_a_link_brings_back_what_was_shown(chromium: Any, served: Served):
    with opened(chromium, served.url) as watched:
        page = watched.page
        assert "#view=" not in page.url  # as it is for everybody
        page.select_option(".pane >> nth=0 >> select >> nth=0", "oct-cells")
        page.select_option(".pane >> nth=1 >> select >> nth=1", "swipe")
        page.click(".toolbar >> text=numbers")
        for _ in range(3):
            page.keyboard.press("+")
        page.locator(".pane .view").first.click(position={"x": 70, "y": 80})
        watched.settle()
        page.wait_for_timeout(700)
        link, before = address(watched), watched.panes()
    with opened(chromium, link) as again:
        page = again.page
        after = again.panes()
        assert page.locator(".pane >> nth=0 >> select >> nth=0").input_value() == "oct-cells"
        assert page.locator(".pane >> nth=1 >> select >> nth=1").input_value() == "swipe"
        assert page.locator(".toolbar >> text=numbers").get_attribute("aria-pressed") == "false"
        assert page.locator(".drawer").is_visible()  # the place that was marked
        for one, other in zip(before, after, strict=True):
            assert other["zMm"] == pytest.approx(one["zMm"], abs=1e-4)
            assert other["mmPerPx"] == pytest.approx(one["mmPerPx"], rel=1e-4)


@pytest.mark.parametrize(
    "view",
    [
        "",
        "{",
        "null",
        "[]",
        '{"panes": 3}',
        '{"panes": [null, {"layer": "<b>", "second": "x", "mode": "y", "share": 1}]}',
        '{"panes": [{"layer": "oct-image", "second": "oct-image", "mode": "toString", "share": 1}]}',
        '{"view": {"theta_rad": null, "z_mm": 1e400, "mm_per_px": -1}, "pinned": {"side": "ct"}}',
        '{"outlines": ["../x"], "colours": {"oct-image": {"map": "constructor", "low": 0, "high": 1}}}',
        '{"colours": {"oct-image": {}}}',
        '{"colours": {"oct-image": null}}',
    ],
)
def test_nonsense_in_the_address_does_no_harm(chromium: Any, served: Served, view: str):
    with opened(chromium, f"{served.url}#view={quote(view)}") as watched:
        assert watched.page.locator(".pane").count() == 3


def test_it_holds_for_the_file_too(chromium: Any, comparison: Path):
    with serving(comparison) as found, opened(chromium, found.url) as watched:
        watched.page.keyboard.press("o")
        assert "outlines%22%3A%5B%5D" in address(watched)
