"""Drawing the conditions of cases."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from endoct.base.errors import EndoctError
from endoct.workbench.bench.runner import MethodResult, run_method
from endoct.workbench.bench.task import AnyCase, AnyTask, Range, draw, load_method, load_task, method_names, task_names
from endoct.workbench.bench.tasks import alignment, depth, oct, pose, segmentation, stitching, wall


@given(seed=st.integers(0, 10**6), index=st.integers(0, 1000), low=st.floats(-5, 5), width=st.floats(0, 5))
def test_narrowing_one_condition_leaves_the_others(seed: int, index: int, low: float, width: float) -> None:
    ranges: dict[str, Range] = {"a": (0.0, 1.0), "b": (low, low + width), "c": ("x", "y", "z")}
    drawn = draw(seed, index, ranges)
    assert low <= float(drawn["b"]) <= low + width
    narrow = draw(seed, index, {"c": ("x", "y", "z"), "a": (0.0, 1.0), "b": (low, low)})
    assert (narrow["a"], narrow["c"]) == (drawn["a"], drawn["c"])
    assert narrow["b"] == pytest.approx(low)


EXTRAS = ("SimpleITK", "ashlar", "kornia")
"""What a rival may lack; its row then says how to get it."""


@pytest.mark.parametrize("name", task_names())
def test_every_method_can_be_imported_without_extras(name: str) -> None:
    task = load_task(name)
    assert task.title
    assert "method(" in task.signature
    assert method_names(task)
    for method in method_names(task):
        assert callable(load_method(task, method))


THRESHOLDS = {
    "segmentation": (segmentation.GOOD_ENOUGH,),
    "wall": (wall.GOOD_ENOUGH,),
    "oct": (oct.GOOD_ENOUGH,),
    "alignment": (alignment.SUCCESS_PX,),
    "depth": (depth.WALL_UM, depth.CELL_UM),
    "stitching": (100 * stitching.LEAST_RIGHT, stitching.RIGHT_MM, stitching.RIGHT_DEG, 100 * stitching.MOST_WRONG),
    "pose": (pose.SUCCESS_MM, pose.BEYOND_MM),
}
"""What the judges of tasks hold an answer against, in the order in which they say so."""


@pytest.mark.parametrize("name", task_names())
def test_every_task_says_what_it_calls_a_success(name: str) -> None:
    numbers = [float(number) for number in re.findall(r"\d+(?:\.\d+)?", load_task(name).success)]
    assert numbers == pytest.approx(THRESHOLDS[name])


def _unsound(task: AnyTask, case: AnyCase) -> dict[str, str]:
    """Return why methods failed that should not have."""
    rows = [run_method(task, name, case) for name in method_names(task)]
    return {row.method: row.reason for row in rows if row.status == "failed" and not _lacks_an_extra(row)}


def _lacks_an_extra(row: MethodResult) -> bool:
    return "pip install" in row.reason and any(extra in row.reason for extra in EXTRAS)


def _narrow(task: AnyTask, **ranges: Range) -> dict[str, Range]:
    return {**task.ranges, **ranges}


@pytest.mark.slow
def test_alignment(monkeypatch: pytest.MonkeyPatch) -> None:
    # the same scene on an eighth of the rows and columns
    for name, value in {
        "N_THETA": alignment.N_THETA // 8,
        "N_Z": alignment.N_Z // 8,
        "PX_MM": 8 * alignment.PX_MM,
        "BLOB_PX": tuple(px / 8 for px in alignment.BLOB_PX),
    }.items():
        monkeypatch.setattr(alignment, name, value)
    task = load_task("alignment")
    case = task.cases(2, 0, _narrow(task, orientation=("upright",), overlap=(0.9, 0.9), noise=("low",)))
    assert _unsound(task, case) == {}


def test_stitching() -> None:
    task = load_task("stitching")
    case = task.cases(2, 0, _narrow(task))
    assert _unsound(task, case) == {}
    assert run_method(task, "endoct", case).scores["right"] > 0.5


@pytest.mark.slow
def test_oct() -> None:
    task = load_task("oct")
    case = task.cases(2, 0, _narrow(task))
    assert case.scratch is not None
    with case.scratch:
        assert _unsound(task, case) == {}


def test_a_task_that_is_not_known_is_told_with_the_nearest() -> None:
    with pytest.raises(EndoctError, match="'segmentation'"):
        load_task("segmentatoin")
