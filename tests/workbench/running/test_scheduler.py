"""What a second process does, and that it gives what this process would."""

from collections.abc import Iterator
from importlib import import_module

import pytest

from endoct.workbench.report.figures import rendered
from endoct.workbench.running.progress import SilentStages, Stages
from endoct.workbench.running.scheduler import ALONE, Named, Scheduler, in_background, scheduler


@pytest.fixture(params=["alone", "two"])
def work(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[Scheduler]:
    """A scheduler without a second process, and one with it."""
    monkeypatch.setattr("os.cpu_count", lambda: 1 if request.param == "alone" else 2)
    with scheduler() as one:
        yield one


def test_one_processor_gets_no_second_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    with scheduler() as work:
        assert work is ALONE


def test_whoever_needs_none_starts_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    with scheduler(needed=False) as work:
        assert work is ALONE


def test_two_processors_get_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    with scheduler() as work:
        assert work.process is not None
        assert work.begin(abs, -1).result() == 1


def test_a_call_gives_the_same_here_and_there(work: Scheduler) -> None:
    sent = work.send([3, 1, 2])
    assert work.begin(sorted, sent).result() == [1, 2, 3]
    assert work.begin(Named("builtins:max"), sent).result_of_either() == 3
    assert work.spread([-1, -2, -3]).map(abs) == [1, 2, 3]
    assert work.spread([2, 3]).map(pow, 2) == [4, 9]


def test_an_error_there_is_raised_here(work: Scheduler) -> None:
    with pytest.raises((TypeError, RuntimeError), match="abs"):
        work.begin(abs, "word").result()


def test_a_call_that_nobody_has_begun_is_taken_back(work: Scheduler) -> None:
    if work.process is None:
        pytest.skip("there is nobody to have begun it")
    slow = [work.begin(sum, range(20_000_000)) for _ in range(2)]
    assert work.begin(abs, -1).result_of_either() == 1
    assert not slow[1].there.done()  # type: ignore[union-attr]


def test_stages_of_the_second_process_are_those_of_this_one(work: Scheduler) -> None:
    stages = SilentStages()
    with work.begun_in_stages(stages, staged, "survey B") as task:
        assert task.result() == "survey B"
    assert list(stages.seconds) == ["survey B"]


def test_a_background_call_ends_with_its_context() -> None:
    def forever(stop_if_left) -> None:
        while True:
            stop_if_left()

    with pytest.raises(ZeroDivisionError), in_background(forever):
        _ = 1 / 0


def test_what_is_named_can_be_loaded() -> None:
    named = [value for value in vars(rendered).values() if isinstance(value, Named)]
    assert len(named) > 5
    for one in named:
        module, _, function = one.name.partition(":")
        assert callable(getattr(import_module(module), function)), one.name


def staged(title: str, stages: Stages) -> str:
    with stages.stage(title) as advance:
        advance(0.5)
    return title
