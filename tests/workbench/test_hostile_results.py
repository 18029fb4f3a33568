"""A comparison folder that was damaged or made up ends in one line, whatever is wrong with it."""

import copy
import json
import shutil
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mock_comparison import Kind, mock_pictures, write_comparison

from endoct.base.errors import EndoctError
from endoct.fusion.files.result_file import read_result
from endoct.fusion.files.store import read_outline
from endoct.modalities.contract import Picture
from endoct.workbench.page.heading import comparison_heading, printed_page
from endoct.workbench.report.findings import read_findings
from endoct.workbench.report.pictures import load_pictures, save_pictures
from endoct.workbench.report.sections import report_sections

HOSTILE: tuple[Any, ...] = (None, 0, -1, 1e308, float("nan"), True, "[/x]", "", [], {}, [1], {"a": 1}, 10**400)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("comparison") / "c"
    write_comparison(made, Kind("endoscope", depth=False), Kind("oct"))
    return made


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    yield path
    if isinstance(value, dict | list):
        for key in value if isinstance(value, dict) else range(len(value)):
            yield from places(value[key], (*path, key))


def changed(result: Any, path: tuple[Any, ...], value: Any, *, drop: bool) -> Any:
    if not path:
        return value
    result = copy.deepcopy(result)
    inner = result
    for key in path[:-1]:
        inner = inner[key]
    if drop:
        del inner[path[-1]]
    else:
        inner[path[-1]] = value
    return result


def test_a_result_that_was_changed_anywhere_is_reported_or_refused_in_one_line(folder: Path) -> None:
    path = folder / "result.json"
    whole = json.loads(path.read_text())
    findings, outline, refused = read_findings(folder), read_outline(folder / "comparison.zarr"), 0
    try:
        for where in places(whole):
            for value in ("drop", *HOSTILE):
                if value == "drop" and not where:
                    continue
                path.write_text(json.dumps(changed(whole, where, value, drop=value == "drop")))
                try:
                    result = read_result(folder)
                    heading = comparison_heading("c", [], replace(outline, result=result))
                    printed_page(heading, report_sections(replace(findings, result=result), []), "")
                except EndoctError as error:
                    refused += 1
                    assert "\n" not in str(error)  # noqa: PT017
    finally:
        path.write_text(json.dumps(whole))
    assert refused > 200


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '"x"', "[" * 100_000, '{"a":' * 30 + "1" + "}" * 30, '{"x": ' + "9" * 5000 + "}", "\ud800x"]
)
def test_what_is_no_result(text: str, folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "c")
    (tmp_path / "c" / "result.json").write_text(text, encoding="utf-8", errors="surrogatepass")
    with pytest.raises(EndoctError, match=r"no comparison|cannot be used") as refused:
        read_findings(tmp_path / "c")
    assert "\n" not in str(refused.value)


def test_a_result_larger_than_any(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "c")
    with (tmp_path / "c" / "result.json").open("ab") as file:
        file.truncate(16_000_001)
    with pytest.raises(EndoctError, match="no comparison"):
        read_findings(tmp_path / "c")


def test_pictures_that_expand_too_far(tmp_path: Path) -> None:
    save_pictures(tmp_path, "oct", "0001", mock_pictures()[:1])
    (path,) = tmp_path.glob("*.npz")
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as members, members.open("image.npy", "w") as file:
        for _ in range(600):
            file.write(bytes(1_000_000))
    with pytest.raises(EndoctError, match=r"cannot be read|holds too much"):
        load_pictures(tmp_path)


@pytest.mark.parametrize(
    "change",
    [
        {"side": "../x"}, {"side": 1}, {"name": "a/b"}, {"place": -1}, {"place": "1"}, {"x_extent": [0]},
        {"x_extent": [0, float("nan")]}, {"y_extent": ["a", "b"]}, {"curves": 5}, {"curves": ["a", "b"]},
        {"title": None}, {"order": 10**400},
    ],
)  # fmt: skip
def test_pictures_that_say_what_cannot_be(change: dict[str, Any], tmp_path: Path) -> None:
    save_pictures(tmp_path, "oct", "0001", mock_pictures()[:1])
    (path,) = tmp_path.glob("*.npz")
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    told = json.loads(str(arrays["metadata"]))
    np.savez(path, **{**arrays, "metadata": np.array(json.dumps({**told, **change}))})
    with pytest.raises(EndoctError):
        load_pictures(tmp_path)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("image", np.zeros(3)), ("image", np.zeros((2, 2), complex)), ("image", np.zeros((0, 4))),
        ("image", np.array([["a"]])), ("curve_0", np.zeros((4, 3))), ("metadata", np.zeros(3)),
    ],
)  # fmt: skip
def test_pictures_of_something_else(name: str, values: np.ndarray, tmp_path: Path) -> None:
    save_pictures(tmp_path, "oct", "0001", mock_pictures()[:1])
    (path,) = tmp_path.glob("*.npz")
    with np.load(path) as file:
        arrays = {key: file[key] for key in file.files}
    np.savez(path, **{**arrays, name: values})
    with pytest.raises(EndoctError):
        load_pictures(tmp_path)


@pytest.mark.parametrize(("side", "label", "name"), [("../x", "1", "a"), ("x", "../1", "a"), ("x", "1", "/a")])
def test_pictures_are_saved_by_plain_names_only(side: str, label: str, name: str, tmp_path: Path) -> None:
    picture = Picture(name, "t", np.zeros((2, 2)), "x", "y", (0.0, 1.0), (0.0, 1.0))
    with pytest.raises(EndoctError, match="cannot be used"):
        save_pictures(tmp_path / "p", side, label, [picture])
