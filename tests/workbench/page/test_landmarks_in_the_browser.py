"""Landmarks in a real browser: a pair is placed, undone, made again, named, saved, and there again after loading."""

import json
import re
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mock_comparison import GRID, Kind, write_comparison
from page_browser import Watched, opened
from workbench_page import serving, written

from endoct.fusion.files.session import Note, Session, read_session
from endoct.fusion.files.store import load_comparison, save_comparison
from endoct.fusion.geometry.alignment import Alignment, Place
from endoct.workbench.page.opening import open_shown
from endoct.workbench.page.report import frozen_data, frozen_page

HTML = '<img src=x onerror="document.title=1">'
ELSEWHERE = Alignment(1.0, 0.25, 1.01, mirrored=True, confidence=0.6)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return written(tmp_path / "specimen-9")


@pytest.fixture
def page(chromium: Any, folder: Path) -> Iterator[Watched]:
    with serving(folder) as served, opened(chromium, served.url) as watched:
        yield watched


def click(watched: Watched, pane: int, dx: float = 0, dy: float = 0) -> None:
    box = watched.page.locator(".view").nth(pane).bounding_box()
    watched.page.mouse.click(box["x"] + box["width"] / 2 + dx, box["y"] + box["height"] / 2 + dy)
    watched.page.wait_for_timeout(60)  # so that two clicks are no double click


def place(watched: Watched, dx: float, dy: float, off_px: float = 0) -> None:
    """Place a pair in the panes of both sides, ``off_px`` lower on the second."""
    click(watched, 0, dx, dy)
    click(watched, 1, dx, dy + off_px)


def rows(watched: Watched) -> int:
    return int(watched.page.locator(".landmarks tbody tr").count())


def distances(watched: Watched, column: int) -> list[float]:
    """Return the distances in a column of the list, "now" 3 or "then" 4, once they are computed."""
    watched.page.wait_for_function(
        "() => [...document.querySelectorAll('.landmarks tbody tr')].every(r => r.cells[3].innerText !== '–')"
    )
    cells = watched.page.locator(f".landmarks tbody td:nth-child({column + 1})").all_inner_texts()
    return [float(text) for text in cells]


def test_a_pair_is_placed_undone_saved_and_loaded(page: Watched, folder: Path):
    assert page.page.locator(".landmarks").is_hidden()
    page.page.keyboard.press("m")
    mm_per_px = page.panes()[0]["mmPerPx"]
    click(page, 1, 20, 13)
    assert rows(page) == 0
    assert "pane of endoscope" in page.page.locator(".landmarks .hint").inner_text()
    page.page.keyboard.press("Control+z")  # the first end is a step of its own
    assert "and on the same place" in page.page.locator(".landmarks .hint").inner_text()
    place(page, 20, 3, off_px=10)
    assert rows(page) == 1
    assert distances(page, 3) == pytest.approx([10 * mm_per_px], rel=0.03)
    assert distances(page, 4) == [0.0]
    place(page, -20, -20, off_px=4)
    page.page.keyboard.press("Control+z")
    assert rows(page) == 1
    page.page.keyboard.press("Control+Shift+z")
    assert rows(page) == 2
    page.page.get_by_role("button", name="undo").click()
    page.page.get_by_role("button", name="redo").click()
    assert rows(page) == 2
    page.page.locator(".landmarks tbody select").nth(1).select_option("check")
    name = page.page.locator(".landmarks tbody input").first
    name.fill(HTML)
    name.press("Enter")
    error = page.page.locator(".landmarks .error")
    # there may be two before the server has judged that a pair checks
    page.page.wait_for_function(
        "() => [...document.querySelectorAll('.landmarks .error')].map(e => / by 1 pair/.test(e.innerText)).join() ==="
        " 'true,true'"
    )
    assert float(re.search(r"([\d.]+) mm, by 1 pair", error.first.inner_text())[1]) == pytest.approx(
        4 * mm_per_px, rel=0.05
    )
    assert float(re.search(r"([\d.]+) mm, by 1 pair", error.last.inner_text())[1]) == pytest.approx(
        6 * mm_per_px, rel=0.05
    )
    assert "not saved" in page.page.locator(".landmarks h2").inner_text()
    page.page.get_by_role("button", name="save session").click()
    page.page.wait_for_function("() => !/not saved/.test(document.querySelector('.landmarks h2').innerText)")
    session = read_session(folder / "session.json")
    assert [(pair.role, pair.name) for pair in session.pairs] == [("correct", HTML), ("check", "")]
    assert session.pairs[0].b.z_mm - session.pairs[0].a.z_mm == pytest.approx(10 * mm_per_px, rel=0.03)
    page.page.get_by_text("Compare with these landmarks").click()
    assert "--session" in page.page.locator(".landmarks code").inner_text()
    page.page.reload()
    page.page.wait_for_selector(".landmarks tbody tr")
    assert rows(page) == 2
    assert page.page.locator(".landmarks tbody input").first.input_value() == HTML
    assert page.page.locator("img").count() == 0
    assert page.page.title().startswith("endoct: specimen-9")


