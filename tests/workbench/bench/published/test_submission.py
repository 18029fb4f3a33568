"""A submission: run on a set, written whole, refused where anything was changed, and run again in part."""

import json
import sys
from pathlib import Path

import pytest
from made_once import MadeOnce
from published_sets import entry, scored, submission

from endoct.base.errors import EndoctError
from endoct.workbench.bench.published.checking import Checked, Rerun, check, read_receipts
from endoct.workbench.bench.published.submission import digest_of, read_submission, submit, text_of
from endoct.workbench.bench.published.submitted import Scored, Submission
from endoct.workbench.commands.published import check as check_command
from endoct.workbench.running.progress import SilentStages

DEEP = """
import json, pathlib, sys
import numpy
given, answer = map(pathlib.Path, sys.argv[1:])
if (given / "depth_mm.npy").exists():
    numpy.save(answer / "mask.npy", numpy.load(given / "depth_mm.npy") > 0.06)
else:
    (answer / "answer.json").write_text(json.dumps({"declined": "no depth"}))
"""

DECLINES = """
import pathlib, sys
(pathlib.Path(sys.argv[2]) / "answer.json").write_text('{"declined": "no idea"}')
"""


def run(data: Path, output: Path, task: str = "segmentation", **options: object) -> Submission:
    return submit(data, task, output, stages=SilentStages(), **options)  # type: ignore[arg-type]


def test_methods_and_a_program_are_scored_on_every_specimen(made_set: Path, tmp_path: Path) -> None:
    (tmp_path / "deep.py").write_text(DEEP, encoding="utf-8")
    program = f"{sys.executable} {tmp_path / 'deep.py'}"
    made = run(made_set, tmp_path / "mine.json", methods=["endoct", "li-depth"], programs={"deep": program})
    assert read_submission(tmp_path / "mine.json") == made
    assert set(made.methods) == {"endoct", "li-depth", "deep"}
    assert made.methods["deep"] == program == made.programs["deep"]
    assert len(made.rows) == 2 * 2 * 3  # specimens, recordings, methods
    status = {(row.case.split("/")[1], row.status) for row in made.rows if row.method == "deep"}
    assert status == {("oct", "ok"), ("endoscope", "declined")}
    ours = [row.scores["jaccard"] for row in made.rows if row.method == "endoct" and "jaccard" in row.scores]
    assert max(ours) > 0.7
    assert not list(tmp_path.glob("*.unfinished"))
    with pytest.raises(EndoctError, match="exists"):
        run(made_set, tmp_path / "mine.json", methods=["li-depth"])


def test_damaged_data_are_refused_before_anything_runs(changed_set: Path, tmp_path: Path) -> None:
    (changed_set / "simulator-hard-000" / "truth" / "recording.json").write_text("{}", encoding="utf-8")
    with pytest.raises(EndoctError, match="another truth"):
        run(changed_set, tmp_path / "mine.json", methods=["li-depth"])
    assert not (tmp_path / "mine.json").exists()


def test_a_task_without_specimens_is_refused(made_set: Path, tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match="no specimen"):
        run(made_set, tmp_path / "mine.json", task="pose")


def test_a_file_that_was_edited_is_no_submission(tmp_path: Path) -> None:
    path = tmp_path / "mine.json"
    made = submission([scored("a", "mine", 0.5)], [entry("a")])
    path.write_text(text_of(made), encoding="utf-8")
    assert read_submission(path) == made
    content = json.loads(path.read_text(encoding="utf-8"))
    content["rows"][0]["scores"]["jaccard"] = 0.9
    for text in (json.dumps(content), "{}", "[]", text_of(made)[:-20]):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(EndoctError, match="cannot be used"):
            read_submission(path)


@pytest.fixture(scope="module")
def submitted(made_set: Path, made_once: MadeOnce) -> Path:
    return made_once("submitted.json", lambda path: run(made_set, path, methods=["li-depth", "k-means"]))


def test_a_rerun_is_equal_to_the_last_digit(submitted: Path, made_set: Path) -> None:
    checked = check(submitted, made_set, sample=1, nonce="a word", stages=SilentStages())
    assert len(checked.reruns) == 2 * 2  # recordings, methods
    assert checked.count("equal") == 4


