"""Export from a page: every format that the command line has, by the same function, and what must not be possible."""

import json
import shlex
import shutil
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest
from workbench_page import Asked, application, post

from endoct.base.files.contents import seal
from endoct.workbench import export
from endoct.workbench.exporting.formats import FORMATS


@pytest.fixture
def folder(comparison: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(comparison, tmp_path / "study" / "bore 1"))


@pytest.fixture
def asked(folder: Path) -> Iterator[Asked]:
    with application(folder) as found:
        yield found


def wanted(name: str, **options: str) -> dict[str, object]:
    return {"format": name, "options": options}


def test_every_format_is_offered_or_says_why_not(asked: Asked, folder: Path):
    listed = json.loads(asked.get("/exports.json")[1])
    refused = {one["name"]: one["refused"] for one in listed["formats"]}
    assert list(refused) == list(FORMATS)
    assert {name for name, why in refused.items() if why} - {"dicom"} == {"nrrd", "nifti"}
    assert ("pip install 'endoct[dicom]'" in refused["dicom"]) == (find_spec("highdicom") is None)
    assert listed["beside"] == str(folder.parent)
    options = {one["name"]: {each["name"]: each["choices"] for each in one["options"]} for one in listed["formats"]}
    assert options["csv"] == {"side": ["endoscope", "oct"]}
    assert options["ply"] == {
        "color": ["", "endoscope", "oct", "relief"], "side": ["", "endoscope", "oct"], "vertex_mm": None,
    }  # fmt: skip
    assert all(one["opens"] for one in listed["formats"])


def test_the_download_is_what_the_command_line_writes(asked: Asked, folder: Path, tmp_path: Path):
    status, line = post(asked, "/export-line.json", wanted("csv", side="oct"))
    assert status == 200
    words = shlex.split(json.loads(line)["command"])
    output = str(folder.parent / "bore 1.csv")
    assert words == ["endoct", "export", str(folder), "--to", "csv", "--side=oct", "-o", output]
    headers = {"Origin": asked.url.rstrip("/"), "Content-Type": "application/json"}
    status, data, sent = asked.answer("POST", "/export", headers, json.dumps(wanted("csv", side="oct")).encode())
    export(folder, tmp_path / "same.csv", side="oct")
    assert (status, data) == (200, (tmp_path / "same.csv").read_bytes())
    assert "attachment" in sent["content-disposition"]
    assert "bore%201.csv" in sent["content-disposition"]
    assert not list(folder.parent.glob("*.csv"))


def test_what_stays_beside_the_result_replaces_nothing(asked: Asked, folder: Path, tmp_path: Path):
    for name in ("bore 1.tfm", "bore 1-2.tfm"):
        status, said = post(asked, "/export.json", wanted("itk-transform", inverse="yes"))
        assert (status, json.loads(said)["saved"]) == (200, str(folder.parent / name))
    plain = json.loads(post(asked, "/export.json", wanted("itk-transform", inverse="no"))[1])["saved"]
    for made, inverse in ((Path(plain), None), (folder.parent / "bore 1.tfm", True)):
        export(folder, tmp_path / "same.tfm", inverse=inverse, overwrite=True)
        assert made.read_bytes() == (tmp_path / "same.tfm").read_bytes()
    assert (folder.parent / "bore 1.tfm").read_bytes() == (folder.parent / "bore 1-2.tfm").read_bytes()


@pytest.mark.parametrize(
    ("posted", "said"),
    [
        ({"format": "../x", "options": {}}, "there is no such format"),
        ({"format": ["csv"], "options": {}}, "there is no such format"),
        ({"format": "csv", "options": {"output": "/tmp/x"}}, "has other options"),
        ({"format": "csv", "options": "side"}, "has other options"),
        (wanted("csv", side="oct\x1b[2J"), "cannot be used"),
        (wanted("csv", side="x" * 101), "cannot be used"),
        (wanted("csv", side="../oct"), "has no such side"),
        (wanted("ply", vertex_mm="wide"), "cannot be used"),
        (wanted("ply", vertex_mm="nan"), "vertices cannot have that distance"),
        (wanted("itk-transform", inverse="--overwrite"), "cannot be used"),
        (wanted("ome-zarr"), "is a folder"),
        (wanted("nrrd"), "volume"),
    ],
)
def test_nonsense_is_refused_and_leaves_nothing(asked: Asked, folder: Path, posted: dict[str, object], said: str):
    status, answer = post(asked, "/export", posted)
    assert status == 409
    assert said in answer
    assert [path.name for path in folder.parent.iterdir()] == [folder.name]


def test_only_the_page_itself_may_ask(asked: Asked):
    assert post(asked, "/export", wanted("csv", side="oct"), Origin=None)[0] == 403
    assert post(asked, "/export", wanted("csv", side="oct"), Origin="http://elsewhere")[0] == 403
    assert post(asked, "/export.json", wanted("csv", side="oct"), Content_Type="text/plain")[0] == 415


def test_a_comparison_that_is_gone_is_not_exported(asked: Asked, folder: Path):
    shutil.rmtree(folder)
    for address in ("/export", "/export.json", "/export-line.json"):
        status, said = post(asked, address, wanted("csv", side="oct"))
        assert status == 410
        assert "was replaced or deleted" in said
    assert asked.get("/exports.json")[0] == 410
    assert not list(folder.parent.iterdir())


def test_beside_a_part_of_an_output_nothing_is_written(asked: Asked, folder: Path):
    seal(folder, "comparison")
    with application(folder / "panoramas" / "oct.zarr") as part:
        listed = json.loads(part.get("/exports.json")[1])
        assert listed["beside"] == ""
        status, said = post(part, "/export.json", wanted("csv", side="oct"))
        assert (status, "a part of another output" in said) == (409, True)
        assert post(part, "/export", wanted("csv", side="oct"))[0] == 200
        refused = {one["name"] for one in listed["formats"] if one["refused"]}
        assert refused - {"dicom"} == {"nrrd", "nifti", "itk-transform", "labels"}
