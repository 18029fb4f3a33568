"""A folder of comparisons: what is found in it, the table of it, and what its server refuses."""

import io
import json
import os
import re
import shutil
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np
import pytest
from page_browser import opened
from PIL import Image
from workbench_page import Served, application, serving, written

from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError
from endoct.fusion.result import CellScores, Overlap, PairScores
from endoct.workbench.page.collection import collection_html, read_collection, thumbnail
from endoct.workbench.page.opening import open_shown
from endoct.workbench.page.serving import Collection

HOSTILE = '<img src=x onerror="document.title=1">&'


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, small_specimen: Path) -> Path:
    """Two comparisons, one doubted and one not aligned, a recording, a damaged one, a specimen, and other things."""
    top = tmp_path_factory.mktemp("study") / "study 7"
    written(top / "first" / "bore-2", jaccard=0.5)
    written(top / "first" / "bore-10", jaccard=0.9, doubts=(Doubt("forced", "Forced."),))
    written(top / f"odd {HOSTILE}".replace("/", ":"), aligned=False, alignment=None, reason="Nothing stands out.")
    shutil.copytree(top / "first" / "bore-2" / "panoramas" / "oct.zarr", top / "oct.zarr")
    shutil.copytree(top / "first" / "bore-2", top / "damaged")
    (top / "damaged" / "result.json").write_text("{")
    shutil.copytree(small_specimen, top / "specimen")
    (top / "notes.txt").write_text("mine")
    (top / "empty").mkdir()
    return top


@pytest.fixture(scope="module")
def served(folder: Path) -> Iterator[Served]:
    with serving(folder) as found:
        yield found


def test_what_lies_in_a_folder(folder: Path):
    found = {entry.name: entry for entry in read_collection(folder)}
    odd = next(name for name in found if name.startswith("odd"))
    assert set(found) == {"first/bore-2", "first/bore-10", odd, "oct.zarr", "damaged", "specimen"}
    assert [found[name].kind for name in ("first/bore-2", "oct.zarr", "specimen")] == [
        "comparison", "recording", "specimen",
    ]  # fmt: skip
    assert (found["first/bore-10"].level, found["first/bore-10"].jaccard) == ("doubted", 0.9)
    assert (found[odd].level, found[odd].jaccard, found[odd].dice) == ("unaligned", None, None)
    assert found["specimen"].what.startswith("preset learning, seed 22, bone ")
    assert found["damaged"].fault
    assert "\n" not in found["damaged"].fault
    assert [name for name, entry in found.items() if not entry.can_be_opened] == ["damaged", "specimen"]


def test_the_table_says_how_many_cells_agree_and_how_far_it_is_trusted(tmp_path: Path):
    cells = CellScores(reference="endoscope", other="oct", of_reference=23, of_other=27, matched=12)
    for name, interval in (("known", (0.6, 0.75)), ("hardly-known", (0.4, 0.75))):
        grid = Overlap(jaccard=0.69, dice=0.8, jaccard_interval=interval)
        written(tmp_path / name, jaccard=0.69, dice=0.8, scores=PairScores(grid=grid, cells=cells))
    entries = {entry.name: entry for entry in read_collection(tmp_path)}
    assert {name: entry.level for name, entry in entries.items()} == {"known": "trusted", "hardly-known": "uncertain"}
    page = str(collection_html("many", tuple(entries.values()), "v"))
    assert page.count("12 <small>of 23 and 27</small>") == 2
    assert '<span class="level uncertain" title="Aligned, but the score is uncertain. Jaccard 0.69' in page
    assert "confidence" not in page


def test_nothing_to_show_is_refused(tmp_path: Path):
    (tmp_path / "other").mkdir()
    for path in (tmp_path, tmp_path / "missing"):
        with pytest.raises(EndoctError, match="cannot be shown"):
            read_collection(path)


def test_links_are_not_followed(folder: Path, tmp_path: Path):
    written(tmp_path / "inside" / "own")
    (tmp_path / "inside" / "elsewhere").symlink_to(folder, target_is_directory=True)
    (tmp_path / "inside" / "back").symlink_to(tmp_path, target_is_directory=True)
    shutil.copytree(folder / "first" / "bore-2", tmp_path / "inside" / "linked")
    shutil.rmtree(tmp_path / "inside" / "linked" / "panoramas")
    (tmp_path / "inside" / "linked" / "panoramas").symlink_to(folder / "first" / "bore-2" / "panoramas")
    entries = read_collection(tmp_path / "inside")
    assert [entry.name for entry in entries] == ["linked", "own"]
    with pytest.raises(EndoctError, match="is a link"):
        thumbnail(entries[0])
    with application(tmp_path / "inside") as served:
        assert served.get("/at/linked/")[0] == 500
        assert served.get("/at/own/")[0] == 200
        for name in ("elsewhere", "elsewhere/first/bore-2", "back/inside/own"):
            assert served.get(f"/at/{name}/")[0] == 404


