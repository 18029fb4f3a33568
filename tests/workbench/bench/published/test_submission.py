"""A submission: run on a set, written whole, and refused where anything was changed."""

import json
import sys
from pathlib import Path

import pytest
from published_sets import entry, scored, submission

from endoct.base.errors import EndoctError
from endoct.workbench.bench.published.submission import Submission, read_submission, submit, text_of
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
