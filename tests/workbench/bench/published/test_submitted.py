"""What cannot have come of a run is refused: by the board, and before anything is run again."""

import json
from pathlib import Path

import pytest
from published_sets import entry, scored, submission

from endoct.base.errors import EndoctError
from endoct.workbench.bench.published.standings import read_boards
from endoct.workbench.bench.published.submission import text_of
from endoct.workbench.bench.published.submitted import MOST_METHODS, Scored, Submission, check_credible

PUBLISHED = Path(__file__).parents[4] / "docs" / "results" / "board"


def with_scores(value: float, score: str = "jaccard") -> Scored:
    return scored("a", "mine", 0.5).model_copy(update={"scores": {score: value}})


def checked(rows: list[Scored], names: str = "a", expected: str = "a") -> None:
    check_credible(submission(rows, [entry(name) for name in names]), "mine.json", [*expected])


def test_what_was_published_is_believed(tmp_path: Path) -> None:
    boards = read_boards(PUBLISHED)
    assert {board.task: len(board.entrants[0].submission.specimens) for board in boards} == {
        **dict.fromkeys(("oct", "segmentation", "alignment", "depth", "wall"), 12),
        "stitching": 6,
        "pose": 5,
    }


def test_a_quarter_of_the_set_is_no_board(tmp_path: Path) -> None:
    content = json.loads((PUBLISHED / "oct.json").read_text(encoding="utf-8"))
    del content["digest"]
    content["specimens"] = content["specimens"][::4]
    kept = [one["name"] for one in content["specimens"]]
    content["rows"] = [row for row in content["rows"] if row["specimen"] in kept]
    (tmp_path / "quarter.json").write_text(text_of(Submission.model_validate(content)), encoding="utf-8")
    with pytest.raises(EndoctError, match=r"not of the whole set; found 3 specimens, without second-easy-001"):
        read_boards(tmp_path)


@pytest.mark.parametrize(
    ("score", "value"), [("jaccard", 7.0), ("jaccard", 1e308), ("jaccard", -0.1), ("success", 1.5), ("recall", 1.01)]
)
def test_an_impossible_score_is_refused(score: str, value: float) -> None:
    with pytest.raises(EndoctError, match="impossible"):
        checked([with_scores(value, score)])


@pytest.mark.parametrize(("score", "value"), [("jaccard", 1.0), ("jaccard", 0.0), ("area_error", -0.3)])
def test_a_score_at_its_bound_is_taken(score: str, value: float) -> None:
    checked([with_scores(value, score)])


def test_numbers_that_are_none_and_unknown_scores_are_refused() -> None:
    with pytest.raises(EndoctError, match="'jaccard'"):
        checked([with_scores(0.5, "jacard")])
    facts = with_scores(0.5).model_dump()
    for change in ({"scores": {"jaccard": float("nan")}}, {"seconds": float("inf")}, {"seconds": -1.0}):
        with pytest.raises(ValueError, match="validation error"):
            Scored.model_validate({**facts, **change})


def test_every_method_has_every_case_once() -> None:
    mine, other = scored("a", "mine", 0.5), scored("a", "other", 0.5)
    second = mine.model_copy(update={"case": "a/oct/again"})
    elsewhere = other.model_copy(update={"case": "a/oct/other"})
    for rows in ([mine, mine], [mine, second], [mine, other, other], [mine, elsewhere]):
        with pytest.raises(EndoctError, match="not run on every case once"):
            checked(rows)
    with pytest.raises(EndoctError, match="not run on every case once"):
        checked([scored("a", "mine", 0.5)], names="ab", expected="ab")
    checked([mine, other])
    of_two = entry("a").model_copy(update={"unrolled": {"oct": "b" * 64, "endoscope": "d" * 64}})
    check_credible(submission([mine, second], [of_two]), "mine.json", ["a"])
    with pytest.raises(EndoctError, match="found 2 rows, 1 cases; expected 2 cases"):
        check_credible(submission([mine, mine], [of_two]), "mine.json", ["a"])


def test_what_is_empty_is_no_submission() -> None:
    whole = submission([scored("a", "mine", 0.5)], [entry("a")])
    empty = {"methods": {}, "rows": ()}, {"specimens": (), "rows": ()}
    for change, expected, said in zip(empty, (["a"], []), ("no methods", "no specimens"), strict=True):
        with pytest.raises(EndoctError, match=f"it is empty; found {said}"):
            check_credible(whole.model_copy(update=change), "mine.json", expected)


def test_a_set_is_whole_and_each_specimen_in_it_once() -> None:
    rows = [scored(name, "mine", 0.5) for name in "ab"]
    for names, expected in (("ab", "abc"), ("ab", "a"), ("aab", "ab")):
        with pytest.raises(EndoctError, match="whole set"):
            checked(rows, names, expected)
    checked(rows, "ba", "ab")


def test_programs_have_names_of_their_own() -> None:
    made = submission([scored("a", "endoct", 0.5)], [entry("a")])
    for methods, programs in (({"endoct": "rm -rf ~"}, {"endoct": "rm -rf ~"}), ({"mine": "x"}, {"mine": "y"})):
        rows = (scored("a", next(iter(methods)), 0.5),)
        forged = made.model_copy(update={"methods": methods, "programs": programs, "rows": rows})
        with pytest.raises(EndoctError, match="called as ours"):
            check_credible(forged, "mine.json", ["a"])
    with pytest.raises(EndoctError, match="none of its methods"):
        check_credible(made.model_copy(update={"methods": {"other": "x"}}), "mine.json", ["a"])


def test_a_board_takes_so_many_methods(tmp_path: Path, sets_of_any_size: None) -> None:
    rows = [scored("a", f"m{k}", 0.5) for k in range(MOST_METHODS + 1)]
    with pytest.raises(EndoctError, match="too many methods"):
        checked(rows)
    for number, some in enumerate((rows[:60], rows[60:])):
        (tmp_path / f"{number}.json").write_text(text_of(submission(some, [entry("a")])), encoding="utf-8")
    with pytest.raises(EndoctError, match="too many methods"):
        read_boards(tmp_path)
    (tmp_path / "1.json").write_text(text_of(submission(rows[60:MOST_METHODS], [entry("a")])), encoding="utf-8")
    assert len(read_boards(tmp_path)[0].entrants) == MOST_METHODS


def test_other_cases_are_other_recordings(tmp_path: Path, sets_of_any_size: None) -> None:
    row = scored("a", "mine", 0.5)
    for number, one in enumerate((row, row.model_copy(update={"case": "a/oct/anna"}))):
        (tmp_path / f"{number}.json").write_text(text_of(submission([one], [entry("a")])), encoding="utf-8")
    with pytest.raises(EndoctError, match="different recordings"):
        read_boards(tmp_path)