def test_pairs_placed_before_the_session_has_come_stay(page: Watched):
    page.page.keyboard.press("m")
    place(page, 20, 3)
    page.page.get_by_role("button", name="save session").click()
    page.page.wait_for_function("() => !/not saved/.test(document.querySelector('.landmarks h2').innerText)")
    held: list[Any] = []
    page.page.route("**/session.json*", lambda route: held.append(route))
    page.page.reload()
    page.settle()
    page.page.keyboard.press("m")
    place(page, -20, -20)
    assert rows(page) == 1
    held[0].continue_()
    page.page.wait_for_function("() => document.querySelectorAll('.landmarks tbody tr').length === 2")
    assert "not saved" in page.page.locator(".landmarks h2").inner_text()
    page.page.keyboard.press("Control+z")
    assert rows(page) == 1
    page.page.wait_for_function("() => !/not saved/.test(document.querySelector('.landmarks h2').innerText)")


def press(watched: Watched, *keys: str) -> None:
    for key in keys:
        watched.page.keyboard.press(key)


def test_a_pair_is_placed_and_undone_by_keys_alone(page: Watched):
    mm_per_px = page.panes()[0]["mmPerPx"]
    press(page, "m", "c", "ArrowRight", "ArrowRight", "ArrowUp", "Enter")
    assert "pane of oct" in page.page.locator(".landmarks .hint").inner_text()
    press(page, "c", "ArrowRight", "ArrowRight", *["Shift+ArrowDown"] * 6, "Enter")
    assert rows(page) == 1
    assert distances(page, 3) == pytest.approx([16 * mm_per_px], rel=0.03)
    press(page, "Control+z")
    assert rows(page) == 0
    press(page, "Enter", "Control+z")  # one end, taken back
    assert "and on the same place" in page.page.locator(".landmarks .hint").inner_text()
    press(page, "Escape")
    assert page.page.evaluate("document.activeElement === document.body")


def test_the_cursor_by_keys_stays_in_view_and_marks_a_place(page: Watched):
    before = page.panes()[0]
    press(page, "c", *["ArrowLeft"] * 25)
    page.settle()
    after = page.panes()[0]
    width_px = page.page.locator(".view").first.evaluate("e => e.clientWidth")
    moved_px = 250 - round(width_px / 2)
    assert moved_px > 0
    radius_mm = (before["mmPerPx"] * moved_px) / np.deg2rad((before["thetaDeg"] - after["thetaDeg"]) % 360)
    assert radius_mm == pytest.approx(GRID.radius_mm, rel=0.02)
    press(page, "Enter")
    page.page.wait_for_selector(".drawer:not([hidden])")


def test_a_pair_is_deleted_and_that_is_undone(page: Watched):
    page.page.get_by_role("button", name="landmarks").click()
    place(page, 0, 0)
    place(page, 30, 30)
    page.page.locator(".landmarks tbody tr").first.get_by_role("button", name="delete pair 1").click()
    assert rows(page) == 1
    page.page.get_by_role("button", name="undo").click()
    assert rows(page) == 2


def test_a_click_on_both_sides_at_once_places_nothing(page: Watched):
    page.page.keyboard.press("m")
    click(page, 2)
    assert "and on the same place" in page.page.locator(".landmarks .hint").inner_text()
    click(page, 0)
    click(page, 2)
    click(page, 0, 10)  # the same side again: placed anew
    assert rows(page) == 0
    page.page.keyboard.press("Escape")
    assert "and on the same place" in page.page.locator(".landmarks .hint").inner_text()


def test_places_are_those_of_either_side_itself(chromium: Any, tmp_path: Path):
    folder = written(tmp_path / "elsewhere")
    found = load_comparison(folder / "comparison.zarr")
    shutil.rmtree(folder / "comparison.zarr")
    save_comparison(replace(found, alignment=ELSEWHERE), folder / "comparison.zarr")
    with serving(folder) as served, opened(chromium, served.url) as page:
        page.page.keyboard.press("m")
        place(page, 15, 5)
        assert distances(page, 3) == pytest.approx([0.0], abs=0.002)
        page.page.get_by_role("button", name="save session").click()
        page.page.wait_for_function("() => !/not saved/.test(document.querySelector('.landmarks h2').innerText)")
    (pair,) = read_session(folder / "session.json").pairs
    assert ELSEWHERE.z_to_a(pair.b.z_mm) == pytest.approx(pair.a.z_mm, abs=1e-6)
    turned = float(ELSEWHERE.theta_to_a(pair.b.theta_rad)) - pair.a.theta_rad
    assert np.angle(np.exp(1j * turned)) == pytest.approx(0, abs=1e-6)


