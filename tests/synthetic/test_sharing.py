"""Work shared between threads and processes."""

from concurrent.futures import CancelledError, ThreadPoolExecutor

import pytest

from endoct.stitching.errors import EndoctError
from endoct.synthetic.frame_process import frame_from, frame_processes
from endoct.synthetic.sharing import Shared


def test_every_job_is_done_once_and_results_come_in_order() -> None:
    shared = Shared[int](200)
    done: list[int] = []

    def square(index: int) -> int:
        done.append(index)
        return index**2

    with ThreadPoolExecutor(3) as pool:
        for _ in range(3):
            pool.submit(shared.serve, square)
        assert list(shared.results()) == [index**2 for index in range(200)]
    assert sorted(done) == list(range(200))


def test_who_takes_results_is_told_of_a_failure() -> None:
    shared = Shared[int](3)
    shared.serve(lambda index: 1 // (1 - index))
    results = shared.results()
    assert next(results) == 1
    with pytest.raises(ZeroDivisionError):
        next(results)


def test_after_a_stop_nobody_begins_or_waits() -> None:
    shared = Shared[int](2)
    shared.stop()
    shared.serve(lambda index: pytest.fail(f"job {index} was begun"))
    with pytest.raises(CancelledError):
        next(shared.results())


def test_a_process_that_died_is_told_of() -> None:
    with frame_processes(1) as (process,):
        process.kill()
        process.wait()
        with pytest.raises(EndoctError, match="has ended"):
            frame_from(process, 0)
    assert process.returncode is not None
