"""The server of `endoct open`: what it answers to its page, and to nobody else."""

import asyncio
import json
import os
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pytest
from starlette.requests import ClientDisconnect
from workbench_page import Served, application, post, serving

from endoct.base.errors import EndoctError
from endoct.base.files.contents import seal
from endoct.base.files.scratch import scratch_next_to
from endoct.workbench import summarise
from endoct.workbench.desk.desk import Desk
from endoct.workbench.desk.desk_app import desk_app, take_file
from endoct.workbench.page.notes import NAME
from endoct.workbench.running.outputs import POSE

OVER_A_SOCKET = pytest.mark.parametrize("served", [serving], indirect=True, ids=["socket"])


@pytest.fixture
def served(desk: Desk, request: pytest.FixtureRequest) -> Iterator[Served]:
    with getattr(request, "param", application)(lambda host, port: desk_app(desk, host, port)) as found:
        yield found


@pytest.fixture
def address(desk: Desk, study: Path) -> str:
    """The address of the page of the study."""
    return desk.open(study).address


@OVER_A_SOCKET
def test_the_pages_and_what_they_ask_for(served: Served, desk: Desk, address: str, study: Path):
    status, page, headers = served.get(f"{desk.root}/")
    assert (status, headers["referrer-policy"]) == (200, "no-referrer")
    assert b"desk.js" in page
    assert str(study).encode() in page
    assert served.get(address)[0] == 200
    assert served.get(f"{desk.root}/desk.js")[0] == 200
    name = quote("bore-1/oct")
    assert served.get(f"{address}recording?name={name}")[0] == 200
    assert served.get(f"{address}picture.png?name={name}")[1].startswith(b"\x89PNG")
    form = json.loads(served.get(f"{address}sidecar.json?name={name}")[1])
    assert form["modality"] == "oct"
    assert set(json.loads(served.get(f"{desk.root}/forms.json")[1])) == {
        "unroll", "compare", "pose", "calibrate", "simulate", "demo", "summarise",
    }  # fmt: skip
    listed = json.loads(served.get(f"{desk.root}/folders.json?in={quote(str(study))}")[1])
    assert listed == {"folder": str(study), "above": str(study.parent), "names": ["bore-1"]}


def test_a_recording_is_unrolled_and_its_page_opened(served: Served, desk: Desk, address: str, study: Path):
    values = {"path": "bore-1/oct", "output": "results/wall.zarr"}
    asked = {"command": "unroll", "values": values}
    status, line = post(served, f"{address}command", asked)
    assert (status, json.loads(line)["command"]) == (200, "endoct unroll bore-1/oct --output=results/wall.zarr")
    status, queued = post(served, f"{address}run", asked)
    assert status == 200
    for _ in range(1200):
        (run,) = json.loads(served.get(f"{desk.root}/queue.json")[1])["runs"]
        if run["state"] not in ("waiting", "running"):
            break
        time.sleep(0.1)
    assert (run["state"], run["name"]) == ("done", json.loads(queued)["name"])
    assert "panorama:" in json.loads(served.get(f"{desk.root}/queue/{run['name']}/log.json")[1])["log"]
    (entry,) = json.loads(served.get(f"{address}results.json")[1])["entries"]
    assert (entry["name"], entry["kind"]) == ("results/wall.zarr", "recording")
    status, page, _ = served.get(entry["address"])
    assert status == 200
    assert f'href="{address}"'.encode() in page  # the way back
    assert served.get(f"{entry['address']}description.json")[0] == 200
    assert served.get(f"{address}{entry['thumbnail']}")[1].startswith(b"\x89PNG")
    assert post(served, f"{desk.root}/queue/clear", {})[0] == 200
    assert json.loads(served.get(f"{desk.root}/queue.json")[1]) == {"runs": []}
    assert (study / "results" / "wall.zarr").is_dir()


def test_a_sidecar_is_saved(served: Served, address: str, study: Path):
    form = json.loads(served.get(f"{address}sidecar.json?name=bore-1%2Foct")[1])
    sent: dict[str, Any] = {
        "name": "bore-1/oct",
        "modality": "oct",
        "texts": {"travel": "out"},
        "based_on": form["digest"],
    }
    assert post(served, f"{address}sidecar", sent)[0] == 200
    assert 'travel = "out"' in (study / "bore-1" / "oct" / "acquisition.toml").read_text()
    status, said = post(served, f"{address}sidecar", sent)
    assert status == 409
    assert "was changed meanwhile" in said


