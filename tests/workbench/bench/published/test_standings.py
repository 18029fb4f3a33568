"""Standings: counted over all cases, and honest about where endoct is beaten."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from published_sets import entry, scored, submission

from endoct.base.errors import EndoctError
from endoct.workbench.bench.published.checking import Receipt
from endoct.workbench.bench.published.standings import TaskBoard, read_boards
from endoct.workbench.bench.published.submission import digest_of, text_of
from endoct.workbench.bench.published.submitted import Scored

pytestmark = pytest.mark.usefixtures("sets_of_any_size")
NAMES = [f"s{k}" for k in range(8)]


def board_of(tmp_path: Path, *files: list[Scored]) -> TaskBoard:
    used = {row.specimen for rows in files for row in rows}
    entries = [entry(name, difficulty="easy" if k < 4 else "hard") for k, name in enumerate(NAMES) if name in used]
    for number, rows in enumerate(files):
        (tmp_path / f"file{number}.json").write_text(text_of(submission(rows, entries)), encoding="utf-8")
    (board,) = read_boards(tmp_path)
    return board


def test_shares_and_medians_are_over_all_cases(tmp_path: Path) -> None:
    values = [0.9, 0.8, None, 0.6, 0.5, 0.4, None, 0.2]
    board = board_of(
        tmp_path, [scored(n, "endoct", v, success=bool(v and v > 0.55)) for n, v in zip(NAMES, values, strict=True)]
    )
    (standing,) = board.standings("simulator")
    assert (standing.success.k, standing.success.n, standing.ok, standing.declined) == (3, 8, 6, 2)
    assert standing.median == pytest.approx(0.45)  # what was declined is worse than any answer
    assert standing.mean == pytest.approx(np.mean([0.9, 0.8, 0.6, 0.5, 0.4, 0.2]))
    assert (standing.low, standing.high) == (-np.inf, 0.9)  # of eight by order statistics: the least and the largest
    easy, hard = (board.standings("simulator", word)[0] for word in ("easy", "hard"))
    assert (easy.success.k, hard.success.k) == (3, 0)
    assert np.isnan(easy.low)  # three answers are too few for an interval of 95 %
    assert board.difficulties("simulator") == ("easy", "hard")


def test_losses_are_counted_case_by_case(tmp_path: Path) -> None:
    ours = [scored(n, "endoct", 0.7, success=True) for n in NAMES]
    better = [scored(n, "better", 0.8 if k < 5 else 0.6, success=True) for k, n in enumerate(NAMES)]
    worse = [scored(n, "worse", 0.9 if k < 3 else 0.1) for k, n in enumerate(NAMES)]
    even = [scored(n, "even", 0.7, success=True) for n in NAMES]
    board = board_of(tmp_path, [*ours, *better], [*worse, *even])
    (loss,) = board.losses()
    assert (loss.method, loss.better, loss.worse, loss.even) == ("better", 5, 3, 0)
    assert (loss.theirs, loss.ours) == (0.8, 0.7)
    assert board.standings("simulator")[0].entrant.name == "better"


def test_to_decline_where_endoct_succeeds_is_a_loss_for_who_declines(tmp_path: Path) -> None:
    ours = [scored(n, "endoct", 0.7 if k < 3 else None, success=True) for k, n in enumerate(NAMES)]
    other = [scored(n, "other", None if k < 3 else 0.2, success=k > 5) for k, n in enumerate(NAMES)]
    board = board_of(tmp_path, [*ours, *other])
    assert board.losses() == []
    loss = board._loss("simulator", *board.entrants)
    assert (loss.better, loss.worse, loss.even) == (2, 3, 3)  # better in the two that it answered with success


def test_methods_of_one_name_are_kept_apart(tmp_path: Path) -> None:
    files = [[scored(n, "mine", value) for n in NAMES] for value in (0.7, 0.6)]
    board = board_of(tmp_path, *files)
    assert [each.name for each in board.entrants] == ["mine", "mine (file1)"]
    assert board.losses() == []  # without endoct's own, nobody is compared with it
    board = board_of(tmp_path, *files, [scored(n, "endoct", 0.5) for n in NAMES])
    assert [(loss.method, loss.theirs) for loss in board.losses()] == [("mine", 0.7), ("mine (file1)", 0.6)]


def test_submissions_on_different_recordings_are_refused(tmp_path: Path) -> None:
    for number in range(2):
        of = entry("s0")
        of = of.model_copy(update={"means": {**of.means, "truth": (29.2 + number, 3.1)}})
        text = text_of(submission([scored("s0", "mine", 0.5)], [of]))
        (tmp_path / f"{number}.json").write_text(text, encoding="utf-8")
    with pytest.raises(EndoctError, match="different recordings"):
        read_boards(tmp_path)
    with pytest.raises(EndoctError, match="no submissions"):
        read_boards(tmp_path / "nothing")


def test_data_of_another_processor_are_said(tmp_path: Path) -> None:
    for number, digest in enumerate("ab"):
        of = entry("s0").model_copy(update={"unrolled": {"oct": digest * 64}})
        text = text_of(submission([scored("s0", f"mine{number}", 0.5)], [of]))
        (tmp_path / f"{number}.json").write_text(text, encoding="utf-8")
    (board,) = read_boards(tmp_path)
    assert not board.has_equal_data


@pytest.mark.parametrize("better", ["higher", "lower"])
def test_the_best_score_comes_first_and_none_last(tmp_path: Path, better: str) -> None:
    values = {"nothing": None, "small": 0.2, "endoct": 0.5, "large": 0.8}
    rows = [scored(name, method, value) for method, value in values.items() for name in NAMES]
    board = board_of(tmp_path, rows)
    board = replace(board, scored=board.scored.model_copy(update={"better": better}))
    order = [one.entrant.name for one in board.standings("simulator")]
    first, last = ("large", "small") if better == "higher" else ("small", "large")
    assert order == [first, "endoct", last, "nothing"]
    (loss,) = board.losses()
    assert (loss.method, loss.better, loss.worse, loss.even) == (first, 8, 0, 0)


def test_success_counts_before_the_score(tmp_path: Path) -> None:
    often = [scored(name, "often", 0.6, success=k < 2) for k, name in enumerate(NAMES)]
    well = [scored(name, "well", 0.9, success=k < 1) for k, name in enumerate(NAMES)]
    board = board_of(tmp_path, [*well, *often])
    assert [one.entrant.name for one in board.standings("simulator")] == ["often", "well"]


@pytest.mark.parametrize(
    ("theirs", "counted"),
    [((None, False), (0, 1, 0)), ((0.1, False), (0, 1, 0)), ((0.7, True), (0, 0, 1)), ((0.8, True), (1, 0, 0))],
)
def test_a_refusal_against_a_success(
    tmp_path: Path, theirs: tuple[float | None, bool], counted: tuple[int, int, int]
) -> None:
    """Ours answered one case with 0.7 and success; of a case that only one of two answered, success decides."""
    for ours_first in (True, False):
        rows = [scored("s0", "other", theirs[0], success=theirs[1]), scored("s0", "endoct", 0.7, success=True)]
        board = board_of(tmp_path, rows[::-1] if ours_first else rows)
        ours, other = sorted(board.entrants, key=lambda one: one.name != "endoct")
        loss = board._loss("simulator", ours, other)
        assert (loss.better, loss.worse, loss.even) == counted
        turned = board._loss("simulator", other, ours)
        assert (turned.better, turned.worse, turned.even) == (counted[1], counted[0], counted[2])


def test_two_refusals_are_even_and_a_failure_in_vain_is_no_worse_than_one(tmp_path: Path) -> None:
    rows = [scored("s0", "endoct", None), scored("s0", "other", None), scored("s1", "endoct", None)]
    rows.append(scored("s1", "other", 0.3, success=False))
    ours, other = (board := board_of(tmp_path, rows)).entrants
    loss = board._loss("simulator", ours, other)
    assert (loss.better, loss.worse, loss.even) == (0, 0, 2)
    assert np.isnan([loss.theirs, loss.ours]).all()


def test_a_status_that_is_not_ok_has_no_score(tmp_path: Path) -> None:
    rows = [scored("s0", "endoct", 0.4, seconds=1.0), scored("s1", "endoct", 0.6, seconds=5.0)]
    failed = scored("s2", "endoct", 0.9, success=True, seconds=3.0).model_copy(update={"status": "failed"})
    (standing,) = board_of(tmp_path, [*rows, failed]).standings("simulator")
    assert (standing.ok, standing.failed, standing.declined, standing.cases) == (2, 1, 0, 3)
    assert (standing.median, standing.mean, standing.seconds) == (0.4, 0.5, 3.0)


def receipt_of(tmp_path: Path, board: TaskBoard, file: str, verdicts: dict[str, str]) -> Path:
    """A folder with the receipt of one submission of a board."""
    made = next(one.submission for one in board.entrants if one.file == file)
    facts = {"submission": digest_of(made), "nonce": "a word", "specimens": ("s0", "s1"), "verdicts": verdicts}
    folder = tmp_path / "receipts"
    folder.mkdir(exist_ok=True)
    (folder / f"{file}.json").write_text(Receipt.model_validate(facts).model_dump_json(), encoding="utf-8")
    return folder


def test_a_forged_file_heads_no_board(tmp_path: Path) -> None:
    """Not one that nobody ran again, nor one with other scores when run again, nor one that calls itself ours."""
    true = [scored(n, "endoct", 0.6, success=k < 4) for k, n in enumerate(NAMES)]
    forged = [scored(n, name, 0.99, success=True) for name in ("endoct", "mine") for n in NAMES]
    board = board_of(tmp_path, forged, true)
    assert board.standings("simulator")[-1].entrant.file == "file1"  # while nothing is checked, scores decide
    folder = receipt_of(tmp_path, board, "file1", {"endoct": "equal"})
    (board,) = read_boards(tmp_path, folder)
    first, *rest = board.standings("simulator")
    assert (first.entrant.name, first.entrant.file, first.entrant.checked) == ("endoct", "file1", 2)
    assert [one.entrant.checked for one in rest] == [0, 0]
    assert {one.method for one in board.losses()} == {"endoct (file0)", "mine"}
    receipt_of(tmp_path, board, "file0", {"mine": "different", "endoct": "different"})
    (board,) = read_boards(tmp_path, folder)
    assert [one.entrant.checked for one in board.standings("simulator")] == [2, -1, -1]
    assert board.losses() == []


def test_a_receipt_is_of_one_content(tmp_path: Path) -> None:
    """Scores that are changed after a check, the digest made anew, are not checked."""
    board = board_of(tmp_path, [scored(n, "mine", 0.5) for n in NAMES])
    folder = receipt_of(tmp_path, board, "file0", {"mine": "equal"})
    board_of(tmp_path, [scored(n, "mine", 0.9) for n in NAMES])
    (board,) = read_boards(tmp_path, folder)
    assert [one.checked for one in board.entrants] == [0]
    (folder / "other.json").write_text("{}", encoding="utf-8")
    with pytest.raises(EndoctError, match="is no receipt"):
        read_boards(tmp_path, folder)


@pytest.mark.parametrize("better", ["higher", "lower"])
def test_to_decline_all_or_all_but_the_easiest_is_behind_honest_failure(tmp_path: Path, better: str) -> None:
    best = 0.95 if better == "higher" else 0.01
    rows = [scored(n, "declines", None) for n in NAMES] + [scored(n, "honest", 0.4) for n in NAMES]
    rows += [scored(n, "picks", best if n == "s0" else None) for n in NAMES]
    board = board_of(tmp_path, rows)
    board = replace(board, scored=board.scored.model_copy(update={"better": better}))
    assert [one.entrant.name for one in board.standings("simulator")] == ["honest", "picks", "declines"]


def test_a_loss_is_told_by_successes_and_with_its_p(tmp_path: Path) -> None:
    ours = [scored(n, "endoct", 0.69 if k < 2 else 0.95, success=k >= 2) for k, n in enumerate(NAMES)]
    other = [scored(n, "other", 0.71, success=True) for n in NAMES]
    (loss,) = board_of(tmp_path, [*ours, *other]).losses()
    assert (loss.side, loss.better, loss.worse, loss.successes) == ("oct", 2, 6, (8, 6))
    assert loss.p == pytest.approx(2 * (1 + 8 + 28) / 256)  # two or fewer of eight, both ways
