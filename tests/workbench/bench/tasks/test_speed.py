"""The task "speed" of the bench, small: answers agree and what was measured is there; never how long it took."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from rich.table import Table

from endoct.base.errors import EndoctError
from endoct.workbench.bench.cases.speed_jobs import Work, place_of, resized, write_recording
from endoct.workbench.bench.command import run_bench
from endoct.workbench.bench.rivals.speed import literal, opencv, reading, textbook
from endoct.workbench.bench.task import Case, Declined
from endoct.workbench.bench.tasks.alignment import AlignmentCase
from endoct.workbench.bench.tasks.speed import TASK, SpeedCase, cases, ours
from endoct.workbench.running.measured import Measured

SMALL = {
    "repeats": (2.0, 2.0),
    "slices": (18.0, 18.0),
    "ascans": (400.0, 400.0),
    "frames": (4.0, 4.0),
    "frame_px": (320.0, 320.0),
}
Method = Callable[[Work], Measured[Any]]


def small(job: str, repeats: int = 2) -> SpeedCase:
    return cases(1000, 0, {**SMALL, "repeats": (float(repeats), float(repeats)), "job": (job,)})


@pytest.fixture(scope="module")
def strips() -> SpeedCase:
    return small("strips")


def scores(case: SpeedCase, method: Method) -> dict[str, float]:
    answer = method(case.given)
    assert len(answer.seconds) in (1, case.given.repeats)
    judged = dict(TASK.judge(case, answer))
    assert set(judged) == {"success", *TASK.scores}
    assert all(judged[name] > 0 for name in ("seconds", "peak_mb", "per_s"))
    return judged


@pytest.mark.parametrize("job", ["threshold", "spectra"])
def test_the_textbook_and_endoct_agree(job: str) -> None:
    case = small(job)
    of_ours = scores(case, ours)
    assert of_ours["success"] == scores(case, textbook)["success"] == 1
    assert np.isfinite(of_ours["instrument"]) == (job != "threshold")


@pytest.mark.parametrize("method", [ours, textbook, opencv])
def test_strips_show_what_the_frames_show(strips: SpeedCase, method: Method) -> None:
    assert scores(strips, method)["success"] == 1


def test_a_library_without_a_function_for_a_job_says_so() -> None:
    with pytest.raises(Declined, match="no function for this job"):
        opencv(Work("threshold", (np.zeros(3),), 1))
    with pytest.raises(Declined, match="unrolls pullbacks"):
        literal(Work("threshold", (np.zeros(3),), 1))


def test_pairs_that_hardly_lie_apart_are_aligned(easy: AlignmentCase) -> None:
    case = Case("easy", Work("alignment", easy.given, 1), easy, {**small("threshold").conditions, "job": "alignment"})
    assert scores(case, ours)["success"] == 1
    assert scores(case, textbook)["error"] < 20


def test_a_pullback_longer_than_the_one_it_is_made_of_is_unrolled_and_judged() -> None:
    case = small("pullback", repeats=1)
    try:
        assert scores(case, ours)["error"] < 0.2
        read = scores(case, reading)
        assert (read["success"], read["error"]) == (1, 0)
        for chain in (literal, textbook):
            assert scores(case, chain)["error"] < 1  # it overlaps with the truth
        assert TASK.judge(case, Measured(17, (1.0,), (1.0,), 1.0))["success"] == 0
    finally:
        assert case.scratch is not None
        case.scratch.cleanup()


def test_answers_that_are_wrong_do_not_succeed() -> None:
    case = small("threshold")
    wrong = Measured(1.1 * case.truth, (1.0,), (1.0,), 1.0)
    assert TASK.judge(case, wrong)["success"] == 0
    with pytest.raises(EndoctError, match="nothing was measured; found float"):
        TASK.judge(case, 0.3)


def test_jobs_take_turns_and_the_table_has_a_line_for_each_with_its_methods(tmp_path: Path) -> None:
    wanted = [f"{name}={int(low)}..{int(high)}" for name, (low, high) in SMALL.items()]
    facts, lines = run_bench(
        "speed",
        ["job=threshold|spectra", *wanted],
        methods=["endoct", "reading"],
        seeds="1000-1001",
        output=tmp_path / "out",
        progress=False,
    )
    assert [(one["word"], one["method"]) for one in facts["summary"]] == [
        ("spectra", "endoct"),
        ("spectra", "reading"),
        ("threshold", "endoct"),
        ("threshold", "reading"),
    ]
    table = lines[0]
    assert isinstance(table, Table)
    assert [column.header for column in table.columns][:7] == [
        "job",
        "method",
        "success (95 %)",
        "seconds",
        "instrument",
        "peak_mb",
        "error",
    ]
    assert table.row_count == 2  # none for a method that does neither job
    plots = tmp_path / "out" / "plots"
    assert sorted(path.relative_to(plots).as_posix() for path in plots.rglob("overview.png")) == [
        "spectra/overview.png",
        "threshold/overview.png",
    ]
    assert "spectra, reading: declined: this job is in memory" in lines


def test_frames_go_forth_and_back() -> None:
    assert [place_of(k, 3, forth_and_back=True) for k in range(7)] == [0, 1, 2, 2, 1, 0, 0]
    assert [place_of(k, 3, forth_and_back=False) for k in range(4)] == [0, 1, 2, 0]


@pytest.mark.parametrize(("side", "shape"), [("oct", (8, 20)), ("endoscope", (5, 20, 3))])
def test_a_recording_is_resized_as_its_kind_is(side: str, shape: tuple[int, ...], tmp_path: Path) -> None:
    """A slice keeps its depth; a frame of 2 × 8 becomes one of 5 × 20."""
    (tmp_path / side).mkdir()
    stack = np.full((3, 8, 10) if side == "oct" else (3, 2, 8, 3), 7, np.uint8)
    stack[1], stack[2] = 9, 11
    if side == "oct":
        tifffile.imwrite(tmp_path / side / "pullback.tif", stack, photometric="minisblack")
    else:
        for k, frame in enumerate(stack):
            tifffile.imwrite(tmp_path / side / f"frame_{k}.tif", frame, photometric="rgb")
    (tmp_path / side / "acquisition.toml").write_text(f'modality = "{side}"\n')
    n, frame = resized(tmp_path, side, 20)
    assert n == 3
    assert frame(1).shape == shape
    assert (frame(1) == 9).all()
    n_bytes = write_recording(tmp_path, side, 5, 20, tmp_path / "made", "uint16")
    made = tifffile.imread(tmp_path / "made" / "recording.tif")
    assert (made.shape, made.dtype, made.nbytes) == ((5, *shape), np.uint16, n_bytes)
    assert [round(float(each.mean())) for each in made] == [7, 9, 11, *((11, 9) if side == "oct" else (7, 9))]
    assert np.ptp(made[0]) == 2, "noise of one up or down"
    assert (tmp_path / "made" / "acquisition.toml").is_file()
