"""A mask drawn on the page with the pointer and with keys."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from page_browser import opened
from PIL import Image
from workbench_page import serving, written

pytestmark = pytest.mark.usefixtures("chromium")

ASKS_TO_STAY = "() => !window.dispatchEvent(new Event('beforeunload', {cancelable: true}))"
"""Whether a page that is left asks to be left."""


def drawn(folder: Path, name: str) -> Any:
    return np.asarray(Image.open(folder / "masks" / "endoscope" / f"{name}.png")) > 0


def test_a_mask_is_drawn_undone_and_saved(chromium: Any, tmp_path: Path):
    folder = written(tmp_path / "result")
    with serving(folder) as served, opened(chromium, served.url) as watched:
        page = watched.page
        page.keyboard.press("d")
        page.wait_for_selector(".masks:not([hidden])")
        page.select_option("[aria-label='over what']", "")
        view = page.locator(".pane .view").first.bounding_box()
        left, top = view["x"] + view["width"] / 2, view["y"] + view["height"] / 2
        before = watched.panes()

        def stroke(dx: float, dy: float, steps: int = 8) -> None:
            page.mouse.move(left + dx, top + dy)
            page.mouse.down()
            page.mouse.move(left + dx + 30, top + dy, steps=steps)
            page.mouse.up()

        stroke(-20, -20)
        stroke(-20, 30)
        assert page.locator(".masks small").first.inner_text() == "not saved"
        assert page.evaluate(ASKS_TO_STAY)  # what was drawn would be lost
        page.keyboard.press("Control+z")
        page.keyboard.press("Control+z")
        page.keyboard.press("Control+Shift+z")
        page.click(".masks >> text=save mask")
        page.wait_for_selector(".masks >> text=Saved. Score against it")
        one = drawn(folder, "me_1")
        page.keyboard.press("Control+Shift+z")
        page.keyboard.press("e")
        page.wait_for_selector(".masks button:has-text('erases')")
        stroke(-40, -20)  # what was drawn first is taken away in part
        page.select_option("[aria-label='with what']", "outline")
        page.click(".masks >> text=erases")
        for dx, dy in ((40, 40), (70, 40), (70, 70)):
            page.mouse.click(left + dx, top + dy)
        page.keyboard.press("Enter")
        page.click(".masks >> text=save mask")
        page.locator(".masks [aria-label='session']").wait_for()
        for _ in range(50):
            if (folder / "masks" / "endoscope" / "me_2.png").exists():
                break
            page.wait_for_timeout(100)
        two = drawn(folder, "me_2")
        assert watched.panes() == before  # drawing does not move the view
        assert one.any()
        assert (one & ~two).any()  # erased
        assert (two & ~one).any()  # the second stroke and the triangle
        page.keyboard.press("d")
        assert page.locator(".masks").is_hidden()


def test_what_was_drawn_is_not_lost_by_choosing_another_ground(chromium: Any, tmp_path: Path):
    folder = written(tmp_path / "result")
    with serving(folder) as served, opened(chromium, served.url) as watched:
        page = watched.page
        page.click(".toolbar >> text=draw")
        view = page.locator(".pane .view").first.bounding_box()
        page.mouse.move(view["x"] + 60, view["y"] + 60)
        page.mouse.down()
        page.mouse.move(view["x"] + 90, view["y"] + 60, steps=4)
        page.mouse.up()
        page.once("dialog", lambda dialog: dialog.dismiss())
        page.select_option("[aria-label='over what']", "")
        assert page.locator("[aria-label='over what']").input_value() == "cells"
        page.keyboard.press("Control+z")
        page.locator("[aria-label='on which side']").select_option("oct")
        assert page.locator("[aria-label='on which side']").input_value() == "oct"


def test_what_was_drawn_is_there_again_until_it_is_saved(chromium: Any, tmp_path: Path):
    folder = written(tmp_path / "result")
    with serving(folder) as served, opened(chromium, served.url) as watched:
        page = watched.page
        page.keyboard.press("d")
        page.select_option("[aria-label='over what']", "")
        view = page.locator(".pane .view").first.bounding_box()
        page.mouse.click(view["x"] + view["width"] / 2, view["y"] + view["height"] / 2)
        page.locator(".masks small", has_text="not saved").wait_for()
        page.once("dialog", lambda dialog: dialog.accept())
        page.reload()
        page.locator(".masks", has_text="here again").wait_for()
        assert page.locator("[aria-label='over what']").input_value() == ""
        page.click(".masks >> text=save mask")
        page.click(".masks >> text=show saved masks")
        page.wait_for_selector(".toolbar button:has-text('saved: me_1')")
        assert page.locator(".masks").is_hidden()  # nothing is left to go on with
        page.keyboard.press("d")
        page.click(".masks button:text-is('me_1')")
        page.locator(".masks", has_text="Jaccard index against me_1: endoscope 0.").wait_for()
        assert drawn(folder, "me_1").any()


def test_a_refusal_that_comes_late_is_not_said_of_what_was_drawn_since(chromium: Any, tmp_path: Path):
    folder = written(tmp_path / "result")
    with serving(folder) as served, opened(chromium, served.url) as watched:
        page = watched.page
        page.keyboard.press("d")
        page.wait_for_selector(".masks:not([hidden])")
        view = page.locator(".pane .view").first.bounding_box()
        asked = list[Any]()
        page.route("**/drawing.json*", lambda route: asked.append(route))
        for k in range(2):
            page.mouse.click(view["x"] + 60 + 30 * k, view["y"] + 60)
            while len(asked) <= k:
                page.wait_for_timeout(20)
        with page.expect_response("**/drawing.json*"):
            asked[1].continue_()
        with page.expect_response("**/drawing.json*"):
            asked[0].fulfill(status=409, body="too much is drawn")
        page.wait_for_timeout(1000)
        assert page.locator(".masks .refused").count() == 0
        watched.errors[:] = [one for one in watched.errors if "409" not in one]  # Chromium notes the refusal


def test_a_mask_is_saved_once_and_under_the_number_that_was_typed(chromium: Any, tmp_path: Path):
    folder = written(tmp_path / "result")
    with serving(folder) as served, opened(chromium, served.url) as watched:
        page = watched.page
        asked = list[Any]()
        page.route("**/masks.json*", lambda route: asked.append(route))
        page.keyboard.press("d")
        page.wait_for_selector(".masks:not([hidden])")
        page.select_option("[aria-label='over what']", "")
        view = page.locator(".pane .view").first.bounding_box()
        for k in range(3):
            page.mouse.click(view["x"] + view["width"] / 2 + 20 * k, view["y"] + view["height"] / 2)
            page.wait_for_timeout(100)
        assert [route.request.method for route in asked] == ["GET"]  # however much is drawn meanwhile
        session = page.locator(".masks [aria-label='session']")
        session.fill("7")
        with page.expect_response("**/masks.json*"):
            asked[0].continue_()
        page.wait_for_timeout(300)
        assert session.input_value() == "7"
        for _ in range(2):
            page.click(".masks >> text=save mask")
            page.wait_for_timeout(300)
        assert [route.request.method for route in asked] == ["GET", "POST"]
        page.route("**/masks.json*", lambda route: route.continue_())
        asked[1].continue_()
        page.wait_for_selector(".masks >> text=Saved. Score against it")
        page.wait_for_selector(".masks button:text-is('me_7')")
        assert drawn(folder, "me_7").any()
        assert session.input_value() == "1"  # the next one without a mask
