"""What the server answers, and what it refuses."""

import io
import json
import shutil
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pytest
from PIL import Image
from workbench_page import Served, written

from endoct.base.errors import EndoctError
from endoct.workbench.page.opening import open_shown
from endoct.workbench.page.serving import listening_socket, name_in_browsers
from endoct.workbench.page.shown import Shown
from endoct.workbench.page.wall import Tile


def test_the_page_and_its_description(served: Served):
    status, page, headers = served.get("/")
    assert (status, headers["content-type"]) == (200, "text/html; charset=utf-8")
    assert b"page.js" in page
    status, text, _ = served.get("/description.json")
    description = json.loads(text)
    assert description["title"] == "specimen-7: endoscope and oct"
    assert [layer["key"] for layer in description["layers"]] == [
        "endoscope-image", "endoscope-cells", "oct-image", "oct-relief", "oct-cells", "difference",
    ]  # fmt: skip
    assert description["panes"] == ["endoscope-image", "oct-relief", "difference"]


def test_a_tile_is_a_picture_with_what_was_not_observed_transparent(served: Served):
    status, png, headers = served.get("/tiles/v/endoscope-image/0/0_0.png")
    assert (status, headers["content-type"]) == (200, "image/png")
    picture = Image.open(io.BytesIO(png))
    assert (picture.mode, picture.width) == ("P", 258)
    alpha = np.asarray(picture.convert("LA"))[..., 1]
    rows_mm = 3.0 / alpha.shape[0]
    assert not alpha[: int(0.25 / rows_mm)].any()  # the mock's first six rows
    assert (alpha[int(0.35 / rows_mm) : -3] == 255).all()
    picture = Image.open(io.BytesIO(served.get("/tiles/v/difference/0/0_0.png")[1]))
    assert picture.mode == "P"
    assert picture.info["transparency"] == 255


def test_tiles_of_a_row_are_those_one_by_one(comparison: Path):
    shown = open_shown(comparison)
    for layer in shown.description.layers:
        level = min(2, layer.finest_level)
        for row in range(shown.wall.rows_of_tiles(level)):
            for column, tile in enumerate(shown.row_of_tiles(layer.key, level, row)):
                assert tile.tobytes() == shown.tile(layer.key, Tile(level, column, row)).tobytes()


def test_values_are_those_of_the_place(served: Served):
    inside = json.loads(served.get("/values.json?theta_rad=2.0&z_mm=1.5")[1])
    assert inside["oct-relief"] == pytest.approx(0.6, abs=0.05)
    assert json.loads(served.get(f"/values.json?theta_rad={2.0 + 20 * np.pi}&z_mm=1.5")[1]) == inside
    assert json.loads(served.get("/values.json?theta_rad=2&z_mm=2.05")[1])["oct-relief"] is None  # not observed
    assert json.loads(served.get("/values.json?theta_rad=2&z_mm=99")[1])["oct-relief"] is None


@pytest.mark.parametrize(
    "path",
    [
        "/../result.json", "/..%2fresult.json", "/%2e%2e/result.json", "/result.json", "/comparison.zarr/zarr.json",
        "//etc/passwd", "/page.js/../../../server.py", "/server.py", "/bundle/page.js", "/notices.txt/..", "/%00",
        "/tiles/v/../../description.json/0/0_0.png", "/tiles/v/oct-image%2f..%2fx/0/0_0.png",
    ],
)  # fmt: skip
def test_no_path_leads_elsewhere(served: Served, path: str):
    status, body, _ = served.get(path)
    assert status == 404
    assert len(body) < 200
    assert b"endoct" not in body


@pytest.mark.parametrize(
    "tile",
    ["0/1_0", "0/0_9", "99/0_0", "9999999999/0_0", f"{'9' * 5000}/0_0", "8/65535_65535", "-1/0_0", "0/-1_0", "x/0_0",
     "0/0_0x", "1e3/0_0", "٣/0_0", "0/²_0"],
)  # fmt: skip
def test_a_tile_that_is_not_there_is_refused(served: Served, tile: str):
    status, body, _ = served.get(f"/tiles/v/oct-image/{quote(tile)}.png")
    assert status in (400, 404)
    assert len(body) < 300


def test_a_layer_that_is_not_there_is_refused(served: Served):
    status, body, _ = served.get("/tiles/v/%3Cscript%3E/0/0_0.png")
    assert status == 404
    assert b"there is no such layer" in body


