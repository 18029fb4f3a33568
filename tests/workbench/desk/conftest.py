"""A study with two recordings, and the desk that is opened on it."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from endoct.workbench.commands.opening import ON_THE_PAGE
from endoct.workbench.desk.desk import Desk
from endoct.workbench.desk.state import State


@pytest.fixture
def study(short: Path, tmp_path: Path) -> Path:
    """A folder with the two recordings of one bore; tests may change it."""
    folder = tmp_path / "my study"
    shutil.copytree(short, folder / "bore-1")
    return folder


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Desk]:
    made = Desk(State(tmp_path / "state"), ON_THE_PAGE)
    yield made
    made.previewer.close()
