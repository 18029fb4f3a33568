"""Notes on places in a real browser: written, changed, taken away and saved by keys alone, and never lost."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mock_comparison import Kind, write_comparison
from page_browser import Watched, opened
from workbench_page import PAIR, Served, post, serving, written

from endoct.fusion.files.session import read_session

HTML = '=<img src=x onerror="document.title=1">'
TEXTS = "() => [...document.querySelectorAll('.notes tbody input')].map(each => each.value)"
FOCUSED = """() => {
  const { innerText, className } = document.activeElement;
  return document.activeElement.getAttribute('aria-label') ?? (innerText || className);
}"""
WATCH = """() => {
  window.drawn = [];
  const fill = CanvasRenderingContext2D.prototype.fillText;
  const panes = [...document.querySelectorAll('.pane')];
  CanvasRenderingContext2D.prototype.fillText = function (text, x, y) {
    window.drawn.push([panes.findIndex(pane => pane.contains(this.canvas)), text, Math.round(x)]);
    fill.call(this, text, x, y);
  };
}"""
"""Note what is written on the panes, by pane, and where."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return written(tmp_path / "specimen-9")


@pytest.fixture
def page(chromium: Any, folder: Path) -> Iterator[Watched]:
    with serving(folder) as served, opened(chromium, served.url) as watched:
        yield watched


def press(watched: Watched, *keys: str) -> None:
    for key in keys:
        watched.page.keyboard.press(key)


def note(watched: Watched, text: str, *keys: str) -> None:
    """Move the cursor by keys, and note a text there."""
    press(watched, *keys, "Enter")
    assert watched.page.evaluate(FOCUSED) == "the new note"
    watched.page.keyboard.insert_text(text)
    press(watched, "Enter")


def go_to(watched: Watched, label: str, key: str = "Tab") -> None:
    """Have a key reach what has this label."""
    for _ in range(60):
        press(watched, key)
        if watched.page.evaluate(FOCUSED) == label:
            return
    pytest.fail(f"{label} is not reached")


def drawn(watched: Watched) -> set[tuple[int, str, int]]:
    watched.page.evaluate("() => { window.drawn = []; }")
    press(watched, "ArrowRight", "ArrowLeft")
    watched.page.wait_for_timeout(100)
    return {tuple(one) for one in watched.page.evaluate("() => window.drawn")}


def save(watched: Watched) -> None:
    """Save from the last note in the list."""
    go_to(watched, "save session", "Shift+Tab")
    press(watched, "Enter")


def test_a_note_is_written_changed_and_saved_by_keys_alone(page: Watched, folder: Path):
    page.page.evaluate(WATCH)
    press(page, "n", "c")
    note(page, f" {HTML}\x07 ", *["ArrowRight"] * 3)
    width_px, mm_per_px = page.page.locator(".view").first.evaluate("e => e.clientWidth"), page.panes()[0]["mmPerPx"]
    turn_px = 2 * 3.14159265 * 1.25 / mm_per_px
    note(page, "seam", *["ArrowUp"] * 2, *["ArrowLeft"] * 3, *["Shift+ArrowLeft"] * round(turn_px / 2 + 2))
    assert page.page.evaluate(TEXTS) == [HTML, "seam"]
    shown = drawn(page)
    assert {(k, text) for k, text, _ in shown if text.startswith(("1 =<img", "2 seam"))} >= {
        (k, "2 seam") for k in range(3)
    }
    assert {k for k, text, _ in shown if text.startswith("1 =<img")} == {0, 1, 2}
    on_first = sorted(x for k, text, x in shown if (k, text) == (0, "2 seam"))
    assert on_first[-1] - on_first[0] > width_px / 2  # on both edges of the turn
    assert on_first[0] > 0  # the text within the pane
    # the cursor is on the second note, beyond 0°: Enter is for that
    press(page, "Enter")
    assert page.page.evaluate(FOCUSED) == "note 2"
    press(page, "End")
    page.page.keyboard.insert_text(" of θ")
    assert not page.page.evaluate("() => window.dispatchEvent(new Event('beforeunload', {cancelable: true}))")
    assert page.page.evaluate(TEXTS) == [HTML, "seam of θ"]  # who leaves has written it
    press(page, "c", "Enter")  # a place that gets no note
    press(page, "Enter")
    assert page.page.evaluate(FOCUSED) == "view"
    assert page.page.evaluate(TEXTS) == [HTML, "seam of θ"]
    note(page, "wrong", *["ArrowDown"] * 4)
    go_to(page, "delete note 3")
    press(page, "Enter")
    assert page.page.evaluate(TEXTS) == [HTML, "seam of θ"]
    press(page, "Control+z", "Control+z")  # it is there again, and as if it had never been
    assert page.page.evaluate(TEXTS) == [HTML, "seam of θ"]
    go_to(page, "delete note 2")
    save(page)
    page.page.wait_for_function("() => !/not saved/.test(document.querySelector('.notes h2').innerText)")
    first, second = read_session(folder / "session.json").notes
    assert (first.side, first.text, second.text) == ("a", HTML, "seam of θ")
    page.page.reload()
    page.page.wait_for_selector(".notes tbody tr")
    assert page.page.evaluate(TEXTS) == [HTML, "seam of θ"]
    assert page.page.title().startswith("endoct: specimen-9")
    with page.page.expect_download() as table:
        go_to(page, "CSV")
        press(page, "Enter")
    table.value.save_as(folder.parent / "notes.csv")
    head, row, *_ = (folder.parent / "notes.csv").read_text(encoding="utf-8").splitlines()
    assert head == "side,z_mm,theta_rad,note"
    side, z_mm, theta_rad, text = row.split(",")
    assert (side, text) == ("endoscope", '"\'=<img src=x onerror=""document.title=1"">"')  # no formula
    assert (float(z_mm), float(theta_rad)) == pytest.approx((first.place.z_mm, first.place.theta_rad), rel=1e-5)