@OVER_A_SOCKET
def test_a_dropped_file_lies_in_the_folder(served: Served, address: str, study: Path):
    octets = {"Content-Type": "application/octet-stream"}
    assert post(served, f"{address}file?name=new%2Fslice_1.png", b"content", **octets)[0] == 200
    assert (study / "new" / "slice_1.png").read_bytes() == b"content"
    status, said = post(served, f"{address}file?name=new%2Fslice_1.png", b"other", **octets)
    assert status == 409
    assert "exists already" in said
    assert post(served, f"{address}file?name=..%2Fx", b"content", **octets)[0] == 409
    assert post(served, f"{address}file?name=x", b"content")[0] == 415
    assert post(served, f"{address}file?name=x", b"content", Origin=None, **octets)[0] == 403
    assert not (study.parent / "x").exists()


@pytest.fixture
def compared(study: Path, comparison: Path) -> Path:
    """A comparison of the study's two recordings, as the page has it written."""
    folder = Path(shutil.copytree(comparison, study / "results" / "bore-1"))
    result = json.loads((folder / "result.json").read_text())
    result["inputs"] = {"bore-1/endoscope/*": "0" * 64, str(study / "bore-1/oct/pullback.tif"): "1" * 64}
    (folder / "result.json").write_text(json.dumps(result))
    return folder


def results(served: Served, address: str) -> dict[str, Any]:
    entries = json.loads(served.get(f"{address}results.json")[1])["entries"]
    return {entry["name"]: entry for entry in entries}


def found(served: Served, address: str) -> None:
    while json.loads(served.get(f"{address}found.json")[1])["looking"]:
        time.sleep(0.01)


def test_a_result_names_its_recordings_and_whether_they_changed(served: Served, address: str, compared: Path):
    found(served, address)
    entry = results(served, address)["results/bore-1"]
    assert entry["of"] == ["bore-1/endoscope", "bore-1/oct"]
    # its command may have run in a terminal, in a folder above
    result = json.loads((compared / "result.json").read_text())
    elsewhere = result | {"inputs": {f"my study/bore-1/{side}/*": "0" * 64 for side in ("endoscope", "oct")}}
    (compared / "result.json").write_text(json.dumps(elsewhere))
    assert results(served, address)["results/bore-1"]["of"] == ["bore-1/endoscope", "bore-1/oct"]
    elsewhere["inputs"] = {"oct/*": "0" * 64, "other/bore-1/endoscope/*": "0" * 64}  # of no folder above it
    (compared / "result.json").write_text(json.dumps(elsewhere))
    assert results(served, address)["results/bore-1"]["of"] == []
    (compared / "result.json").write_text(json.dumps(result))
    made = (compared / "result.json").stat().st_mtime
    sidecar = compared.parents[1] / "bore-1" / "oct" / "acquisition.toml"
    for seconds, changed in ((made - 1, False), (made + 1, True)):
        for path in (compared.parents[1] / "bore-1").rglob("*"):
            os.utime(path, (made - 1, made - 1))
        os.utime(sidecar, (seconds, seconds))
        assert results(served, address)["results/bore-1"]["changed"] is changed


def test_a_note_on_a_result_is_kept_beside_it(served: Served, address: str, compared: Path):
    sent = {"name": "results/bore-1", "text": "drilled <twice>", "was": ""}
    assert json.loads(post(served, f"{address}note", sent)[1]) == {"note": "drilled <twice>"}
    assert results(served, address)["results/bore-1"]["note"] == "drilled <twice>"
    status, said = post(served, f"{address}note", sent)
    assert (status, "changed meanwhile" in said) == (409, True)
    assert post(served, f"{address}note", {**sent, "text": "a\x1b[2J", "was": "drilled <twice>"})[0] == 409
    shutil.rmtree(compared)
    assert post(served, f"{address}note", {**sent, "was": "drilled <twice>"})[0] == 404
    assert not compared.exists()


