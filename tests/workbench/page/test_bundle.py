"""The committed bundle: made from the sources beside it, with its licences, and in every installation."""

import dataclasses
import hashlib
import re
from importlib.resources import files
from pathlib import Path

import pytest

from endoct.workbench.page import description

FRONTEND = Path(__file__).parents[3] / "workbench" / "page" / "frontend"
BUNDLE = files("endoct.workbench.page").joinpath("bundle")
PROGRAMS = ("page.js", "cylinder.js")


def test_the_bundle_was_made_from_these_sources():
    own = [f"src/{path.name}" for path in (FRONTEND / "src").iterdir() if path.suffix in (".ts", ".css")]
    digest = hashlib.sha256()
    for name in sorted([*own, "build.mjs", "package.json", "package-lock.json"]):
        digest.update(name.encode() + b"\0" + (FRONTEND / name).read_bytes() + b"\0")
    for program in PROGRAMS:
        first = BUNDLE.joinpath(program).read_text("utf-8").splitlines()[0]
        assert digest.hexdigest() in first, "the sources were changed: run `make page`"


def test_bundled_licences_are_named():
    notices = BUNDLE.joinpath("notices.txt").read_text("utf-8")
    assert "OpenSeadragon" in notices
    assert "Redistribution and use in source and binary forms" in notices
    assert "three.js" in notices
    assert "The MIT License" in notices
    for program, licence in zip(PROGRAMS, ("BSD-3-Clause", "MIT"), strict=True):
        assert licence in BUNDLE.joinpath(program).read_text("utf-8").splitlines()[0]


def test_the_bundle_holds_nothing_else():
    assert {path.name for path in BUNDLE.iterdir()} - {"__pycache__"} == {
        "__init__.py", "cylinder.js", "desk.css", "desk.js", "folder.js", "notices.txt", "page.css", "page.js",
    }  # fmt: skip


@pytest.mark.parametrize("program", PROGRAMS)
def test_the_page_can_be_put_into_one_file(program: str):
    script = BUNDLE.joinpath(program).read_text("utf-8")
    assert "</script" not in script.lower()
    assert "<!--" not in script
    assert "</style" not in BUNDLE.joinpath("page.css").read_text("utf-8").lower()
    assert not re.search(r"^\s*(import|export)\s", script, re.MULTILINE)


@pytest.mark.parametrize("part", [one for one in vars(description).values() if dataclasses.is_dataclass(one)])
def test_sources_name_what_the_server_says(part: type):
    source = (FRONTEND / "src" / "description.ts").read_text("utf-8")
    body = re.search(rf"export interface {part.__name__} {{(.*?)\n}}", source, re.DOTALL)
    assert body is not None
    assert re.findall(r"^  (\w+):", body[1], re.MULTILINE) == [field.name for field in dataclasses.fields(part)]
