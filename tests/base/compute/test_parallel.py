"""Work for several threads: in order, each job once, and nothing left behind."""

import threading
from concurrent.futures import CancelledError, ThreadPoolExecutor

import pytest

from endoct.base.compute.parallel import Jobs, at_once, thread_map
from endoct.base.errors import EndoctError


@pytest.mark.parametrize("workers", [1, 2, 7, None])
def test_mapping_keeps_the_order(workers: int | None) -> None:
    assert list(thread_map(lambda value: value**2, range(40), workers)) == [k**2 for k in range(40)]


def test_mapping_holds_few_items() -> None:
    held, most, lock = 0, 0, threading.Lock()

    class Counted:
        def __len__(self) -> int:
            return 50

        def __getitem__(self, index: int) -> int:
            nonlocal held, most
            if index >= 50:
                raise IndexError(index)
            with lock:
                held += 1
                most = max(most, held)
            return index

    for _ in thread_map(lambda index: index, Counted(), workers=3):
        with lock:
            held -= 1
    assert most <= 3 + 2  # the workers', one waiting, and the one just handed over


def test_an_error_comes_through_and_stops_the_work() -> None:
    begun: list[int] = []

    def work(index: int) -> int:
        begun.append(index)
        if index == 3:
            raise EndoctError("frame 3 is broken")
        return index

    with pytest.raises(EndoctError, match="frame 3 is broken"):
        list(thread_map(work, range(1000), workers=2))
    assert len(begun) < 20


def test_who_stops_early_leaves_no_thread_behind() -> None:
    before = threading.active_count()
    mapped = thread_map(lambda value: value, range(1000), workers=4)
    assert next(mapped) == 0
    mapped.close()
    assert threading.active_count() == before


def test_every_job_is_done_once_and_results_come_in_order() -> None:
    jobs = Jobs[int](200)
    done: list[int] = []

    def square(index: int) -> int:
        done.append(index)
        return index**2

    with ThreadPoolExecutor(3) as pool:
        for _ in range(3):
            pool.submit(jobs.work, square)
        assert list(jobs.results()) == [index**2 for index in range(200)]
    assert sorted(done) == list(range(200))
    assert jobs.share_taken() == 1


def test_a_failure_is_raised_where_results_are_taken() -> None:
    jobs = Jobs[int](3)
    jobs.work(lambda index: 1 // (1 - index))
    results = jobs.results()
    assert next(results) == 1
    with pytest.raises(ZeroDivisionError):
        next(results)


def test_after_a_cancel_no_job_begins_and_nobody_waits() -> None:
    jobs = Jobs[int](2)
    jobs.cancel()
    jobs.work(lambda index: pytest.fail(f"job {index} was begun"))
    with pytest.raises(CancelledError):
        next(jobs.results())


def test_two_functions_at_once_return_in_order() -> None:
    met = threading.Barrier(2, timeout=30)  # neither ends without the other
    assert at_once(lambda: (met.wait(), "one")[1], lambda: (met.wait(), 2)[1]) == ("one", 2)


def test_what_either_of_two_functions_raises_is_raised() -> None:
    with pytest.raises(ZeroDivisionError):
        at_once(lambda: 1, lambda: 1 // 0)
    with pytest.raises(KeyError):
        at_once(lambda: {}["one"], lambda: 1 // 0)
