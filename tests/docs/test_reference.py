"""The reference names everything that is written, and the citation the version that is installed."""

import re
import tomllib
from importlib.metadata import version
from pathlib import Path

import pytest

from endoct.fusion.files.store import PROPERTIES
from endoct.modalities.reading.recording import FORMATS
from endoct.modalities.registry import manifests

ROOT = Path(__file__).parents[2]
NAMED = frozenset(re.findall(r"`(\w+)`", (ROOT / "docs" / "reference" / "files.md").read_text(encoding="utf-8")))


@pytest.mark.parametrize("modality", ["oct", "endoscope"])
def test_every_number_per_frame_is_explained(modality: str) -> None:
    assert set(manifests()[modality].per_frame) <= NAMED


def test_every_column_of_the_table_of_cells_is_explained() -> None:
    assert set(PROPERTIES) <= NAMED


def test_the_citation_is_of_this_version() -> None:
    cited = re.search(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    assert cited is not None
    assert cited[1] == version("endoct")


def test_every_dependency_is_listed_with_its_version_and_licence() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = [lines for name, lines in project["optional-dependencies"].items() if name not in ("dev", "docs")]
    names = {re.split("[>=]", line)[0].lower() for lines in (project["dependencies"], *extras) for line in lines}
    pinned = dict(
        line.lower().split("==") for line in (ROOT / "constraints.txt").read_text().splitlines() if "==" in line
    )
    page = (ROOT / "THIRD_PARTY.md").read_text(encoding="utf-8").split("\n## ")[0]
    listed = {row[0]: row[1:] for row in re.findall(r"^\| ([\w-]+) \| ([^|]+) \| ([^|]+) \|$", page, re.MULTILINE)}
    for name in {re.sub(r"[_.]", "-", name) for name in names}:
        assert name in listed, f"run docs/licences.py: {name} is not in THIRD_PARTY.md"
        version_, licence = listed[name]
        assert licence
        assert version_ in (pinned.get(name, version_), pinned.get(name.replace("-", "_"), version_))


def test_every_format_of_recordings_has_a_row() -> None:
    page = (ROOT / "docs" / "reference" / "formats.md").read_text(encoding="utf-8")
    for form in FORMATS:
        module = form.open.__module__.removeprefix("endoct.modalities.")
        assert f"`{module}`" in page, f"no row for {form.name}"
