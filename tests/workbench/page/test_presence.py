"""A folder that is replaced or deleted while its page is open: the page is told so, and touches nothing else."""

import json
import re
import shutil
import socket
from pathlib import Path
from typing import Any

import pytest
from page_browser import opened
from workbench_page import PAIR, Served, application, post, serving, written

from endoct.base.errors import EndoctError
from endoct.base.files.files import held_folder
from endoct.base.files.output import new_output
from endoct.fusion.files.session import read_session
from endoct.workbench.page.opening import open_shown
from endoct.workbench.page.presence import Gone

SAVING = {"pairs": [PAIR], "based_on": None}
DATA = (
    "description.json", "outlines.json", "tiles/v/oct-relief/0/0_0.png", "values.json?theta_rad=2&z_mm=1.5", "present",
    "relief/v/oct-relief.bin", "reading/oct", "session.json",
)  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return written(tmp_path / "study" / "result")


def replace(folder: Path) -> Path:
    """Put another comparison in the place of one, and return where that lies now."""
    away = folder.with_name("away")
    folder.rename(away)
    written(folder, jaccard=0.123)
    return away


def output_of(served: Served, page: str = "/") -> str:
    found = re.search(rb'name="endoct-output" content="(\w+)"', served.get(page)[1])
    assert found is not None
    return found[1].decode()


def with_output(address: str, output: str) -> str:
    return f"{address}{'&' if '?' in address else '?'}of={output}"


@pytest.mark.parametrize("page", ["/", "/at/result/"], ids=["alone", "in a table"])
def test_a_page_never_gets_what_belongs_to_another_comparison(folder: Path, page: str) -> None:
    with application(folder if page == "/" else folder.parent) as served:
        first = output_of(served, page)
        for address in DATA:
            assert served.get(page + with_output(address, first))[0] in (200, 204)
        replace(folder)
        for address in DATA:
            for named in (with_output(address, first), address):
                status, said, _ = served.get(page + named)
                assert status == 410
                assert b"was replaced or deleted" in said
        second = output_of(served, page)
        assert second != first
        for address in DATA:
            assert served.get(page + with_output(address, first))[0] == 410
            assert served.get(page + with_output(address, second))[0] in (200, 204)


@pytest.mark.parametrize("page", ["/", "/at/result/"], ids=["alone", "in a table"])
def test_landmarks_are_not_saved_into_another_comparison(folder: Path, page: str) -> None:
    with application(folder if page == "/" else folder.parent) as served:
        first = output_of(served, page)
        away = replace(folder)
        for look in (lambda: None, lambda: output_of(served, page)):  # another window may load the page anew
            look()
            status, said = post(served, page + with_output("session.json", first), SAVING)
            assert status == 410
            assert "was replaced or deleted" in said
            assert not (folder / "session.json").exists()
            assert not (away / "session.json").exists()
        assert post(served, page + with_output("session.json", output_of(served, page)), SAVING)[0] == 200
        assert (folder / "session.json").exists()


@pytest.mark.parametrize("page", ["/", "/at/result/"], ids=["alone", "in a table"])
def test_a_folder_that_was_deleted_stays_so(folder: Path, page: str) -> None:
    with application(folder if page == "/" else folder.parent) as served:
        first = output_of(served, page)
        shutil.rmtree(folder)
        for address in ("session.json", "landmarks.json"):
            status, said = post(served, page + with_output(address, first), SAVING)
            assert status == 410
            assert "was replaced or deleted" in said
        assert served.get(page)[0] == 410
        assert not folder.exists()


def test_what_is_put_back_is_served_again(folder: Path) -> None:
    with application(folder) as served:
        first = output_of(served)
        away = replace(folder)
        assert served.get(with_output("/description.json", first))[0] == 410
        shutil.rmtree(folder)
        away.rename(folder)
        assert output_of(served) == first
        assert served.get(with_output("/description.json", first))[0] == 200


def test_saving_landmarks_and_reports_makes_it_no_other(folder: Path) -> None:
    shown = open_shown(folder)
    with application(folder) as served:
        assert post(served, "/session.json", SAVING)[0] == 200
    (folder / "report.html").write_text("written anew")
    shown.origin.check_present()
    (folder / "result.json").write_text((folder / "result.json").read_text() + "\n")
    with pytest.raises(Gone):
        shown.origin.check_present()


def test_nothing_is_saved_where_the_folder_is_moved_meanwhile(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shown = open_shown(folder)
    assert shown.session is not None
    moved: list[Path] = []

    def moving(*of: Any, **named: Any) -> Any:
        moved.append(replace(folder))
        return new_output(*of, **named)

    monkeypatch.setattr("endoct.workbench.page.sessions.new_output", moving)
    with pytest.raises(Gone):
        shown.session.save(json.dumps(SAVING).encode())
    assert not (folder / "session.json").exists()
    assert not (moved[0] / "session.json").exists()


def test_nothing_is_made_in_a_held_folder_that_is_removed(tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    with held_folder(folder) as held:
        with new_output(held / "file", "session") as scratch:
            scratch.write_text("here")
        assert (folder / "file").read_text() == "here"
        shutil.rmtree(folder)
        with pytest.raises(EndoctError, match="cannot be written"), new_output(held / "file", "session"):
            pass
    assert not folder.exists()
    with pytest.raises(EndoctError, match="is no folder"), held_folder(folder):
        pass


def test_a_page_that_is_closed_while_it_saves_leaves_no_trace(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with serving(folder) as served:
        for _ in range(3):
            with socket.create_connection(("127.0.0.1", served.port)) as page:
                head = (
                    f"POST /session.json HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\n"
                    f"Origin: http://127.0.0.1:{served.port}\r\nContent-Type: application/json\r\n"
                    "Content-Length: 900\r\n\r\n"
                )
                page.sendall(head.encode() + b'{"pairs"')
        assert served.get("/session.json")[0] == 200
    assert "".join(capfd.readouterr()) == ""
    assert not (folder / "session.json").exists()


def test_the_page_says_that_its_comparison_is_gone(folder: Path, chromium: Any, tmp_path: Path) -> None:
    with serving(folder) as served, opened(chromium, served.url) as watched:
        page = watched.page
        page.keyboard.press("m")
        for pane in (0, 1):
            box = page.locator(".view").nth(pane).bounding_box()
            page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
            page.wait_for_timeout(60)
        replace(folder)
        page.get_by_role("button", name="save session").click()
        page.wait_for_selector(".gone")
        assert "was replaced or deleted" in page.locator(".gone").inner_text()
        assert "Nothing was saved" in page.locator(".landmarks .refused").inner_text()
        with page.expect_download() as saved:
            page.get_by_role("button", name="save session").click()
        saved.value.save_as(tmp_path / "session.json")
        watched.errors.clear()  # the browser notes that it was refused
    assert len(read_session(tmp_path / "session.json").pairs) == 1
    assert not (folder / "session.json").exists()
