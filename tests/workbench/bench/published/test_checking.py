"""A sample of a submission run again: equal to the last digit, or said to be different."""

from pathlib import Path

import pytest

from endoct.base.errors import EndoctError
from endoct.workbench.bench.published.checking import Rerun, check
from endoct.workbench.bench.published.submission import Scored, read_submission, submit, text_of
from endoct.workbench.running.progress import SilentStages


@pytest.fixture(scope="module")
def submitted(made_set: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("submitted") / "mine.json"
    submit(made_set, "segmentation", path, methods=["li-depth", "k-means"], stages=SilentStages())
    return path


def test_a_rerun_is_equal_to_the_last_digit(submitted: Path, made_set: Path) -> None:
    checked = check(submitted, made_set, sample=1, stages=SilentStages())
    assert len(checked.reruns) == 2 * 2  # recordings, methods
    assert checked.count("equal") == 4


def test_some_methods_are_enough(submitted: Path, made_set: Path) -> None:
    checked = check(submitted, made_set, sample=1, methods=["k-means"], stages=SilentStages())
    assert {rerun.again.method for rerun in checked.reruns} == {"k-means"}
    with pytest.raises(EndoctError, match="k-means"):
        check(submitted, made_set, sample=1, methods=["k-mean"], stages=SilentStages())


def test_other_scores_are_different(submitted: Path, made_set: Path, tmp_path: Path) -> None:
    made = read_submission(submitted)
    rows = [row.model_copy(update={"scores": {**row.scores, "jaccard": 0.999}}) for row in made.rows]
    (tmp_path / "better.json").write_text(text_of(made.model_copy(update={"rows": tuple(rows)})), encoding="utf-8")
    checked = check(tmp_path / "better.json", made_set, sample=2, stages=SilentStages())
    assert checked.count("different") == len(checked.reruns) == 8


def test_another_set_of_the_same_name_is_refused(submitted: Path, changed_set: Path) -> None:
    path = changed_set / "set.json"
    depth = read_submission(submitted).specimens[0].means["truth"][0]
    path.write_text(path.read_text(encoding="utf-8").replace(f"{depth}", f"{depth + 1}"), encoding="utf-8")
    with pytest.raises(EndoctError, match="another specimen"):
        check(submitted, changed_set, sample=1, stages=SilentStages())


@pytest.mark.parametrize(("factor", "verdict"), [(1.0, "equal"), (1 + 1e-12, "near"), (1.01, "different")])
def test_the_last_bits_are_told_from_another_result(factor: float, verdict: str) -> None:
    facts = {"specimen": "a", "case": "a", "method": "mine", "reason": "", "seconds": 1.0, "cpu_seconds": 1.0}
    before, after = (
        Scored.model_validate({**facts, "status": "ok", "scores": {"jaccard": value}}) for value in (0.7, 0.7 * factor)
    )
    assert Rerun(before, after).verdict == verdict
    declined = before.model_copy(update={"status": "declined", "scores": {}})
    assert Rerun(before, declined).verdict == "different"
