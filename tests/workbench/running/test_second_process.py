"""A second process where there is a processor for it."""

import pytest

from endoct.workbench.running.second_process import second_process


def test_one_processor_gets_no_second_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    with second_process() as process:
        assert process is None


def test_two_processors_get_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    with second_process() as process:
        assert process is not None
        assert process.call(abs, -1).result() == 1
