"""A study with two recordings, and the desk that is opened on it."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from kept_process import KeptProcess
from workbench_page import written

from endoct.workbench.commands.opening import ON_THE_PAGE
from endoct.workbench.desk.desk import Desk
from endoct.workbench.desk.state import State


@pytest.fixture(scope="session")
def comparison(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A comparison that took no time; tests must not change it."""
    return written(tmp_path_factory.mktemp("compared") / "one")


@pytest.fixture
def study(short: Path, tmp_path: Path) -> Path:
    """A folder with the two recordings of one bore; tests may change it."""
    folder = tmp_path / "my study"
    shutil.copytree(short, folder / "bore-1")
    return folder


@pytest.fixture
def desk(tmp_path: Path, kept_process: KeptProcess, monkeypatch: pytest.MonkeyPatch) -> Iterator[Desk]:
    """A desk that draws in the process that all commands share."""
    monkeypatch.setattr("endoct.workbench.desk.sidecar_form.worker_process", kept_process.lent)
    made = Desk(State(tmp_path / "state"), ON_THE_PAGE)
    yield made
    made.previewer.close()