def test_the_sample_follows_from_the_nonce_and_leaves_a_receipt(
    submitted: Path, made_set: Path, tmp_path: Path
) -> None:
    drawn = set()
    for nonce in "abcdef":
        path = tmp_path / f"{nonce}.json"
        assert check_command(submitted, made_set, nonce, sample=1, methods="k-means", receipt=path) == 0
        ((digest, (receipt,)),) = read_receipts(tmp_path).items()
        assert digest == digest_of(read_submission(submitted))
        assert (receipt.nonce, receipt.verdicts) == (nonce, {"k-means": "equal"})
        drawn.add(receipt.specimens)
        path.unlink()
        if len(drawn) == 2:
            break
    assert len(drawn) == 2  # no specimen is safe


def test_a_set_to_learn_from_scores_nothing(changed_set: Path, tmp_path: Path) -> None:
    path = changed_set / "set.json"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace('"split":"test"', '"split":"train"'), encoding="utf-8")
    with pytest.raises(EndoctError, match="no specimen"):
        run(changed_set, tmp_path / "mine.json", methods=["li-depth"])
    path.write_text(text.replace("endoct-bench-2", "endoct-bench-1"), encoding="utf-8")
    with pytest.raises(EndoctError, match="is closed"):
        run(changed_set, tmp_path / "mine.json", methods=["li-depth"])


def test_some_methods_are_enough(submitted: Path, made_set: Path) -> None:
    checked = check(submitted, made_set, sample=1, nonce="a word", methods=["k-means"], stages=SilentStages())
    assert {rerun.again.method for rerun in checked.reruns} == {"k-means"}
    with pytest.raises(EndoctError, match="k-means"):
        check(submitted, made_set, sample=1, nonce="a word", methods=["k-mean"], stages=SilentStages())


@pytest.fixture
def with_a_program(submitted: Path, tmp_path: Path) -> Path:
    """A submission that calls its k-means a program, with a command that leaves a file where it is run."""
    made = read_submission(submitted)
    command = f"touch {tmp_path / 'it-was-run'}"
    rows = [row.model_copy(update={"method": "theirs"}) if row.method == "k-means" else row for row in made.rows]
    methods = {"li-depth": made.methods["li-depth"], "theirs": command}
    changed = made.model_copy(update={"rows": tuple(rows), "methods": methods, "programs": {"theirs": command}})
    path = tmp_path / "theirs.json"
    path.write_text(text_of(changed), encoding="utf-8")
    return path


