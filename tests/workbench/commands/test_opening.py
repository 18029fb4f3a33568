"""What `endoct open` says as it ends: which runs go on without it."""

import sys
import tomllib
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from threading import Event
from types import SimpleNamespace

import pytest
from workbench_page import serving

from endoct.workbench.commands.opening import open_folder
from endoct.workbench.desk.desk import Desk
from endoct.workbench.desk.desk_app import desk_app
from endoct.workbench.desk.runs import Queue
from endoct.workbench.desk.state import State


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


def test_a_second_double_click_shows_the_page_that_is_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """And where the server has ended meanwhile, starts another."""
    monkeypatch.setattr("endoct.workbench.desk.state.user_state_path", lambda *_, **__: tmp_path / "state")
    shown: list[str] = []
    monkeypatch.setattr("webbrowser.open", shown.append)
    started: list[str] = []
    monkeypatch.setattr(
        "endoct.workbench.page.serving.run_server",
        lambda app, host, port, say: started.append(host) or say("http://no/"),
    )
    state = State(tmp_path / "state")
    with serving(lambda host, port: desk_app(Desk(state, {}), host, port)) as served:
        start = f"{served.url}{state.token}/"
        state.address_file(f"{start}f/some-folder/")
        assert open_folder() == 0
        assert not started
        assert capsys.readouterr().out == f"{start} is open already\n"
        assert shown == [(tmp_path / "state" / "open.html").as_uri()]
        assert f"url={start}" in (tmp_path / "state" / "open.html").read_text().replace("&#x27;", "")
        assert open_folder(port=1) == 0  # who names a port wants a server there
        assert started == ["127.0.0.1"]
        state.address_file(start)
    assert open_folder() == 0
    assert started == ["127.0.0.1"] * 2


def test_a_browser_that_stays_in_the_foreground_finds_the_server(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("endoct.workbench.desk.state.user_state_path", lambda *_, **__: tmp_path / "state")
    runs, ended = Event(), Event()
    monkeypatch.setattr("webbrowser.open", lambda _: ended.set() if runs.wait(20) else None)

    def serve(app: object, host: str, port: int, say: Callable[[str], None]) -> None:
        say("http://here/")
        runs.set()

    monkeypatch.setattr("endoct.workbench.page.serving.run_server", serve)
    assert open_folder(tmp_path) == 0
    assert ended.wait(20)


def test_a_double_click_opens_the_start_page(monkeypatch: pytest.MonkeyPatch):
    scripts = tomllib.loads(Path("pyproject.toml").read_text())["project"]["gui-scripts"]
    module, _, name = scripts["endoct-workbench"].partition(":")
    monkeypatch.setattr("sys.argv", ["endoct-workbench", "x"])
    monkeypatch.setattr("endoct.workbench.cli.main", lambda: None)
    getattr(import_module(module), name)()
    assert sys.argv[1:] == ["open"]
