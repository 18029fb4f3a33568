"""Signals that come while something must not be cut short wait for its end."""

import signal
import threading

from endoct.base.files.scratch import uninterrupted


def test_the_first_signal_comes_once_all_is_done_and_the_others_never() -> None:
    heard: list[str] = []
    numbers = signal.SIGINT, signal.SIGTERM
    before = [signal.signal(number, lambda number, _: heard.append(signal.Signals(number).name)) for number in numbers]
    try:
        with uninterrupted():
            for number in (signal.SIGTERM, signal.SIGINT, signal.SIGTERM):
                signal.raise_signal(number)
            assert not heard
        assert heard == ["SIGTERM"]
        with uninterrupted():
            pass
        signal.raise_signal(signal.SIGINT)
        assert heard == ["SIGTERM", "SIGINT"]
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


def test_in_another_thread_nothing_is_held_back() -> None:
    seen: list[object] = []

    def look() -> None:
        with uninterrupted():
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=look)
    thread.start()
    thread.join()
    assert seen == [signal.getsignal(signal.SIGINT)]