def test_nothing_is_lost_to_another_window_or_a_slow_answer(page: Watched, folder: Path):
    held: list[Any] = []
    page.page.route("**/session.json*", lambda route: held.append(route))
    page.page.reload()
    page.settle()
    press(page, "n", "c")
    note(page, "mine", "ArrowUp")
    press(page, *["ArrowDown"] * 5, "Enter")
    page.page.keyboard.insert_text("half a")
    other = {"side": "b", "place": {"theta_rad": 6.2, "z_mm": 0.7}, "text": "of another"}
    (url,) = {watched.split("?")[0] for watched in page.asked if watched.endswith("/")}
    served = Served(int(url.split(":")[2].strip("/")))
    assert post(served, "/session.json", {"pairs": [], "notes": [other], "based_on": None})[0] == 200
    held[0].continue_()  # the answer knows of the other's note
    page.page.unroute("**/session.json*")
    page.page.wait_for_function("() => document.querySelectorAll('.notes tbody tr').length === 2")
    page.page.keyboard.insert_text(" sentence")
    press(page, "Enter")
    assert page.page.evaluate(TEXTS) == ["of another", "mine", "half a sentence"]
    # meanwhile the other one takes away what it wrote, and writes anew
    state = json.loads(served.get("/session.json")[1])
    assert (
        post(
            served, "/session.json", {"pairs": [PAIR], "notes": [{**other, "text": "anew"}], "based_on": state["saved"]}
        )[0]
        == 200
    )
    go_to(page, "delete note 3")
    page.page.route("**/session.json*", lambda route: held.append(route))
    save(page)
    go_to(page, "note 2")
    press(page, "End", "!")  # while it is saved
    held[-1].continue_()
    page.page.unroute("**/session.json*")
    page.page.wait_for_selector(".refused")
    assert "Another window saved meanwhile" in page.page.locator(".refused").first.inner_text()
    assert page.page.evaluate(TEXTS) == ["anew", "mine!", "half a sentence"]
    save(page)
    page.page.wait_for_function("() => !/not saved/.test(document.querySelector('.notes h2').innerText)")
    session = read_session(folder / "session.json")
    assert [one.text for one in session.notes] == ["anew", "mine!", "half a sentence"]
    assert [one.name for one in session.pairs] == ["rim"]
    page.errors[:] = [error for error in page.errors if "409" not in error]  # the browser's own line of it


def test_a_place_on_sides_that_are_not_aligned_is_on_its_own_side(chromium: Any, tmp_path: Path):
    folder = tmp_path / "unaligned"
    write_comparison(folder, Kind("endoscope", depth=False), Kind("oct"), aligned=False, doubts=())
    with serving(folder) as served, opened(chromium, served.url) as page:
        page.page.evaluate(WATCH)
        press(page, "m", "n")
        pressed = "names => names.map(each => each.getAttribute('aria-pressed')).join()"
        assert (
            page.page.locator(".toolbar button:text-matches('^(landmarks|notes)$')").evaluate_all(pressed)
            == "false,true"
        )
        box = page.page.locator(".view").first.bounding_box()
        page.page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        assert page.page.evaluate(FOCUSED) == "the new note"
        page.page.evaluate("() => document.activeElement.blur()")
        press(page, "Escape")  # the place waits for no note any more
        assert page.page.get_by_label("the new note").is_hidden()
        press(page, "c", "c")
        note(page, "here", "ArrowRight")
        assert {k for k, text, _ in drawn(page) if text == "1 here"} == {1, 2}  # both are of OCT
        go_to(page, "delete note 1")
        save(page)
        page.page.wait_for_function("() => !/not saved/.test(document.querySelector('.notes h2').innerText)")
    assert [one.side for one in read_session(folder / "session.json").notes] == ["b"]
