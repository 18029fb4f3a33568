"""The marked place in frames as recorded: where the plug-in's table has it, around the circle, and nowhere else."""

import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mock_comparison import mock_pictures
from page_browser import Watched, opened
from PIL import Image
from workbench_page import serving, written

from endoct.modalities.contract import Seen
from endoct.workbench.report.pictures import save_pictures

N_THETA = 360
LEFT, TOP, RIGHT, BELOW = 40, 4, 6, 28
"""Margins of a picture on its canvas, px."""


def shown(folder: Path, rotation_rad: np.ndarray, depth_mm: float) -> Path:
    """Write a comparison whose B-scan sees θ at ``rotation_rad`` (360,) and ``depth_mm``."""
    made = written(folder)
    raw, flat = mock_pictures()
    xy = np.stack([rotation_rad, np.full(N_THETA, depth_mm)], axis=1)[np.newaxis]
    for name in ("oct", "endoscope"):
        save_pictures(made / "pictures", name, "0007", [replace(raw, seen=Seen(np.array([1.4]), xy)), flat])
    return made


def target(page: Watched) -> tuple[float, float]:
    """Return the middle of the pink ring on the first picture, as shares of its width and height."""
    canvas = page.page.locator(".drawer canvas").first
    page.page.wait_for_timeout(300)
    image = np.asarray(Image.open(io.BytesIO(canvas.screenshot())).convert("RGB")).astype(int)
    inside = image[TOP : image.shape[0] - BELOW, LEFT : image.shape[1] - RIGHT]
    pink = np.abs(inside - (0xFF, 0x2F, 0xA0)).max(axis=2) < 60
    rows = np.flatnonzero(pink.sum(axis=1) >= 6)  # the ring and its ticks; a dashed line is 2 px wide
    assert rows.size, "nothing is marked"
    columns = np.flatnonzero(pink[rows].any(axis=0))
    return float(columns.mean() / inside.shape[1]), float((rows[0] + rows[-1]) / 2 / inside.shape[0])


def mark(page: Watched, theta_deg: float) -> None:
    """Mark the place at ``theta_deg`` in the middle of the wall, from a pane that shows all of it."""
    box = page.page.locator(".view").nth(1).bounding_box()
    now = page.panes()[1]
    radius_mm = 1.25
    x = np.radians(theta_deg - now["thetaDeg"]) * radius_mm / now["mmPerPx"]
    page.page.mouse.click(box["x"] + box["width"] / 2 + x, box["y"] + box["height"] / 2)
    page.page.wait_for_selector(".drawer figure")
    page.page.mouse.move(5, 5)


@pytest.mark.parametrize("theta_deg", [100.0, 250.0])
def test_the_place_is_marked_where_it_was_recorded(chromium: Any, tmp_path: Path, theta_deg: float):
    # the turn began at 40°, the other way around
    rotation = np.mod(np.radians(40 - np.arange(N_THETA)), 2 * np.pi)
    with serving(shown(tmp_path / "seen", rotation, 1.5)) as served, opened(chromium, served.url) as page:
        mark(page, theta_deg)
        x, y = target(page)
        assert "place not marked" not in page.page.locator(".drawer figure").first.inner_text()
        assert x == pytest.approx(np.radians((40 - theta_deg) % 360) / 6.2, abs=0.02)
        assert y == pytest.approx(1.5 / 2.5, abs=0.03)


def test_what_a_frame_does_not_see_is_not_marked(chromium: Any, tmp_path: Path):
    folder = shown(tmp_path / "unseen", np.full(N_THETA, np.nan), np.nan)
    with serving(folder) as served, opened(chromium, served.url) as page:
        mark(page, 100.0)
        with pytest.raises(AssertionError, match="nothing is marked"):
            target(page)


def test_a_server_that_is_gone_is_said_not_raised(chromium: Any, tmp_path: Path):
    folder = shown(tmp_path / "seen", np.zeros(N_THETA), 1.5)
    with serving(folder) as served, opened(chromium, served.url) as watched:
        page = watched.page
        page.route("**/*", lambda route: route.abort())
        box = page.locator(".view").nth(1).bounding_box()
        page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)  # asks for pictures
        page.keyboard.press("d")
        page.wait_for_selector(".masks:not([hidden])")
        page.mouse.click(box["x"] + 60, box["y"] + 60)  # asks for outlines
        page.wait_for_selector(".masks >> text=the server does not answer")
        watched.errors[:] = [one for one in watched.errors if "ERR_FAILED" not in one]  # Chromium notes what it lacks


def test_a_recording_is_read_once_however_the_pointer_moves(chromium: Any, tmp_path: Path):
    with serving(written(tmp_path / "result")) as served, opened(chromium, served.url) as watched:
        page = watched.page
        begun = list[Any]()

        def described(route: Any) -> None:
            description = route.fetch().json()
            for frames, recording in zip(description["frames"], ("recorded", ""), strict=True):
                frames |= {"recording": recording, "pictured": []}
            route.fulfill(json=description)

        page.route("**/description.json*", described)
        page.route("**/reading/**", lambda route: begun.append(route))
        page.reload()
        page.wait_for_selector(".pane[data-z-mm]")
        watched.settle()
        box = page.locator(".view").nth(1).bounding_box()

        def move() -> None:
            for k in range(10):
                page.mouse.move(box["x"] + 60 + 5 * k, box["y"] + 60)
                page.wait_for_timeout(50)

        page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        move()
        assert [route.request.method for route in begun] == ["POST"]
        begun[0].fulfill(json={"state": "failed", "share": 0, "said": "no such file"})
        page.locator(".drawer .said", has_text="no such file").wait_for()
        move()
        assert len(begun) == 1  # it is not begun anew unless that is asked for
        page.locator(".drawer button", has_text="every").click()
        move()
        assert [route.request.method for route in begun] == ["POST"] * 2


def test_a_picture_that_is_none_is_left_out_and_asked_for_again(chromium: Any, tmp_path: Path):
    folder = shown(tmp_path / "seen", np.zeros(N_THETA), 1.5)
    with serving(folder) as served, opened(chromium, served.url) as watched:
        page = watched.page

        def broken(route: Any) -> None:
            first, *others = route.fetch().json()
            route.fulfill(json=[first | {"image": "data:image/png;base64,AAAA"}, *others])

        page.route("**/pictures/**", broken)
        mark(watched, 100.0)
        page.wait_for_timeout(300)
        some = page.locator(".drawer figure").count()
        page.unroute("**/pictures/**")
        box = page.locator(".view").nth(1).bounding_box()
        page.mouse.move(box["x"] + 60, box["y"] + 60)
        page.wait_for_function("some => document.querySelectorAll('.drawer figure').length === 2 * some", arg=some)