def test_a_summary_is_listed_with_its_report(served: Served, address: str, compared: Path):
    summarise([compared], compared.parent / "all of them")
    entry = results(served, address)["results/all of them"]
    assert (entry["kind"], entry["fault"], entry["level"]) == ("summary", "", None)
    status, page, headers = served.get(f"{address}{entry['address']}")
    assert (status, b"Every comparison" in page) == (200, True)
    assert "sandbox" in headers["content-security-policy"]
    assert served.get(f"{address}{entry['thumbnail']}")[1].startswith(b"\x89PNG")
    asked = {"command": "summarise", "values": {"folders": ["results/bore-1"], "output": "results/s"}}
    line = json.loads(post(served, f"{address}command", asked)[1])["command"]
    assert line == "endoct summarise results/bore-1 --output=results/s"
    asked["values"]["folders"] = ["../elsewhere"]  # type: ignore[index]
    assert post(served, f"{address}command", asked)[0] == 409


@pytest.mark.parametrize("name", ["../my study", "/etc", "", "results", "bore-1/oct", "a\x1b[2J", None, 3, "x" * 5000])
def test_a_note_on_what_is_no_result_is_refused(name: object, served: Served, address: str, study: Path):
    assert post(served, f"{address}note", {"name": name, "text": "x", "was": ""})[0] == 404
    assert not list(study.parent.rglob(NAME))


HOSTILE = ["x" * 300, "/".join(["x" * 200] * 30), "loop", "loop/loop/x", "half \ud800", "\0", "../..", "", "a\udce9"]


@pytest.mark.parametrize("name", HOSTILE)
def test_a_name_that_is_not_there_is_not_found(
    served: Served, desk: Desk, address: str, study: Path, name: str
) -> None:
    (study / "loop").symlink_to("loop")
    asked = quote(name, errors="surrogatepass")
    for place in ("recording", "picture.png", "report", "sidecar.json"):
        status, said, _ = served.get(f"{address}{place}?name={asked}")
        assert (status, len(said) < 500) == (404, True)
    assert served.get(f"{desk.root}/folders.json?in=/{asked}")[0] in (200, 409)
    octets = {"Content-Type": "application/octet-stream"}
    assert post(served, f"{address}file?name={asked}", b"content", **octets)[0] in (409, 200)
    for path, posted in (
        ("sidecar", {"name": name, "modality": "oct", "texts": {}}),
        ("sidecar", {"name": "bore-1/oct", "modality": name, "texts": {}}),
        ("sidecar", {"name": "bore-1/oct", "modality": "oct", "texts": {"calibration": name or "x"}}),
        ("preview", {"name": name, "texts": {}}),
        ("command", {"command": name, "values": {}}),
    ):
        status, said = post(served, f"{address}{path}", posted)
        assert status in (404, 409), said
    asked_for = {"command": "unroll", "values": {"path": name, "output": "x"}}
    assert post(served, f"{address}command", asked_for)[0] in (200, 409)  # a line to type, which the command refuses
    assert post(served, f"{desk.root}/open", {"folder": f"/{name}" if name else "x"})[0] in (409, 200)
    assert post(served, f"{desk.root}/queue/{asked or 'x'}/cancel", {})[0] in (404, 409)


def test_names_that_are_no_text_are_listed_with_the_rest(served: Served, address: str, study: Path) -> None:
    """As much as can be: frames are read by their folder, and what they are called is only shown."""
    frames = study / "bore-1" / "endoscope"
    (frames / os.fsdecode(b"caf\xe9.png")).write_bytes(b"no picture")
    (study / os.fsdecode(b"caf\xe9")).mkdir()
    (study / os.fsdecode(b"caf\xe9.tif")).write_bytes(b"")
    post(served, f"{address}look", {})
    for _ in range(600):
        status, found, _ = served.get(f"{address}found.json")
        assert status == 200
        if not json.loads(found)["looking"]:
            break
        time.sleep(0.1)
    assert {one["name"] for one in json.loads(found)["inputs"]} == {"bore-1/oct", "bore-1/endoscope"}


def test_a_folder_whose_name_is_no_text_has_a_page(served: Served, desk: Desk, study: Path) -> None:
    folder = study / os.fsdecode(b"caf\xe9")
    folder.mkdir()
    address = desk.open(folder).address
    for place in (f"{desk.root}/", address, f"{address}found.json", f"{address}results.json"):
        assert served.get(place)[0] == 200