def test_thumbnails_show_the_wall(folder: Path):
    for entry in read_collection(folder):
        if entry.fault:
            continue
        picture = np.asarray(Image.open(io.BytesIO(thumbnail(entry))).convert("RGB")).astype(int)
        assert picture.shape[0] >= 96
        assert picture.std() > 5
    (comparison,) = [entry for entry in read_collection(folder) if entry.name == "first/bore-2"]
    shown = np.asarray(Image.open(io.BytesIO(thumbnail(comparison))))
    assert shown[..., 3].min() == 0  # not observed, and between strips
    truth = np.asarray(Image.open(io.BytesIO(thumbnail(read_collection(folder / "specimen" / "..")[-1]))))
    assert truth.shape[2] == 4


def test_a_page_that_opens_slowly_holds_up_no_other(folder: Path, monkeypatch: pytest.MonkeyPatch):
    collection = Collection(folder, read_collection(folder))
    quick, slow = (collection.called(name) for name in ("first/bore-2", "first/bore-10"))
    assert quick is not None
    assert slow is not None
    page, may_go_on = collection.page(quick, "localhost", 1), Event()

    def opened_late(path: Path) -> Any:
        may_go_on.wait()
        return open_shown(path)

    monkeypatch.setattr("endoct.workbench.page.serving.open_shown", opened_late)
    with ThreadPoolExecutor(3) as pool:
        asked = [pool.submit(collection.page, slow, "localhost", 1) for _ in range(2)]
        try:
            assert pool.submit(collection.page, quick, "localhost", 1).result(60) is page
        finally:
            may_go_on.set()
        one, two = (each.result() for each in asked)
    assert one is two


def test_each_has_its_page_under_an_address_of_its_own(served: Served):
    status, table, headers = served.get("/")
    assert status == 200
    assert "default-src 'none'" in headers["content-security-policy"]
    assert table.decode().count("<tr data-kind=") == 6
    for name, title in (("first/bore-2", "bore-2: endoscope and oct"), ("oct.zarr", "oct")):
        status, page, _ = served.get(f"/at/{name}/")
        assert status == 200
        assert f"<title>endoct: {title}</title>" in page.decode()
        assert '<a class="above" href="/">' in page.decode()
        assert json.loads(served.get(f"/at/{name}/description.json")[1])["title"] == title
        assert served.get(f"/at/{name}/tiles/v/oct-image/0/0_0.png")[2]["content-type"] == "image/png"
        assert served.get(f"/at/{name}/page.js")[0] == 200
    assert served.get("/at/first/bore-2")[0] in (301, 302, 307)
    assert served.get("/thumbnails/v/0.png")[0] in (200, 500)


@pytest.mark.parametrize(
    "path",
    [
        "/at/", "/at/first/", "/at/first", "/at/bore-2/", "/at/../notes.txt", "/at/first/bore-2/../../../notes.txt",
        "/at/first/bore-2/result.json", "/at/first/bore-2/comparison.zarr/zarr.json", "/at/%2e%2e/", "/notes.txt",
        "/at/first%2f..%2f..%2fetc%2fpasswd/", "/at//etc/passwd", "/at/specimen/", "/at/damaged/", "/at/first/bore-22/",
        "/thumbnails/v/99.png", "/thumbnails/v/-1.png", "/thumbnails/v/..%2f0.png", "/thumbnails/v/x.png", "/at/%ff/",
    ],
)  # fmt: skip
def test_no_path_leads_elsewhere(served: Served, path: str):
    status, body, _ = served.get(path)
    assert status == 404
    assert len(body) < 200


def test_foreigners_are_refused(served: Served):
    for path in ("/", "/at/first/bore-2/", "/at/first/bore-2/description.json", "/thumbnails/v/0.png"):
        assert served.get(path, Host="evil.example")[0] == 403
        assert served.get(path, Origin="http://evil.example")[0] == 403
        assert served.get(path, method="POST")[0] in (403, 405)


