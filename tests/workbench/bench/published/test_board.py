"""The board: a page that says first where endoct is beaten, and believes no name."""

import re
from pathlib import Path

import pytest
from published_sets import entry, scored, submission

from endoct.base.errors import EndoctError
from endoct.workbench.bench.published import board
from endoct.workbench.bench.published.board import uneven_difficulty, write_board
from endoct.workbench.bench.published.standings import read_boards
from endoct.workbench.bench.published.submission import text_of
from endoct.workbench.bench.published.submitted import PARTS
from endoct.workbench.bench.results.plots import Style
from endoct.workbench.bench.task import load_task, method_names, origin, task_names
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
    assert page.count("<svg") == len(re.findall(r'<div class="scroll"[^>]*><svg', page)) == 2  # wider than a phone
    assert len(re.findall(r"</a>\s+<a", page)) == page.count("<a ") - 1  # links without a space are one long line
    assert "@media (prefers-color-scheme: dark)" in page
    assert f"A success is {load_task('segmentation').success}." in page
    assert page.count("<main>") == page.count("</main>") == page.count("<h1>") == 1
    scrolled = re.findall(r'<div class="scroll"([^>]*)>', page)
    # standings and cases of two generators, methods, runs, two figures, three specimens: keys have to reach them
    assert len(scrolled) == 11
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


