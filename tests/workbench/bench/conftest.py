"""Tasks and cases that tests of the bench share."""

import pytest
from bench_tasks import DOUBLING, EASY, install

from endoct.workbench.bench.task import AnyTask
from endoct.workbench.bench.tasks.alignment import TASK, AlignmentCase


@pytest.fixture
def doubling(monkeypatch: pytest.MonkeyPatch) -> AnyTask:
    """The task, installed."""
    install(monkeypatch, DOUBLING)
    return DOUBLING


@pytest.fixture(scope="session")
def easy() -> AlignmentCase:
    """Two panoramas that hardly lie apart."""
    return TASK.cases(0, 0, EASY)
