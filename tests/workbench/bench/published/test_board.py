"""The board: a page that says first where endoct is beaten, and believes no name."""

import re
from pathlib import Path

import pytest
from published_sets import entry, scored, submission

from endoct.base.errors import EndoctError
from endoct.workbench.bench.published.board import write_board
from endoct.workbench.bench.published.submission import text_of
from endoct.workbench.cli import main

pytestmark = pytest.mark.usefixtures("sets_of_any_size")
HOSTILE = "<script>alert(1)</script>"


@pytest.fixture
def submissions(tmp_path: Path) -> Path:
    """A folder with one submission: a hostile name beats endoct on one generator."""
    folder = tmp_path / "submissions"
    folder.mkdir()
    entries = [entry("s0"), entry("s1", difficulty="hard"), entry("t0", generator="second")]
    rows = [scored(each.name, "endoct", 0.7, success=True) for each in entries]
    rows += [scored(each.name, HOSTILE, 0.9 if each.name == "t0" else None, success=True) for each in entries]
    (folder / "mine.json").write_text(text_of(submission(rows, entries)), encoding="utf-8")
    return folder


def test_losses_come_before_standings_and_names_are_texts(submissions: Path, tmp_path: Path) -> None:
    write_board(submissions, tmp_path / "board.html")
    page = (tmp_path / "board.html").read_text(encoding="utf-8")
    assert HOSTILE not in page
    assert (
        page.index("Where endoct is beaten")
        < page.index("better in 1 cases, worse in 0 (p = 1)")
        < page.index("<tbody>")
    )
    assert "declined: too dark" in page
    assert page.count("<td>not checked</td>") == 4  # of two methods on two generators
    assert page.count("<svg") == 2
    assert page.count("<main>") == page.count("</main>") == page.count("<h1>") == 1
    scrolled = re.findall(r'<div class="scroll"([^>]*)>', page)
    assert len(scrolled) == 6  # standings and cases of two generators, methods, runs: keys have to reach them
    assert all('tabindex="0"' in each and "aria-label=" in each for each in scrolled)
    write_board(submissions, tmp_path / "again.html")
    assert (tmp_path / "again.html").read_bytes() == (tmp_path / "board.html").read_bytes()


def test_the_command_line_names_who_beats_endoct(
    submissions: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    output = submissions / "board.html"  # next to the files it is made of
    monkeypatch.setattr("sys.argv", ["endoct", "bench", "board", str(submissions), "-o", str(output)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    assert "segmentation: 2 methods; endoct is beaten by" in capsys.readouterr().out
    assert output.is_file()


def test_a_page_of_others_stays(submissions: Path, tmp_path: Path) -> None:
    (tmp_path / "board.html").write_text("mine", encoding="utf-8")
    with pytest.raises(EndoctError):
        write_board(submissions, tmp_path / "board.html", overwrite=True)
    assert (tmp_path / "board.html").read_text(encoding="utf-8") == "mine"


def test_names_stay_texts_in_drawings(tmp_path: Path) -> None:
    """No escape sequence, nothing that turns the direction of writing, no formula, no line without a name."""
    names = ["\x1b[2J", "\u202eevil", r"$\frac{1}{$", "_hidden"]
    rows = [scored("s0", name, 0.5, success=True) for name in names]
    (tmp_path / "one.json").write_text(text_of(submission(rows, [entry("s0")])), encoding="utf-8")
    write_board(tmp_path, tmp_path / "board.html")
    page = (tmp_path / "board.html").read_text(encoding="utf-8")
    assert not {"\x1b", "\u202e"} & set(page)
    drawing = page[page.index("<svg") : page.index("</svg>")]
    for shown in (r"\x1b[2J", r"\u202eevil", r"$\frac{1}{$", "hidden"):
        assert f">{shown}</text>" in drawing
