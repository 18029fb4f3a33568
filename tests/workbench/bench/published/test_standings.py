"""Standings: counted over all cases, and honest about where endoct is beaten."""

from pathlib import Path

import numpy as np
import pytest
from published_sets import entry, scored, submission

from endoct.base.errors import EndoctError
from endoct.workbench.bench.published.standings import TaskBoard, read_boards
from endoct.workbench.bench.published.submission import Scored, text_of

pytestmark = pytest.mark.usefixtures("sets_of_any_size")
NAMES = [f"s{k}" for k in range(8)]


def board_of(tmp_path: Path, *files: list[Scored]) -> TaskBoard:
    entries = [entry(name, difficulty="easy" if k < 4 else "hard") for k, name in enumerate(NAMES)]
    for number, rows in enumerate(files):
        (tmp_path / f"file{number}.json").write_text(text_of(submission(rows, entries)), encoding="utf-8")
    (board,) = read_boards(tmp_path)
    return board


def test_shares_are_over_all_cases_and_medians_over_answers(tmp_path: Path) -> None:
    values = [0.9, 0.8, None, 0.6, 0.5, 0.4, None, 0.2]
    board = board_of(
        tmp_path, [scored(n, "endoct", v, success=bool(v and v > 0.55)) for n, v in zip(NAMES, values, strict=True)]
    )
    (standing,) = board.standings("simulator")
    assert (standing.success.k, standing.success.n, standing.ok, standing.declined) == (3, 8, 6, 2)
    assert standing.median == pytest.approx(0.55)
    assert standing.mean == pytest.approx(np.mean([0.9, 0.8, 0.6, 0.5, 0.4, 0.2]))
    assert (standing.low, standing.high) == (0.2, 0.9)  # of six values by order statistics: the least and the largest
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
    assert board.losses() == []  # better in the two that it answered with success, worse in three


def test_methods_of_one_name_are_kept_apart(tmp_path: Path) -> None:
    board = board_of(tmp_path, [scored(n, "mine", 0.7) for n in NAMES], [scored(n, "mine", 0.6) for n in NAMES])
    assert [each.name for each in board.entrants] == ["mine", "mine (file1)"]
    assert board.losses() == []


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