def test_a_bookmark_holds_after_a_restart(served: Served, desk: Desk, address: str, tmp_path: Path):
    desk._folders.clear()
    assert served.get(address)[0] == 200
    assert served.get(f"{desk.root}/f/{'0' * 16}/")[0] == 404


@pytest.mark.parametrize("guess", ["", "/", "/x/", f"/{'0' * 32}/", "/%2e%2e/", "/queue.json", "//", "/{}/../x/"])
def test_who_does_not_know_the_secret_gets_nothing(served: Served, desk: Desk, guess: str):
    status, body, _ = served.get(guess.replace("{}", "0") or "/")
    assert status == 403
    assert body == b"open the address that `endoct open` printed"
    assert desk.root.encode() not in body


@OVER_A_SOCKET
def test_a_part_of_the_secret_is_not_enough(served: Served, desk: Desk):
    for almost in (desk.root[:-1], f"{desk.root}0", desk.root.upper(), f"{desk.root[:-1]}é"):
        assert served.get(quote(f"{almost}/queue.json", safe="/"))[0] == 403 or almost == desk.root


def test_another_page_starts_nothing(served: Served, desk: Desk, address: str, study: Path):
    asked = {"command": "unroll", "values": {"path": "bore-1/oct", "output": "wall.zarr"}}
    for headers in (
        {"Origin": "http://evil.example"},
        {"Origin": None},
        {"Origin": "null"},
        {"Content-Type": "text/plain"},
        {"Host": "evil.example"},
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site"},  # a server of another user, on another port
    ):
        assert post(served, f"{address}run", asked, **headers)[0] in (403, 415)
    assert desk.state.queue.runs() == []
    assert served.get(f"{address}run")[0] == 405
    assert served.get(address, Sec_Fetch_Site="cross-site")[0] == 403
    framed = {"Sec_Fetch_Site": "cross-site", "Sec_Fetch_Mode": "navigate", "Sec_Fetch_Dest": "iframe"}
    assert served.get(address, **framed)[0] == 403
    assert served.get(address, **framed | {"Sec_Fetch_Dest": "document"})[0] == 200  # a link that knows the secret
    assert served.get("/", **framed | {"Sec_Fetch_Dest": "document"})[0] == 403


def test_a_report_is_shown_without_any_program(served: Served, desk: Desk, address: str, study: Path):
    (study / "pose").mkdir()
    (study / "pose" / "report.html").write_text("<script src='../../desk.js'></script>")
    seal(study / "pose", POSE)
    status, _, headers = served.get(f"{address}report?name=pose")
    assert status == 200
    policy = headers["content-security-policy"]
    assert policy.startswith("sandbox; default-src 'none'")
    assert "script-src" not in policy
    assert served.get(address)[2]["content-security-policy"].startswith("default-src 'none'; script-src 'self'")


def test_a_link_in_place_of_a_sidecar_is_not_followed(served: Served, address: str, study: Path, tmp_path: Path):
    mine = tmp_path / "mine.toml"
    sidecar = study / "bore-1" / "oct" / "acquisition.toml"
    mine.write_bytes(before := sidecar.read_bytes())
    sidecar.unlink()
    sidecar.symlink_to(mine)
    assert served.get(f"{address}sidecar.json?name=bore-1%2Foct")[0] == 409
    sent = {"name": "bore-1/oct", "modality": "oct", "texts": {"travel": "in"}, "based_on": None}
    status, said = post(served, f"{address}sidecar", sent)
    assert status == 409
    assert "is a link" in said
    assert mine.read_bytes() == before


def test_the_page_of_a_result_outlives_a_restart(
    served: Served, desk: Desk, address: str, study: Path, comparison: Path
):
    shutil.copytree(comparison, study / "results" / "one")
    assert served.get(f"{address}at/results/one/")[0] == 200  # before anybody asked for the results
    assert served.get(f"{address}at/results/two/")[0] == 404