def test_a_command_in_the_file_is_never_run(
    with_a_program: Path, made_set: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert check_command(with_a_program, made_set, sample=1, nonce="a word") == 0
    said = " ".join(capsys.readouterr().out.split())
    assert f"theirs: a program, in the file: touch {tmp_path / 'it-was-run'}; not run again" in said
    assert "2 rows run again: 2 equal" in said  # those of li-depth, which is installed
    with pytest.raises(EndoctError, match=r"no command of a file is run.*--program theirs=COMMAND"):
        check(with_a_program, made_set, sample=1, nonce="a word", methods=["theirs"], stages=SilentStages())
    assert not (tmp_path / "it-was-run").exists()


def test_a_program_is_run_by_the_command_of_whoever_checks(
    with_a_program: Path, made_set: Path, tmp_path: Path
) -> None:
    (tmp_path / "declines.py").write_text(DECLINES, encoding="utf-8")
    own = {"theirs": f"{sys.executable} {tmp_path / 'declines.py'}"}
    checked = check(with_a_program, made_set, sample=1, nonce="a word", programs=own, stages=SilentStages())
    assert checked.programs == own
    assert {rerun.again.status for rerun in checked.reruns if rerun.again.method == "theirs"} == {"declined"}
    assert {rerun.again.method for rerun in checked.reruns} == {"li-depth", "theirs"}
    alone = check(
        with_a_program, made_set, sample=1, nonce="a word", methods=["theirs"], programs=own, stages=SilentStages()
    )
    assert {rerun.again.method for rerun in alone.reruns} == {"theirs"}
    assert not (tmp_path / "it-was-run").exists()
    for name, match in (("li-depth", "is no program"), ("else", "unknown method")):
        with pytest.raises(EndoctError, match=match):
            check(with_a_program, made_set, sample=1, nonce="a word", programs={name: "true"}, stages=SilentStages())


def test_a_part_of_the_set_is_not_checked(submitted: Path, made_set: Path, tmp_path: Path) -> None:
    made = read_submission(submitted)
    first = made.specimens[0].name
    rows = tuple(row for row in made.rows if row.specimen == first)
    part = made.model_copy(update={"specimens": made.specimens[:1], "rows": rows})
    (tmp_path / "part.json").write_text(text_of(part), encoding="utf-8")
    with pytest.raises(EndoctError, match="not of the whole set"):
        check(tmp_path / "part.json", made_set, sample=1, nonce="a word", stages=SilentStages())


def test_other_scores_are_different(submitted: Path, made_set: Path, tmp_path: Path) -> None:
    made = read_submission(submitted)
    rows = [row.model_copy(update={"scores": {**row.scores, "jaccard": 0.999}}) for row in made.rows]
    (tmp_path / "better.json").write_text(text_of(made.model_copy(update={"rows": tuple(rows)})), encoding="utf-8")
    checked = check(tmp_path / "better.json", made_set, sample=2, nonce="a word", stages=SilentStages())
    assert checked.count("different") == len(checked.reruns) == 8


def test_another_set_of_the_same_name_is_refused(submitted: Path, changed_set: Path) -> None:
    path = changed_set / "set.json"
    depth = read_submission(submitted).specimens[0].means["truth"][0]
    path.write_text(path.read_text(encoding="utf-8").replace(f"{depth}", f"{depth + 1}"), encoding="utf-8")
    with pytest.raises(EndoctError, match="another specimen"):
        check(submitted, changed_set, sample=1, nonce="a word", stages=SilentStages())


@pytest.mark.parametrize(("factor", "verdict"), [(1.0, "equal"), (1 + 1e-12, "near"), (1.01, "different")])
def test_the_last_bits_are_told_from_another_result(factor: float, verdict: str) -> None:
    facts = {"specimen": "a", "case": "a", "method": "mine", "reason": "", "seconds": 1.0, "cpu_seconds": 1.0}
    before, after = (
        Scored.model_validate({**facts, "status": "ok", "scores": {"jaccard": value}}) for value in (0.7, 0.7 * factor)
    )
    assert Rerun(before, after).verdict == verdict
    declined = before.model_copy(update={"status": "declined", "scores": {}})
    assert Rerun(before, declined).verdict == "different"


def rerun(stated: dict[str, float], again: dict[str, float]) -> Rerun:
    one = scored("a", "mine", None)
    return Rerun(*(one.model_copy(update={"status": "ok", "scores": scores}) for scores in (stated, again)))


@pytest.mark.parametrize("name", ["jaccard", "precision"])
def test_one_forged_score_among_near_ones_is_found(name: str) -> None:
    """The worst of all scores counts, wherever it stands; a score that is equal says nothing of the others."""
    true = {"jaccard": 0.7, "recall": 0.5, "precision": 0.9}
    near = {score: value * (1 + 1e-9) for score, value in true.items()}
    assert rerun(true, near).verdict == "near"
    assert rerun(true, true | {name: true[name] + 0.05}).verdict == "different"
    assert rerun(true, near | {name: true[name] + 0.05}).verdict == "different"
    assert rerun(true, true | {name: true[name] * (1 - 1e-9)}).verdict == "near"


@pytest.mark.parametrize(("factor", "verdict"), [(1 + 0.9e-6, "near"), (1 + 1.1e-6, "different")])
def test_what_is_near_is_relative(factor: float, verdict: str) -> None:
    for value in (1e-4, 1.0, -300.0):
        assert rerun({"error_mm": value}, {"error_mm": factor * value}).verdict == verdict
        assert rerun({"error_mm": factor * value}, {"error_mm": value}).verdict == verdict
    assert rerun({"error_mm": 0.0}, {"error_mm": 1e-9}).worst == 1  # of nothing, everything is all


def test_scores_left_out_or_added_are_another_result() -> None:
    assert rerun({"jaccard": 0.7, "recall": 0.5}, {"jaccard": 0.7}).verdict == "different"
    assert rerun({"jaccard": 0.7}, {"jaccard": 0.7, "recall": 0.5}).verdict == "different"


def test_rows_are_counted_by_verdict() -> None:
    rows = [rerun({"jaccard": 0.7}, {"jaccard": value}) for value in (0.7, 0.7 + 1e-9, 0.7, 0.1)]
    stated = submission([row.stated for row in rows], [entry("a")])
    checked = Checked(stated, tuple(rows), stated.data_digest, {})
    assert [checked.count(verdict) for verdict in ("equal", "near", "different")] == [2, 1, 1]
    assert checked.is_of_equal_data
    assert not Checked(stated, tuple(rows), "0" * 64, {}).is_of_equal_data