def test_a_method_looks_alike_in_all_figures(submissions: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [scored("s0", name, 0.5).model_copy(update={"case": "s0"}) for name in ("other", "endoct")]
    (submissions / "wall.json").write_text(text_of(submission(rows, [entry("s0")], "wall")), encoding="utf-8")
    looks: list[dict[str, Style]] = []
    for figure in ("curves", "costs"):
        monkeypatch.setattr(board, figure, lambda _, styles: looks.append(styles) or "")
    write_board(submissions, submissions / "board.html")
    assert len(looks) == 4  # two figures of two tasks
    assert all(styles == looks[0] for styles in looks)
    assert {"endoct", "other", HOSTILE} <= set(looks[0])


def uneven(folder: Path, easy: list[float | None], hard: list[float | None], method: str = "endoct") -> list[str]:
    """What is said of a method with these scores on easy and on hard specimens."""
    given = [(f"e{k}", "easy", value) for k, value in enumerate(easy)]
    given += [(f"h{k}", "hard", value) for k, value in enumerate(hard)]
    entries = [entry(name, difficulty=difficulty) for name, difficulty, _ in given]
    rows = [scored(name, method, value) for name, _, value in given]
    (folder / "mine.json").write_text(text_of(submission(rows, entries)), encoding="utf-8")
    (only,) = read_boards(folder)
    return uneven_difficulty(only)


def test_what_is_better_on_harder_specimens_is_said_to_be_chance_or_not(tmp_path: Path) -> None:
    (sentence,) = uneven(tmp_path, [0.5, 0.6], [0.7, 0.8])
    assert sentence == (
        "On endoct's simulator, endoct's median is better on hard ones (0.75; 2 cases of 2 specimens) than on "
        "easy ones (0.55; 2 cases of 2 specimens). By the rank test, p = 0.33: that may be chance."
    )
    (sentence,) = uneven(tmp_path, [0.1, 0.2, 0.3, 0.4], [0.5, 0.6, 0.7, 0.8])
    assert sentence.endswith(". By the rank test, p = 0.029.")
    (sentence,) = uneven(tmp_path, [None, None], [0.1, 0.1])  # what was not answered is worse than any answer
    assert "easy ones (–; 2 cases" in sentence
    assert uneven(tmp_path, [0.7, 0.8], [0.5, 0.6]) == []
    assert uneven(tmp_path, [0.7], [0.7]) == []
    assert uneven(tmp_path, [0.5, 0.6], [0.7, 0.8], "other") == []


def test_cases_of_a_specimen_are_not_independent(tmp_path: Path) -> None:
    """Six cases of three specimens would be unlikely by chance if they were of six."""
    both = {"oct": "b" * 64, "endoscope": "d" * 64}
    names = [("easy", f"e{k}") for k in range(3)] + [("hard", f"h{k}") for k in range(3)]
    entries = [entry(name, difficulty=word).model_copy(update={"unrolled": both}) for word, name in names]
    rows = [scored(name, "endoct", 0.5 if word == "easy" else 0.7) for word, name in names]
    rows += [row.model_copy(update={"case": f"{row.specimen}/endoscope/wall"}) for row in rows]
    (tmp_path / "mine.json").write_text(text_of(submission(rows, entries)), encoding="utf-8")
    (only,) = read_boards(tmp_path)
    (sentence,) = uneven_difficulty(only)
    assert "hard ones (0.7; 6 cases of 3 specimens)" in sentence
    assert sentence.endswith("p = 0.1: that may be chance.")


def test_a_lower_score_is_better_where_the_task_says_so(tmp_path: Path) -> None:
    entries = [entry("s0"), entry("s1", difficulty="hard")]
    rows = [scored(name, "endoct", None) for name in ("s0", "s1")]
    rows = [
        row.model_copy(update={"case": row.specimen, "status": "ok", "scores": {"landmark_mm": value}})
        for row, value in zip(rows, (0.2, 0.1), strict=True)
    ]
    (tmp_path / "mine.json").write_text(text_of(submission(rows, entries, "alignment")), encoding="utf-8")
    (only,) = read_boards(tmp_path)
    (sentence,) = uneven_difficulty(only)
    assert "better on hard ones (0.1; 1 case of 1 specimen) than on easy ones (0.2;" in sentence


def test_parts_of_endoct_are_known_by_what_they_are(tmp_path: Path) -> None:
    values = {"endoct": 0.5, "a": 0.7, "learned-eye": 0.6}
    rows = [scored("s0", name, value, success=True) for name, value in values.items()]
    eye = "endoct.workbench.bench.rivals.learned_segmentation:learned_eye (endoct 0.1.0)"
    given = submission(rows, [entry("s0")])
    given = given.model_copy(update={"methods": {**given.methods, "a": eye}})
    (tmp_path / "mine.json").write_text(text_of(given), encoding="utf-8")
    write_board(tmp_path, tmp_path / "board.html")
    page = (tmp_path / "board.html").read_text(encoding="utf-8")
    assert "<td>a <small>part of endoct</small></td>" in page
    assert page.count("<small>part of endoct</small>") == 1
    assert "<li>a (part of endoct) on endoct&#39;s simulator" in page  # it is better all the same
    assert "<li>learned-eye on endoct&#39;s simulator" in page


def test_the_list_of_parts_is_that_of_registered_methods() -> None:
    """What others published is none of them, though endoct's settings do it."""
    bench = "endoct.workbench.bench."
    tasks = [load_task(name) for name in task_names()]
    registered = {origin(task, name).partition(" ")[0] for task in tasks for name in method_names(task)}
    assert registered >= PARTS
    of_tasks = {place for place in registered if place.startswith(f"{bench}tasks.") and not place.endswith(":ours")}
    published = {f"{bench}tasks.oct:{name}" for name in ("literal", "sine", "sine_even")}
    assert of_tasks - PARTS == published


def test_every_specimen_says_who_succeeds_on_it(tmp_path: Path) -> None:
    values = {"endoct": 0.7, "better": 0.9, "worse": 0.2, "bad": 0.3, "shy": None}
    rows = [scored("s0", name, value, success=(value or 0) > 0.5) for name, value in values.items()]
    rows += [scored("t0", name, 0.1) for name in values]
    entries = [entry("s0", difficulty="hard"), entry("t0", generator="second")]
    (tmp_path / "mine.json").write_text(text_of(submission(rows, entries)), encoding="utf-8")
    write_board(tmp_path, tmp_path / "board.html")
    page = (tmp_path / "board.html").read_text(encoding="utf-8")
    page = page[page.index('<h2 id="specimens">') :]
    first, second = page.split("<details>")[1:]
    assert "s0: endoct&#39;s simulator, hard" in first
    cells = re.findall(r"<td[^>]*>([^<]*)</td>", first)
    assert cells == ["segmentation oct/wall", "better 0.9, endoct 0.7", "bad 0.3, worse 0.2, shy declined"]
    assert "t0: the second generator, easy" in second
    assert re.findall(r"<td[^>]*>([^<]*)</td>", second)[1] == "–"
