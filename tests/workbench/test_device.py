"""`--device`: refused in one line where there is none; without it nothing loads torch that does not need it."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from endoct.workbench import cli

Run = Callable[..., tuple[int, list[str]]]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Run one command line; return its status and the lines that it printed to stderr."""

    def run_once(*arguments: object) -> tuple[int, list[str]]:
        monkeypatch.setattr(sys, "argv", ["endoct", *map(str, arguments)])
        with pytest.raises(SystemExit) as leave:
            cli.main()
        return int(leave.value.code or 0), capsys.readouterr().err.splitlines()

    return run_once


COMMANDS = {
    "pose": ("pose", "{oct}", "--ct", "{oct}", "--entry=0,0,0", "--target=0,0,9"),
    "plan only": ("pose", "--plan-only", "--ct", "{oct}", "--entry=0,0,0", "--target=0,0,9"),
}


@pytest.mark.parametrize("words", COMMANDS.values(), ids=COMMANDS.keys())
def test_without_a_device_it_is_one_line_and_nothing_is_written(
    run: Run, small_specimen: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...]
) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    filled = [word.format(oct=small_specimen / "oct-spectra") for word in words]
    status, lines = run(*filled, "-o", tmp_path / "out", "--device", "cuda")
    assert (status, len(lines)) == (1, 1)
    assert "there is no CUDA device; found cuda; expected cpu; leave out --device cuda" in lines[0]
    assert not list(tmp_path.iterdir())


def test_on_the_cpu_nothing_loads_torch(small_specimen: Path) -> None:
    code = (
        "import sys; from endoct.workbench import unroll; "
        f"unroll({str(small_specimen / 'oct-spectra')!r}, progress=False); print('torch' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