@pytest.mark.parametrize("place", ["", "?theta_rad=1", "?theta_rad=nan&z_mm=1", "?theta_rad=inf&z_mm=1",
                                   "?theta_rad=1e300&z_mm=1", "?theta_rad=a&z_mm=b"])  # fmt: skip
def test_a_place_that_is_none_is_refused(served: Served, place: str):
    assert served.get(f"/values.json{place}")[0] == 404


@pytest.mark.parametrize("host", ["evil.example", "evil.example:80", "127.0.0.1", "127.0.0.1.evil.example:{port}", ""])
def test_a_foreign_name_is_refused(served: Served, host: str):
    status, body, _ = served.get("/description.json", Host=host.format(port=served.port))
    assert status in (400, 403)
    assert b"layers" not in body


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1", "https://127.0.0.1:{port}"])
def test_a_foreign_origin_is_refused(served: Served, origin: str):
    assert served.get("/description.json", Origin=origin.format(port=served.port))[0] == 403


def test_a_picture_on_another_page_is_refused(served: Served):
    assert served.get("/tiles/v/oct-image/0/0_0.png", Sec_Fetch_Site="cross-site")[0] == 403
    assert served.get("/tiles/v/oct-image/0/0_0.png", Sec_Fetch_Site="same-origin")[0] == 200


def test_the_names_of_this_machine_are_served(served: Served):
    for name in ("localhost", "127.0.0.1"):
        assert served.get("/description.json", Host=f"{name}:{served.port}")[0] == 200
    assert served.get("/description.json", Origin=f"http://127.0.0.1:{served.port}")[0] == 200


def test_where_memory_runs_out_one_line_says_so(served: Served, monkeypatch: pytest.MonkeyPatch):
    def full(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr(Shown, "pictures", full)
    status, said, _ = served.get("/pictures/v/oct/7.json")
    assert (status, said.decode().count("\n")) == (500, 0)
    assert said.startswith(b"memory ran out")


def test_nothing_can_be_written(served: Served):
    for method in ("POST", "PUT", "DELETE", "PATCH"):
        assert served.get("/description.json", method=method)[0] == 405


def test_every_answer_forbids_what_pages_do_not_need(served: Served):
    for path in ("/", "/page.js", "/nothing", "/description.json"):
        headers = served.get(path)[2]
        assert "default-src 'none'" in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
        assert "access-control-allow-origin" not in headers


def test_a_damaged_store_is_one_line(tmp_path: Path):
    folder = written(tmp_path / "damaged")
    for chunk in (folder / "comparison.zarr" / "mask" / "c").rglob("*"):
        if chunk.is_file():
            chunk.write_bytes(b"nonsense")
    with pytest.raises(EndoctError) as refused:
        open_shown(folder).outlines()
    assert "\n" not in str(refused.value)


def test_what_is_no_output_is_refused(tmp_path: Path):
    for path in (tmp_path, tmp_path / "missing"):
        with pytest.raises(EndoctError, match="cannot be shown"):
            open_shown(path)
    folder = written(tmp_path / "half")
    shutil.rmtree(folder / "panoramas")
    with pytest.raises(EndoctError):
        open_shown(folder)


@pytest.mark.parametrize(
    "host", ["0.0.0.0", "", "0", "0x0", "000.0.0.0", "0.0", "::", "::0", "0:0::", "::ffff:0.0.0.0"]
)
def test_it_listens_on_one_address_only(host: str):
    with pytest.raises(EndoctError, match="cannot listen on every address"):
        listening_socket(host, 0)


@pytest.mark.parametrize("host", ["127.1", "0x7f000001", "::ffff:127.0.0.1"])
def test_an_address_in_another_notation_is_called_as_browsers_write_it(host: str):
    with listening_socket(host, 0) as listening:
        assert name_in_browsers(host, listening) == "127.0.0.1"
    with listening_socket("localhost", 0) as listening:
        assert name_in_browsers("localhost", listening) == "localhost"


def test_a_name_that_cannot_be_is_refused():
    for host in ("a" * 70, "\ud800", "no such host"):
        with pytest.raises(EndoctError, match="no server can listen"):
            listening_socket(host, 0)


def test_a_port_that_is_taken_is_refused():
    with listening_socket("127.0.0.1", 0) as first:
        first.listen()
        with pytest.raises(EndoctError, match="no server can listen"):
            listening_socket("127.0.0.1", first.getsockname()[1])
    with pytest.raises(EndoctError, match="no server can listen"):
        listening_socket("127.0.0.1", 99_999)
