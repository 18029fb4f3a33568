"""The reference names everything that is written, and the citation the version that is installed."""

import re
from importlib.metadata import version
from pathlib import Path

import pytest

from endoct.fusion.files.cell_table import PROPERTIES
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
