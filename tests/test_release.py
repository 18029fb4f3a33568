"""What a release is made of says the same everywhere: the version, the citation, the dependencies."""

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[1]
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
CITATION: dict[str, Any] = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
ZENODO: dict[str, Any] = json.loads((ROOT / ".zenodo.json").read_text(encoding="utf-8"))
IN_CONDA = {
    "matplotlib": "matplotlib-base",
    "opencv-contrib-python-headless": "py-opencv",
    "pywavelets": "pywavelets",
    "torch": "pytorch",
}
"""Names that conda-forge gives to what PyPI calls otherwise."""


def test_the_citation_has_the_version_and_licence_of_the_project() -> None:
    assert CITATION["version"] == PROJECT["version"]
    assert CITATION["license"] == PROJECT["license"]


@pytest.mark.parametrize("key", ["title", "version", "license"])
def test_zenodo_is_given_what_the_citation_says(key: str) -> None:
    assert ZENODO[key] == CITATION[key]


def test_zenodo_is_given_the_authors_and_the_paper_of_the_citation() -> None:
    assert [creator["name"] for creator in ZENODO["creators"]] == [author["name"] for author in CITATION["authors"]]
    cited = [each["value"] for reference in CITATION["references"] for each in reference["identifiers"]]
    assert [related["identifier"] for related in ZENODO["related_identifiers"]] == cited
    assert ZENODO["keywords"] == PROJECT["keywords"]


def test_the_changelog_has_the_version_or_is_about_to() -> None:
    headings = re.findall(r"^## \[(.+?)\]", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert headings[0] == "Unreleased" or headings[0] == PROJECT["version"]


def test_the_recipe_needs_what_the_project_needs() -> None:
    recipe = (ROOT / "recipe" / "meta.yaml").read_text(encoding="utf-8")
    run = recipe[recipe.index("  run:") : recipe.index("test:")]
    wanted = dict(re.findall(r"^    - (\S+) >=(\S+)$", run, re.MULTILINE))
    assert wanted.pop("python") == PROJECT["requires-python"].removeprefix(">=")
    needed = dict(line.lower().split(">=") for line in PROJECT["dependencies"])
    expected = {IN_CONDA.get(name, name): bound for name, bound in needed.items()}
    expected["py-opencv"] = expected["py-opencv"].removesuffix(".0.90")  # PyPI's own count of builds
    assert wanted == expected


def test_the_container_has_all_folders_that_are_installed() -> None:
    lines = (ROOT / "Containerfile").read_text(encoding="utf-8").splitlines()
    copied = {line.split()[1] for line in lines if re.fullmatch(r"COPY (\w+) \1", line)}
    kept = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    folders = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]["package-dir"]
    assert copied == set(folders.values()) <= {line.removeprefix("!") for line in kept}