def test_sides_that_are_not_aligned_take_landmarks_too(chromium: Any, tmp_path: Path):
    folder = tmp_path / "unaligned"
    write_comparison(folder, Kind("endoscope", depth=False), Kind("oct"), aligned=False, doubts=())
    with serving(folder) as served, opened(chromium, served.url) as page:
        page.page.keyboard.press("m")
        place(page, 10, 10)
        page.page.wait_for_function("() => /1 landmark pair/.test(document.querySelector('.landmarks').innerText)")
        assert "1 landmark pair cannot establish an alignment" in page.page.locator(".landmarks .said").inner_text()
        place(page, -10, -30)
        page.page.wait_for_function("() => !/cannot establish/.test(document.querySelector('.landmarks').innerText)")


def test_a_file_that_changed_meanwhile_is_kept(page: Watched, folder: Path):
    page.page.keyboard.press("m")
    place(page, 0, 0)
    (folder / "session.json").write_text("mine")
    page.errors.clear()
    page.page.get_by_role("button", name="save session").click()
    page.page.wait_for_selector(".landmarks .refused")
    assert "is no session file" in page.page.locator(".landmarks .refused").inner_text()
    assert (folder / "session.json").read_text() == "mine"
    page.errors[:] = [error for error in page.errors if "409" not in error]  # the browser's own line of it
    page.page.evaluate("() => document.querySelector('.landmarks').remove()")


def test_the_offline_file_downloads_a_session(chromium: Any, folder: Path, tmp_path: Path):
    frozen = tmp_path / "report.html"
    shown = open_shown(folder)
    assert shown.session is not None
    noted = Session(shown.session.identities, (), (Note("b", Place(1.0, 0.5), HTML),))
    (folder / "session.json").write_bytes(noted.to_bytes())
    frozen.write_text(frozen_page(shown, shown.sections, frozen_data(shown)), encoding="utf-8")
    with opened(chromium, frozen.as_uri()) as page:
        page.page.keyboard.press("m")
        place(page, 12, 8)
        assert "endoct serve" in page.page.locator(".landmarks .said").inner_text()
        with page.page.expect_download() as saved:
            page.page.locator(".landmarks").get_by_role("button", name="save session").click()
        saved.value.save_as(tmp_path / "session.json")
    assert saved.value.suggested_filename == "session.json"
    session = read_session(tmp_path / "session.json")
    assert len(session.pairs) == 1
    assert session.notes == noted.notes
    assert session.sides == shown.session.identities
    assert json.loads((tmp_path / "session.json").read_text())["pairs"][0]["role"] == "correct"


def test_a_name_that_is_being_typed_stays_where_the_list_is_drawn_anew(page: Watched):
    held: list[Any] = []
    page.page.keyboard.press("m")
    page.page.route("**/landmarks.json*", lambda route: held.append(route))
    place(page, 20, 3)
    name = page.page.get_by_label("name of pair 1")
    name.fill("rim")
    name.press("ArrowLeft")
    while not held:
        page.page.wait_for_timeout(20)
    page.page.route("**/landmarks.json*", lambda route: route.continue_())
    held[0].continue_()
    distances(page, 3)
    page.page.keyboard.type("o")
    assert name.input_value() == "riom"


def test_a_session_that_could_not_be_read_is_asked_for_again(page: Watched, folder: Path):
    page.page.route("**/session.json*", lambda route: route.fulfill(status=503, body="not now"))
    page.page.reload()
    page.settle()
    page.page.keyboard.press("m")
    place(page, 20, 3)
    save = page.page.locator(".landmarks").get_by_role("button", name="save session")
    save.click()
    page.page.locator(".landmarks .refused", has_text="nothing was saved").wait_for()
    page.page.unroute("**/session.json*")
    save.click()
    page.page.wait_for_function("() => !/not saved/.test(document.querySelector('.landmarks h2').innerText)")
    assert len(read_session(folder / "session.json").pairs) == 1
    page.errors[:] = [one for one in page.errors if "503" not in one]  # Chromium notes the refusals
