"""`endoct bench`: what is written and printed, and what is refused."""

import csv
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from rich.table import Table

from endoct.base.errors import EndoctError
from endoct.workbench.bench.checkpoint import Facts
from endoct.workbench.bench.command import run_bench
from endoct.workbench.bench.task import AnyTask
from endoct.workbench.cli import main


def bench(output: Path | None = None, methods: Sequence[str] = (), against: str | None = None, count: int = 2) -> Facts:
    return run_bench(
        "doubling", methods=methods, seeds="3-6", count=count, against=against, output=output, progress=False
    )[0]


def test_results_are_written_and_told(doubling: AnyTask, tmp_path: Path) -> None:
    facts = bench(output=tmp_path / "out", against="wrong")
    with (tmp_path / "out" / "results.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {row["method"] for row in rows} == set(doubling.methods) - {"absent"}
    assert len(rows) == 4 * 2 * (len(doubling.methods) - 1)
    for row in rows:
        if row["method"] == "right":
            assert float(row["score.error"]) == 0.0
            assert row["condition.kind"] in ("plain", "odd")
        if row["status"] != "ok":
            assert row["score.error"] == ""
    stored = json.loads((tmp_path / "out" / "bench.json").read_text(encoding="utf-8"))
    assert stored == json.loads(json.dumps(facts))
    assert stored["seeds"] == [3, 4, 5, 6]
    assert {"machine", "versions", "methods", "summary", "conditions"} <= set(stored)
    plots = {path.name for path in (tmp_path / "out" / "plots").iterdir()}
    assert plots == {"overview.png", "against-size.png", "against-kind.png"}
    told = stored["differences"]
    assert (told["against"], [(one["method"], one["score"], one["spread"]["n"]) for one in told["of"]]) == (
        "wrong",
        [("right", "error", 8)],
    )


def test_a_method_that_is_not_installed_is_left_out_and_said(doubling: AnyTask) -> None:
    facts, lines = run_bench("doubling", methods=["right", "absent"], seeds="3-6", progress=False)
    assert facts["left_out"] == {"absent": "a_library_that_is_not_installed is not installed"}
    assert [one["method"] for one in facts["summary"]] == ["right"]
    table = lines[0]
    assert isinstance(table, Table)
    assert table.row_count == 1
    assert "left out: absent, because a_library_that_is_not_installed is not installed" in lines
    with pytest.raises(EndoctError, match="none of the methods is installed; found absent"):
        bench(methods=["absent"])


def test_a_program_is_tried_beside_a_method(tmp_path: Path) -> None:
    text = "import sys, numpy as np; np.save(sys.argv[2] + '/mask.npy', np.load(sys.argv[1] + '/valid.npy'))"
    (tmp_path / "all.py").write_text(text, encoding="utf-8")
    program = [f"all={sys.executable} {tmp_path / 'all.py'}"]
    for methods, run in (("", ["all"]), ("otsu", ["otsu", "all"])):
        facts, _ = run_bench("segmentation", methods=methods, program=program, seeds="3", progress=False)
        assert [of["method"] for of in facts["summary"]] == run
        assert facts["summary"][-1]["ok"] == 1
    assert facts["methods"]["all"] == program[0].removeprefix("all=")
    with pytest.raises(EndoctError, match="each name once"):
        run_bench("segmentation", program=[*program, *program], seeds="3", progress=False)


@pytest.mark.parametrize(
    ("ask", "match"),
    [
        (lambda: bench(methods=["rigt"]), "'right'"),
        (lambda: bench(methods=["right", "right"]), "twice"),
        (lambda: bench(against="best"), "unknown method"),
        (lambda: bench(count=0), "at least 1"),
    ],
)
def test_what_cannot_be_run_is_refused(ask: Callable[[], object], match: str, doubling: AnyTask) -> None:
    with pytest.raises(EndoctError, match=match):
        ask()


def test_the_command_line_lists_describes_and_refuses(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def said(*arguments: str) -> tuple[int, str]:
        monkeypatch.setattr("sys.argv", ["endoct", "bench", *arguments])
        with pytest.raises(SystemExit) as leave:
            main()
        streams = capsys.readouterr()
        return int(leave.value.code or 0), streams.out + streams.err

    status, text = said("--json")
    assert status == 0
    assert {"segmentation", "oct", "pose"} <= set(json.loads(text))
    status, text = said("segmentation", "--describe")
    assert status == 0
    assert "signal_db" in text
    assert "a success is a Jaccard index of at least" in text
    assert "otsu" in text
    _, text = said("alignment", "--describe")
    assert "\nSays where B lies" in text  # a line of its own
    status, text = said("segmentation", "--methods", "otsuu")
    assert status == 1
    assert "'otsu'" in text
