"""What `endoct open` says as it ends: which runs go on without it."""

import sys
import tomllib
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import pytest

from endoct.workbench.commands.opening import open_folder
from endoct.workbench.desk.runs import Queue


@pytest.mark.parametrize(
    ("states", "said"),
    [
        (["running", "waiting", "done", "failed"], ["1 of 2 runs go on"]),
        (["waiting", "waiting"], ["0 of 2 runs go on"]),
        (["running"], ["1 of 1 runs go on"]),
        (["done", "lost"], []),
    ],
)
def test_runs_that_go_on_are_counted(
    states: list[str],
    said: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("endoct.workbench.desk.state.user_state_path", lambda *_, **__: tmp_path / "state")
    monkeypatch.setattr("endoct.workbench.page.serving.run_server", lambda app, host, port, say: say("http://here/"))
    monkeypatch.setattr(Queue, "runs", lambda _: [SimpleNamespace(state=state) for state in states])
    assert open_folder(tmp_path, no_browser=True) == 0
    printed = capsys.readouterr()
    assert printed.err == f"opening {tmp_path}; the address follows\n"  # at once; the rest takes seconds
    first, *rest = printed.out.splitlines()
    assert first.startswith("http://here/")
    assert f" shows {tmp_path}; Ctrl+C ends it" in " ".join([first, *rest])
    assert [line.split("; ")[0] for line in rest if "runs go on" in line] == said


def test_a_double_click_opens_the_start_page(monkeypatch: pytest.MonkeyPatch):
    scripts = tomllib.loads(Path("pyproject.toml").read_text())["project"]["gui-scripts"]
    module, _, name = scripts["endoct-workbench"].partition(":")
    monkeypatch.setattr("sys.argv", ["endoct-workbench", "x"])
    monkeypatch.setattr("endoct.workbench.cli.main", lambda: None)
    getattr(import_module(module), name)()
    assert sys.argv[1:] == ["open"]
