"""One recording alone: `endoct unroll` leaves a report in the store, and `endoct report` writes it again."""

import hashlib
import shutil
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from mock_comparison import GRID
from page_browser import opened
from workbench_page import serving, written

from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError
from endoct.base.files.contents import differences, read_contents
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import load_panorama, save_panorama
from endoct.workbench.page.report import write_panorama_report, write_report


@pytest.fixture(scope="module")
def store(walls: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(shutil.copytree(walls / "oct" / "wall.zarr", tmp_path_factory.mktemp("recording") / "wall.zarr"))


def digests(folder: Path) -> dict[Path, str]:
    return {path: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.rglob("*") if path.is_file()}


def test_the_store_holds_its_report_and_is_read_as_before(store: Path):
    contents = read_contents(store)
    assert contents is not None
    assert dict(contents.parts) == {"figures": "figures", "report.html": "page"}
    assert str(differences(store, contents)) == ""
    assert {path.stem for path in (store / "figures").glob("*.png")} == {
        "panoramas", "frames-oct", "quality-oct", "numbers-oct",
    }  # fmt: skip
    assert len(list((store / "pictures").glob("oct-*.npz"))) == 6  # three frames, as recorded and undistorted
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with xr.open_zarr(store) as opened_store:
            assert "pictures" not in opened_store
    assert load_panorama(store).modality == "oct"
    page = (store / "report.html").read_text("utf-8")
    for said in ('id="figure-frames-oct"', 'id="figure-panoramas"', 'id="quality-oct"', "sha256", "pullback_pitch"):
        assert said.replace("_", " ") in page or said in page, said


def test_the_report_is_written_again_the_same(store: Path):
    before = digests(store)
    assert write_report(store) == store / "report.html"
    assert digests(store) == before
    (store / "report.html").unlink()
    write_report(store)
    assert digests(store) == before


def test_a_panorama_without_its_pictures_is_still_one(store: Path, tmp_path: Path):
    shutil.copytree(store, tmp_path / "bare.zarr")
    shutil.rmtree(tmp_path / "bare.zarr" / "pictures")
    assert load_panorama(tmp_path / "bare.zarr").modality == "oct"
    page = write_report(tmp_path / "bare.zarr").read_text("utf-8")
    assert 'id="figure-panoramas"' in page
    assert 'id="figure-frames-oct"' not in page


def test_a_page_that_somebody_changed_is_left_as_it_is(store: Path):
    page = store / "report.html"
    own = page.read_bytes()
    try:
        page.write_bytes(own.replace(b"<h1>", b"<h1>My notes: "))
        edited = page.read_bytes()
        with pytest.raises(EndoctError, match="changed since"):
            write_report(store)
        assert page.read_bytes() == edited
    finally:
        page.write_bytes(own)


def test_a_panorama_inside_of_a_comparison_gets_none(tmp_path: Path):
    folder = written(tmp_path / "comparison")
    before = digests(folder)
    with pytest.raises(EndoctError, match="has no report of its own"):
        write_report(folder / "panoramas" / "oct.zarr")
    assert digests(folder) == before


def test_in_the_browser_frames_and_quality_are_there_from_the_file_and_served(chromium: Any, store: Path):
    with serving(store) as served:
        for url in ((store / "report.html").as_uri(), served.url):
            with opened(chromium, url) as page:
                assert page.page.title() == "endoct: wall: oct"
                box = page.page.locator(".view").first.bounding_box()
                page.page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
                page.page.wait_for_selector(".drawer figure")
                captions = page.page.locator(".drawer figcaption").all_inner_texts()
                assert any("outer face of the capillary" in text and "wall" in text for text in captions)
                page.page.locator("#quality-oct > summary").click()
                assert page.page.locator("#quality-oct canvas").first.is_visible()


def test_no_text_of_a_store_becomes_markup(tmp_path: Path):
    hostile = "</script><img src=x onerror=alert(1)>\u202e\x1b[31m"
    made = Panorama(
        GRID, np.ones(GRID.shape, np.float32), None, np.ones(GRID.shape, np.bool_), np.ones(GRID.shape, np.float32),
        "oct", True, True, "slice", {"slice_z_mm": np.arange(3.0)},
        provenance={key: {hostile: {hostile: [hostile]}} for key in ("acquisition", "parameters", "versions")}
        | {"inputs": {hostile: hostile}},
        notes=(hostile,), doubts=(Doubt("odd", hostile, side=hostile),),
    )  # fmt: skip
    save_panorama(made, tmp_path / "wall.zarr")
    source = write_panorama_report(tmp_path / "wall.zarr", made).read_text("utf-8")
    text = source[: source.index('<script type="application/json"')]
    assert text.count("&lt;/script&gt;&lt;img src=x onerror=alert(1)&gt;") >= 10
    assert "<img src=x" not in source
    assert text.replace("\n", "").isprintable()
    assert "1 doubt. Unrolled." in text
