"""The figures of the board: a method looks alike in all of them."""

from pathlib import Path

import pytest
from published_sets import entry, scored, submission

from endoct.workbench.bench.published.board_figures import styles_of
from endoct.workbench.bench.published.standings import TaskBoard, read_boards
from endoct.workbench.bench.published.submission import text_of
from endoct.workbench.bench.results.plots import STYLES

pytestmark = pytest.mark.usefixtures("sets_of_any_size")


def boards_of(folder: Path, **methods: list[str]) -> list[TaskBoard]:
    """Boards of tasks by name, with these methods."""
    for task, names in methods.items():
        rows = [scored("s0", name, 0.5, success=True) for name in names]
        if task != "segmentation":
            rows = [row.model_copy(update={"case": "s0"}) for row in rows]
        (folder / f"{task}.json").write_text(text_of(submission(rows, [entry("s0")], task)), encoding="utf-8")
    return read_boards(folder)


def test_a_method_looks_alike_in_every_task(tmp_path: Path) -> None:
    boards = boards_of(tmp_path, oct=["a", "both", "endoct"], segmentation=["b", "c", "both", "endoct"], wall=["d"])
    styles = styles_of(boards)
    assert styles["endoct"] == STYLES[0]
    for board in boards:  # whoever is compared differs
        assert len({styles[entrant.name] for entrant in board.entrants}) == len(board.entrants)
    assert styles["both"] == STYLES[1]  # of two tasks: chosen before those of one
    assert styles["a"] == styles["b"] == STYLES[2]  # no figure shows both
    assert styles == styles_of(read_boards(tmp_path))


def test_more_methods_than_styles_repeat_as_few_as_can_be(tmp_path: Path) -> None:
    names = ["endoct", *(f"m{k}" for k in range(len(STYLES) + 3))]
    styles = styles_of(boards_of(tmp_path, segmentation=names))
    assert set(styles.values()) == set(STYLES)
    assert max([*styles.values()].count(style) for style in STYLES) == 2