def test_what_is_new_is_there_when_the_table_is_asked_for_again(tmp_path: Path):
    written(tmp_path / "many" / "one")
    with application(tmp_path / "many") as served:
        assert served.get("/at/two/")[0] == 404
        written(tmp_path / "many" / "two")
        assert b"two" in served.get("/")[1]
        assert served.get("/at/two/")[0] == 200


def test_names_that_no_text_can_hold(tmp_path: Path):
    name = os.fsdecode(b"caf\xe9")
    try:
        written(tmp_path / "many" / name)
    except OSError:
        pytest.skip("this disk has no such names")
    page = collection_html("many", read_collection(tmp_path / "many"), "v")
    assert "/at/caf%E9/" in page
    page.encode()


@pytest.mark.parametrize("name", [b"caf\xe9", b"two\nlines", b"per%cent", b"a?b#c", "Größe".encode()])
def test_a_page_is_served_whatever_its_folder_is_called(name: bytes, tmp_path: Path):
    try:
        written(tmp_path / "many" / os.fsdecode(name))
    except OSError:
        pytest.skip("this disk has no such names")
    with application(tmp_path / "many") as served:
        address = re.search(r'href="(/at/[^"]+)"', served.get("/")[1].decode())
        assert address is not None
        assert served.get(address[1])[0] == 200
        assert served.get(address[1].rstrip("/"))[0] in (301, 302, 307)
        assert json.loads(served.get(f"{address[1]}description.json")[1])["sides"] == ["endoscope", "oct"]
        assert served.get(f"{address[1]}tiles/v/oct-image/0/0_0.png")[2]["content-type"] == "image/png"
        assert served.get(f"{address[1]}nothing")[0] == 404


def test_thumbnails_are_those_of_the_table_they_are_in(tmp_path: Path):
    written(tmp_path / "many" / "b")
    with application(tmp_path / "many") as served:
        version = re.search(r"/thumbnails/(\w+)/0", served.get("/")[1].decode())
        assert version is not None
        shown = served.get(f"/thumbnails/{version[1]}/0.png")[1]
        written(tmp_path / "many" / "a")
        (tmp_path / "many" / "a" / "result.json").unlink()
        served.get("/")
        assert served.get(f"/thumbnails/{version[1]}/0.png")[1] == shown


def test_the_table_in_a_browser(chromium: Any, served: Served):
    with opened(chromium, served.url, ready="table.folder") as watched:
        page = watched.page
        rows, names = page.locator("tbody tr"), page.locator("tbody tr:not([hidden]) td:nth-child(2)")
        assert page.locator("[role=status]").inner_text() == "6 of 6"
        assert page.locator("body > img, td a img").count() == 0
        assert page.locator("img").count() == 5  # none of what is damaged, and no name made another
        page.get_by_role("button", name="Jaccard").click()
        assert names.all_inner_texts()[:2] == ["first/bore-2", "first/bore-10"]
        page.get_by_role("button", name="Jaccard").click()
        assert names.all_inner_texts()[:2] == ["first/bore-10", "first/bore-2"]  # what has none stays last
        page.get_by_role("button", name="name", exact=True).click()
        ordered = names.all_inner_texts()
        assert ordered.index("first/bore-2") < ordered.index("first/bore-10")
        page.locator("select").select_option("doubted")
        assert names.all_inner_texts() == ["first/bore-10"]
        page.locator("select").select_option("")
        page.locator("input[type=search]").fill("bore-2 trusted")
        assert names.all_inner_texts() == ["first/bore-2"]
        assert page.locator("[role=status]").inner_text() == "1 of 6"
        page.wait_for_function("() => document.querySelector('tbody tr:not([hidden]) img').naturalWidth > 50")
        rows.filter(has_text="bore-2").locator("td").nth(4).click()
        page.wait_for_selector(".pane[data-z-mm]")
        assert page.title() == "endoct: bore-2: endoscope and oct"
        watched.settle()
        page.locator("a.above").click()
        page.wait_for_selector("table.folder")


@pytest.mark.parametrize("size", [(1280, 800), (820, 1180)])
def test_the_table_fits(chromium: Any, served: Served, size: tuple[int, int]):
    with opened(chromium, served.url, ready="table.folder") as watched:
        watched.page.set_viewport_size({"width": size[0], "height": size[1]})
        assert watched.page.evaluate("() => document.documentElement.scrollWidth") <= size[0]
