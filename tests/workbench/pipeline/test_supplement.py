"""The page of a summary: every comparison, plots beside it, and how it was made."""

import hashlib
import re
from pathlib import Path

import pytest
from workbench_page import written

from endoct.workbench import summarise, verify
from endoct.workbench.page.notes import NAME


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two bores, the first compared twice, summarised."""
    folder = tmp_path_factory.mktemp("a study")
    first = written(folder / "bore-1" / "run-1")
    written(folder / "bore-1" / "run-2", jaccard=0.5)
    written(folder / "bore-2" / "run-1", aligned=False, alignment=None, reason="<b>dark</b>")
    (first / NAME).write_text("drilled <i>twice</i>")
    summarise(sorted(folder.glob("bore-*/run-*")), folder / "summary", repeats=True)
    return folder


def test_the_page_has_every_comparison_and_what_was_noted(study: Path):
    page = (study / "summary" / "report.html").read_text()
    rows = re.findall(r'<tr><th scope="row">(bore-\d/run-\d)</th><td class="text">([\w ]+)</td>', page)
    assert [name for name, _ in rows] == ["bore-1/run-1", "bore-1/run-2", "bore-2/run-1"]
    assert rows[-1][1] == "not aligned"
    assert "drilled &lt;i&gt;twice&lt;/i&gt;" in page
    assert "<b>dark</b>" not in page
    assert "1 not aligned" in page
    assert 'class="verdict unaligned"' in page  # the worst that there is


def test_the_page_says_how_it_was_made(study: Path):
    page = (study / "summary" / "report.html").read_text()
    assert f"endoct summarise '{study}/bore-1/run-1'" in page.replace("&#39;", "'")
    assert "--repeats -o" in page
    for result in sorted(study.glob("bore-*/run-*/result.json")):
        assert hashlib.sha256(result.read_bytes()).hexdigest() in page


def test_the_page_needs_no_other_file_and_the_plots_lie_beside_it(study: Path):
    summary = study / "summary"
    page = (summary / "report.html").read_text()
    names = sorted(path.stem for path in (summary / "figures").glob("*.svg"))
    assert names == sorted(path.stem for path in (summary / "figures").glob("*.png"))
    assert "repeats" in names
    assert page.count('<img src="data:image/png;base64,') == len(names)
    assert "<script" not in page
    assert not re.search(r'(src|href)="(?!data:|#)', page)
    assert verify(summary)[0].intact


def test_two_specimens_that_are_called_alike_stay_two(study: Path, tmp_path: Path):
    tables = summarise(sorted(study.glob("bore-*/run-1")), tmp_path / "out")
    assert not (tmp_path / "out" / "figures" / "repeats.svg").exists()  # nothing was repeated
    (aligned,) = [row for row in tables["summary"] if row["score"] == "aligned"]
    assert aligned["specimens"] == 2
    assert {row["specimen"] for row in tables["scores"]} == {"bore-1/run-1", "bore-2/run-1"}