@pytest.mark.parametrize(
    ("path", "sent"),
    [
        ("run", {"command": "serve", "values": {}}),
        ("run", {"command": "unroll", "values": {"path": "/etc", "output": "x"}}),
        ("run", {"command": "unroll", "values": {"path": "bore-1/oct", "output": "../x"}}),
        ("run", {"command": ["unroll"], "values": {}}),
        ("run", []),
        ("run", b"{"),
        ("sidecar", {"name": "../bore", "modality": None, "texts": {}, "based_on": None}),
        ("sidecar", {"name": "bore-1/oct", "texts": {"modality": "x"}, "based_on": 1}),
        ("preview", {"name": "/etc", "texts": {}}),
        ("preview", {"name": "bore-1/oct", "texts": []}),
        ("preview", {"name": "bore-1/oct", "modality": "none", "texts": {}}),
    ],
)
def test_nonsense_is_answered_in_one_line(served: Served, desk: Desk, address: str, path: str, sent: Any):
    status, said = post(served, f"{address}{path}", sent)
    assert status == (404 if "no such recording" in said else 409)
    assert said
    assert "\n" not in said
    assert desk.state.queue.runs() == []


@pytest.mark.parametrize(
    "path",
    [
        "at/../../x", "at/..%2f..%2fetc/", "at/bore-1/oct/", "report?name=..", "report?name=bore-1", "file",
        "picture.png?name=%2Fetc%2Fpasswd", "picture.png?name=..%2F..%2Fx", "recording?name=..",
        "sidecar.json?name=%00", "thumbnails/v/0.png", "thumbnails/v/-1.png", "thumbnails/v/x.png",
    ],
)  # fmt: skip
def test_no_address_leads_elsewhere(served: Served, address: str, path: str):
    status, body, _ = served.get(f"{address}{path}")
    assert status >= 400
    assert b"root:" not in body
    assert len(body) < 600


def test_only_the_whole_path_of_a_folder_is_opened(served: Served, desk: Desk, tmp_path: Path):
    for text in ("relative", "", str(tmp_path / "none"), None, "/etc/hostname"):
        status, said = post(served, f"{desk.root}/open", {"folder": text})
        assert status == 409
        assert "cannot be opened" in said
    (tmp_path / "<b>bold<script>").mkdir()
    status, said = post(served, f"{desk.root}/open", {"folder": str(tmp_path / "<b>bold<script>")})
    assert status == 200
    for page in (f"{desk.root}/", json.loads(said)["address"]):
        html = served.get(page)[1]
        assert b"<script>" not in html.replace(b"<script src=", b"")
        assert b"<b>bold" not in html


def dropped(folder: Path, name: str, content: bytes = b"content") -> None:
    async def parts():
        yield content[:3]
        yield content[3:]

    asyncio.run(take_file(folder, name, parts()))


def test_dropped_files_appear_and_replace_nothing(tmp_path: Path):
    dropped(tmp_path, "bore-2/oct/slice 0001.png")
    assert (tmp_path / "bore-2" / "oct" / "slice 0001.png").read_bytes() == b"content"
    with pytest.raises(EndoctError, match="exists already"):
        dropped(tmp_path, "bore-2/oct/slice 0001.png", b"other")
    assert (tmp_path / "bore-2" / "oct" / "slice 0001.png").read_bytes() == b"content"
    assert [path.name for path in (tmp_path / "bore-2" / "oct").iterdir()] == ["slice 0001.png"]


@pytest.mark.parametrize(
    "name", ["../x", "/x", "", ".bashrc", "a/.ssh/key", "a//b", "a\nb", "/".join("a" * 20), "away/x"]
)
def test_nothing_is_dropped_elsewhere(tmp_path: Path, name: str):
    folder = tmp_path / "study"
    folder.mkdir()
    (folder / "away").symlink_to(tmp_path)
    with pytest.raises(EndoctError):
        dropped(folder, name)
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["away", "study"]


def test_what_a_killed_server_left_of_a_drop_goes_with_the_next(tmp_path: Path):
    with scratch_next_to(tmp_path / "b.png") as scratch:
        shutil.copytree(scratch, scratch.with_name(f"{scratch.name}x"))  # nobody holds its lock
    dropped(tmp_path, "b.png")
    assert [path.name for path in tmp_path.iterdir()] == ["b.png"]


def test_a_drop_that_breaks_off_leaves_nothing(tmp_path: Path):
    async def parts():
        yield b"half"
        raise ClientDisconnect

    with pytest.raises(ClientDisconnect):
        asyncio.run(take_file(tmp_path, "a/b.png", parts()))
    assert list((tmp_path / "a").iterdir()) == []
