"""The public Python interface: names that complete, a version, examples that run, errors that speak Python."""

import doctest
import inspect
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from endoct import workbench
from endoct.base.errors import EndoctError
from endoct.fusion.evidence.evidence import Evidence
from endoct.fusion.geometry.alignment import Alignment
from endoct.modalities.reading.format import Format
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.workbench import cli, unroll
from endoct.workbench.commands import completion_script
from endoct.workbench.running.refusals import in_one_line

EXAMPLES = (
    "demo unroll compare load summarise export verify calibrate",
    "simulate",
    "pose pose_outlook",
    "run_bench train",
)
"""Names whose examples build on one another, in order."""
PUBLIC = tuple(getattr(workbench, name) for names in EXAMPLES for name in names.split())


def test_every_public_name_completes_and_loads() -> None:
    assert {function.__name__ for function in PUBLIC} == set(workbench.__all__)
    assert {*workbench.__all__, "__version__"} <= set(dir(workbench))
    for function in PUBLIC:
        parameters = inspect.signature(function).parameters.values()
        assert all(parameter.annotation is not inspect.Parameter.empty for parameter in parameters)
    with pytest.raises(AttributeError, match="unrol"):
        workbench.unrol  # type: ignore[attr-defined]  # noqa: B018


def test_the_version_is_that_of_the_package(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["endoct", "--version"])
    with pytest.raises(SystemExit) as leave:
        cli.main()
    assert not leave.value.code
    assert capsys.readouterr().out == f"endoct {workbench.__version__}\n"


def test_the_command_line_starts_without_what_only_work_needs() -> None:
    code = "import endoct.workbench.commands, sys, json; print(json.dumps(sorted(sys.modules)))"
    loaded = json.loads(subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout)
    assert not {"numpy", "cv2", "scipy", "xarray", "zarr", "matplotlib", "torch", "IPython", "jinja2"} & set(loaded)


def run_examples(*documented: Any, **names: Any) -> None:
    finder, said = doctest.DocTestFinder(recurse=False), list[str]()
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    for each in documented:
        (example,) = finder.find(each, each.__name__, **names)
        assert example.examples, f"{each.__name__} has no example"
        runner.run(example, out=said.append)
    assert not runner.failures, "".join(said)


@pytest.mark.parametrize("names", EXAMPLES)
def test_examples_in_docstrings_run(names: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    run_examples(*(getattr(workbench, name) for name in names.split()), globs={})


def test_examples_of_types_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    run_examples(SurfaceGrid, Panorama, Evidence, Format, Alignment)  # these see the names of their modules


def test_errors_speak_of_arguments_in_python_and_of_flags_on_the_command_line(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    with pytest.raises(EndoctError, match="replace it with overwrite=True") as exists:
        unroll(tmp_path / "recording", tmp_path / "there")
    line = in_one_line(exists.value)
    assert line is not None
    assert line.endswith("replace it with --overwrite")
    for remedy, flag in (
        ("leave out volume=True", "leave out --volume"),
        ("say which with modality='NAME'", "say which with --modality NAME"),
        ("give it with settings_b={'pitch_mm': VALUE}", "give it with --set-b pitch_mm=VALUE"),
    ):
        assert in_one_line(EndoctError("it", remedy=remedy)) == f"it; {flag}"


@pytest.mark.skipif(sys.platform == "win32", reason="no bash")
def test_bash_completes_commands_options_and_values(tmp_path: Path) -> None:
    (tmp_path / "endoct.bash").write_text(completion_script("bash"))
    for line, expected in (
        ("endoct simu", "simulate"),
        ("endoct compare --set-", "--set-a --set-b"),
        ("endoct simulate --preset m", "mastoid"),
    ):
        words = line.split()
        script = (
            f"source {tmp_path}/endoct.bash; COMP_WORDS=({line}); COMP_CWORD={len(words) - 1}; "
            '_tyro_endoct; echo "${COMPREPLY[*]}"'
        )
        done = subprocess.run(["bash", "--norc", "-c", script], capture_output=True, text=True, check=True)
        assert done.stdout.strip() == expected
    assert "complete -o default -o bashdefault -F" in completion_script("bash")  # paths too
    assert "completion_array || _files" in completion_script("zsh")
