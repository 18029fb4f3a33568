"""Whatever a file is called or says, and whatever runs out: one line, one exit status, a terminal left alone."""

import csv
import io
import json
import logging
import os
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mock_comparison import GRID
from rich.console import Console

from endoct.base.errors import visible
from endoct.base.files.files import digests, path_text, spreadsheet_text
from endoct.fusion.files.store import PROPERTIES, write_cells
from endoct.fusion.scoring.cells import Cell
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import save_panorama
from endoct.workbench import cli
from endoct.workbench.bench.results.result_tables import (
    difference_table,
    footnotes,
    table,
    write_csv,
)
from endoct.workbench.bench.results.score_summary import Difference, Spread
from endoct.workbench.bench.runner import MethodResult
from endoct.workbench.bench.tasks.segmentation import TASK
from endoct.workbench.commands.console import TextConsole, print_json, print_line
from endoct.workbench.pipeline.summarising import write_summary
from endoct.workbench.running.outputs import json_text
from endoct.workbench.running.progress import ConsoleStages

HOSTILE = "[/x][red]:smile:\x1b[31m\u202eb\x07\rc \udce9"
SHOWN = r"[/x][red]:smile:\x1b[31m\u202eb\x07\rc \udce9"
FORMULAE = ('=HYPERLINK("x")', "+1+cmd|' /C calc'!A0", "-2+3", "@SUM(A1)", "\t=1")
CODE = "import sys; from endoct.workbench.cli import main; sys.argv[0] = 'endoct'; main()"

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Run one command line; return its status, and what it printed to stdout and to stderr."""
    monkeypatch.setattr(warnings, "formatwarning", warnings.formatwarning)  # put back at the end

    def run_once(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["endoct", *map(str, arguments)])
        with pytest.raises(SystemExit) as leave:
            cli.main()
        return int(leave.value.code or 0), *capsys.readouterr()

    return run_once


@pytest.fixture
def panorama(tmp_path: Path) -> Path:
    """A panorama whose modality and notes somebody made up."""
    values = np.ones(GRID.shape, np.float32)
    made = Panorama(GRID, values, None, values > 0, values, "oct", True, True, "slice", {}, {}, (HOSTILE,))
    save_panorama(made, tmp_path / "p.zarr")
    return tmp_path / "p.zarr"


def _exhausted(*_: Any, **__: Any) -> None:
    np.empty(2**57)


def _nested(*_: Any, **__: Any) -> None:
    _nested()


def _opencv(*_: Any, **__: Any) -> None:
    raise cv2.error("OpenCV(5.0.0) alloc.cpp:73: error: (-4:Insufficient memory) Failed to allocate 9 bytes")


def _full(*_: Any, **__: Any) -> None:
    raise OSError(28, "No space left on device", f"a{HOSTILE}")


def _unencodable(*_: Any, **__: Any) -> None:
    "\udce9".encode()


@pytest.mark.parametrize(
    ("fails", "said"),
    [
        (_exhausted, "memory ran out; found Unable to allocate 1.00 EiB"),
        (_opencv, "memory ran out; found OpenCV"),
        (_nested, "something in the input is nested too deeply"),
        (_full, "a" + SHOWN.replace(r"\r", " ") + " cannot be used; found No space left on device"),
        (_unencodable, r"a text cannot be written; found '\udce9'"),
    ],
)
def test_what_runs_out_is_told_in_one_line(
    panorama: Path, run: Run, monkeypatch: pytest.MonkeyPatch, fails: Callable[..., None], said: str
) -> None:
    monkeypatch.setattr("endoct.workbench.pipeline.information.describe", fails)
    status, out, err = run("info", panorama)
    assert status == 1
    assert out == ""
    assert err.startswith(f"endoct: {said}")
    assert err.count("\n") == 1
    assert len(err) < 500


def test_a_fault_of_our_own_keeps_its_trace(panorama: Path, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("endoct.workbench.pipeline.information.describe", lambda *_: {}["key"])
    monkeypatch.setattr(sys, "argv", ["endoct", "info", str(panorama)])
    with pytest.raises(KeyError):
        cli.main()


def test_memory_that_runs_out_leaves_nothing_half_written(
    short: Path, tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = "endoct.workbench.pipeline.unrolling"
    monkeypatch.setattr(f"{store}.save_panorama", _exhausted)
    monkeypatch.setattr(f"{store}.unroll_recording", lambda *_, **__: type("Made", (), {"panorama": None}))
    monkeypatch.setattr(f"{store}.begin_wall", lambda *_: None)
    status, _, err = run("unroll", short / "oct", "-o", tmp_path / "out.zarr")
    assert status == 1
    assert "memory ran out" in err
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no disk that is always full")
@pytest.mark.parametrize("arguments", [["modalities"], ["modalities", "--json"]])
def test_a_full_disk_behind_stdout(arguments: list[str]) -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run([sys.executable, "-c", CODE, *arguments], stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "No space left on device" in done.stderr


def test_a_reader_that_went_away_is_no_error() -> None:
    done = subprocess.run(
        ["bash", "-c", f'"{sys.executable}" -c "$0" modalities --json | true; echo ${{PIPESTATUS[0]}}', CODE],
        capture_output=True,
        text=True,
    )
    assert done.stdout == "0\n"
    assert done.stderr == ""


def test_notes_steer_no_terminal_and_are_no_markup(
    panorama: Path, run: Run, capsys: pytest.CaptureFixture[str]
) -> None:
    status, out, err = run("info", panorama)
    assert status == 0, err
    assert "\x1b" not in out
    assert "[/x][red]:smile:" in out
    status, out, _ = run("info", panorama, "--json")
    assert json.loads(out)["notes"] == [HOSTILE]
    print_line(f"note: {HOSTILE}\nforged")
    assert capsys.readouterr().out == f"note: {SHOWN}\\nforged\n"


@pytest.mark.parametrize("arguments", [("compare", "a", "b", HOSTILE), ("modalities", HOSTILE), (HOSTILE,)])
def test_wrong_usage_quotes_names_visibly(run: Run, arguments: tuple[str, ...]) -> None:
    status, out, err = run(*arguments)
    assert status == 2
    assert "[red]:smile:" in out + err
    assert not any(sign in out + err for sign in "\x1b\u202e\x07\r\udce9")


def test_tables_of_the_bench_show_texts_as_they_are(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    rows = [MethodResult(HOSTILE, HOSTILE, "failed", f"ValueError: {HOSTILE}", 1.0, 1.0, {}, {})]
    apart = [Difference(HOSTILE, HOSTILE, Spread(1, 0.0, 0.0, 0.0), 0, 1)]
    console = TextConsole(width=200)
    for part in (table(rows, TASK), *footnotes(rows, TASK), difference_table(apart, HOSTILE)):
        console.print(part)
    out = capsys.readouterr().out
    assert "\x1b" not in out
    assert out.count(SHOWN) == 2 + 2 + 2  # method; method and reason; header and method
    assert f"less {SHOWN}" in out


@pytest.mark.parametrize("console", [TextConsole, Console])
def test_titles_of_stages_are_no_markup(console: Callable[..., Console]) -> None:
    for terminal in (True, False):
        shown = io.StringIO()
        stages = ConsoleStages(console(file=shown, force_terminal=terminal, width=150))
        with stages.stage(f"survey {HOSTILE}") as advance:
            advance(0.5)
        assert f"survey {SHOWN}" in shown.getvalue()


def test_what_libraries_log_and_warn_of_is_visible(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run("modalities")[0] == 0
    record = logging.LogRecord("tifffile", logging.WARNING, "x.py", 1, "<%s> is odd\nand so on", (HOSTILE,), None)
    assert isinstance(logging.lastResort, logging.Handler)
    assert logging.lastResort.format(record) == f"<{SHOWN}> is odd\nand so on"
    assert warnings.formatwarning(HOSTILE, UserWarning, "x.py", 1) == f"endoct: UserWarning: {SHOWN}\n"


@pytest.fixture
def odd_folder(tmp_path: Path) -> Path:
    """A folder whose name is no UTF-8."""
    folder = Path(os.fsdecode(os.fsencode(tmp_path) + b"/caf\xe9"))
    try:
        folder.mkdir()
    except OSError:
        pytest.skip("this file system has names in UTF-8 only")
    return folder


def test_digests_have_names_that_can_be_stored(odd_folder: Path) -> None:
    for k in range(2):
        (odd_folder / f"{k}.txt").write_text("x")
    assert [Path(name).parts[-2:] for name in digests(odd_folder)] == [(r"caf\xe9", "0.txt"), (r"caf\xe9", "1.txt")]
    assert path_text(odd_folder / "θ").endswith(r"caf\xe9/θ")
    for k in range(2, 20):
        (odd_folder / os.fsdecode(b"\xe9%d" % k)).write_text("x")
    ((name, digest),) = digests(odd_folder).items()
    assert name.endswith(r"caf\xe9/*")
    assert len(digest) == 64
    assert json.loads(json_text({"θ": "\udce9"}).encode()) == {"θ": "\udce9"}


def test_json_in_a_terminal_without_letters(monkeypatch: pytest.MonkeyPatch) -> None:
    for encoding in ("ascii", "latin-1", "utf-8"):
        written = io.BytesIO()
        out = io.TextIOWrapper(written, encoding=encoding)
        monkeypatch.setattr(sys, "stdout", out)
        print_json({"θ": "é\udce9"})
        out.flush()
        assert json.loads(written.getvalue().decode(encoding)) == {"θ": "é\udce9"}


def test_masks_with_odd_names_compare(odd_folder: Path, run: Run) -> None:
    rng = np.random.default_rng(1)
    cells = np.zeros((100, 256), np.uint8)
    for _ in range(20):
        cv2.circle(cells, (int(rng.integers(256)), int(rng.integers(100))), int(rng.integers(3, 8)), 255, -1)
    for name in ("one", "two"):
        (odd_folder / f"{name}.png").write_bytes(cv2.imencode(".png", cells)[1].tobytes())
        sidecar = 'modality = "mask"\nbore_diameter_mm = 2.5\nz0_mm = 0.0\ndz_mm = 0.04\n'
        (odd_folder / f"{name}.toml").write_text(sidecar)
    output = odd_folder / "out"
    status, out, err = run("compare", odd_folder / "one.png", odd_folder / "two.png", "-o", output)
    assert status == 0, err
    assert r"caf\udce9/out/report.html" in out
    result = json.loads((output / "result.json").read_text(encoding="utf-8"))
    assert [Path(name).parent.name for name in result["inputs"]] == [r"caf\xe9"] * 2
    for form in ((), ("--json",)):
        status, out, err = run("summarise", output, "-o", odd_folder / f"summary{len(form)}", *form)
        assert status == 0, err
        out.encode()
    with (odd_folder / "summary0" / "scores.csv").open(encoding="utf-8", newline="") as file:
        assert next(csv.DictReader(file))["comparison"].endswith(r"caf\xe9/out")


def test_texts_in_tables_are_no_formulae(tmp_path: Path) -> None:
    for text in FORMULAE:
        assert not spreadsheet_text(visible(text)).startswith(tuple("=+-@\t"))
        scores = {"set": "first", "comparison": text, "specimen": text, "score": "jaccard", "value": -0.5}
        write_summary({"scores": [scores]}, tmp_path / f"summary {FORMULAE.index(text)}")
        ours = tmp_path / f"summary {FORMULAE.index(text)}" / "scores.csv"
        assert _cells(ours)[1] == ["first", f"'{text}", f"'{text}", "jaccard", "-0.5"]
        rows = [MethodResult(text, text, "failed", text, 1.5, 1.5, {text: text, "shift": -1.25}, {text: -0.25})]
        write_csv(rows, TASK, tmp_path / "results.csv")
        header, told = _cells(tmp_path / "results.csv")
        cell = spreadsheet_text(visible(text))
        assert told == [TASK.name, cell, cell, "failed", cell, "1.5", "1.5", cell, "-1.25", "-0.25"]
        assert not any(cell.startswith(tuple("=+-@\t")) for cell in header)


def test_sides_in_the_table_of_cells_are_no_formulae(tmp_path: Path) -> None:
    values: dict[str, Any] = dict.fromkeys(PROPERTIES)
    write_cells([Cell(**values | {"side": "=1+1", "area_mm2": -0.5})], tmp_path / "cells.csv")
    (row,) = (dict(zip(*pair, strict=True)) for pair in [_cells(tmp_path / "cells.csv")])
    assert row["side"] == "'=1+1"
    assert row["area_mm2"] == "-0.5"


def _cells(path: Path) -> list[list[str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.reader(file))


@pytest.mark.skipif(os.name != "posix", reason="needs a POSIX shell")
@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&-", "<&- >&- 2>&-"])
def test_what_is_closed_is_no_fault(closed: str, quick_specimen: Path, tmp_path: Path) -> None:
    program = f"{sys.executable} -c 'from endoct.workbench.cli import main; main()'"
    for arguments, status in (
        ("--version", 0),
        (f"info {quick_specimen / 'oct'}", 0),
        (f"unroll {tmp_path / 'missing'} -o {tmp_path / 'x.zarr'}", 1),
        ("--help", 0),
    ):
        run = subprocess.run(f"{program} {arguments} {closed}", shell=True, capture_output=True, text=True, check=False)
        assert run.returncode == status
        assert "Traceback" not in run.stderr
        assert "Exception ignored" not in run.stderr
        assert bool(run.stderr) == (status == 1 and "2>" not in closed)
