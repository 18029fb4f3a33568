"""Compiled loops: where their machine code cannot be kept they still run, and small systems of equations are solved."""

import errno
import os
import runpy
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core.caching import CompileResultCacheImpl, IndexDataCacheFile

from endoct.base.compute.compiled import compiled
from endoct.base.numeric.least_squares import solve


def twice(value: float) -> float:
    return 2 * value


def test_code_that_cannot_be_kept_is_compiled_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(CompileResultCacheImpl, "_locator_classes", [])
    assert compiled(twice)(21.0) == 42


MODULE = """
from endoct.base.compute.compiled import compiled

@compiled
def twice(value):
    return 2 * value

print(twice(21.0), sum(twice.stats.cache_hits.values()))
"""


def test_code_is_kept_for_later_processes(tmp_path: Path) -> None:
    (tmp_path / "module.py").write_text(MODULE)
    command = [sys.executable, "module.py"]
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "kept")}

    def run() -> str:
        return subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True).stdout

    assert (run(), run()) == ("42.0 0\n", "42.0 1\n")


def test_code_that_is_kept_damaged_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "module.py").write_text(MODULE)
    kept = tmp_path / "kept"
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(kept))

    def run() -> str:
        runpy.run_path(str(tmp_path / "module.py"))
        return capsys.readouterr().out

    assert (run(), run()) == ("42.0 0\n", "42.0 1\n")
    for pattern in ("*.nbi", "*.nbc"):
        (file,) = kept.rglob(pattern)
        for damaged in (file.read_bytes()[:-20], b"", b"nonsense"):
            file.write_bytes(damaged)
            assert (run(), run()) == ("42.0 0\n", "42.0 1\n")


def test_code_that_no_disk_takes_is_made_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    for name in ("_save_index", "_save_data"):
        monkeypatch.setattr(IndexDataCacheFile, name, full)
    assert compiled(twice)(21.0) == 42


COMPILES_MUCH = """
from endoct.base.compute.compiled import compiled
from endoct.base.compute.own_process import when_compiling

when_compiling(lambda: print("compiling"))

@compiled
def twice(value):
    return value + value

for value in (1, 1.0, True, 1j, "1", (1,), (1, 1), (1.0, 1), (1.0,)):
    twice(value)
"""


def test_who_compiles_much_says_so_once(tmp_path: Path) -> None:
    (tmp_path / "module.py").write_text(COMPILES_MUCH)

    def run() -> str:
        command = [sys.executable, "module.py"]
        environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "kept")}
        return subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True).stdout

    assert (run(), run()) == ("compiling\n", "")


@pytest.mark.parametrize("n", [1, 3, 23])
def test_equations_are_solved(n: int) -> None:
    rng = np.random.default_rng(n)
    matrix, solution = rng.normal(size=(n, n)), rng.normal(size=n)
    matrix[0, 0] = 0 if n > 1 else 2  # needs another pivot
    vector = matrix @ solution
    solve(matrix.copy(), vector)
    np.testing.assert_allclose(vector, solution, rtol=1e-9)


def test_an_environment_that_numba_refuses_is_said_in_one_line() -> None:
    command = [sys.executable, "-c", "import endoct.base.compute.compiled"]
    done = subprocess.run(
        command, env=os.environ | {"NUMBA_NUM_THREADS": "0"}, capture_output=True, text=True, check=False
    )
    assert done.stderr.splitlines()[-1].endswith(
        "EndoctError: numba cannot be loaded; found Number of threads specified must be > 0.; "
        "see what NUMBA_… says in the environment"
    )
