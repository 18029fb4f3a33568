"""Functions for a worker process to call: it imports them by name."""

import os
import time

import numpy as np

from endoct.base.compute.worker_process import Send
from endoct.base.errors import EndoctError

LONG_S = 600


def count_to(send: Send, last: int) -> int:
    for k in range(last):
        send(k)
    print("what is printed is no answer")
    return last


def refuse(subject: str) -> None:
    raise EndoctError(subject, found="nothing", expected="something", remedy="look again")


def divide(a: float, b: float) -> float:
    return a / b


def identity_of(value: object) -> int:
    return id(value)


def end() -> None:
    os._exit(3)


def sleep(send: Send) -> None:
    send(os.getpid())
    time.sleep(LONG_S)


class OddError(OSError):
    def __init__(self, first: int, two: int, three: int) -> None:
        super().__init__(f"{first} {two} {three}")


def run_out_of_memory() -> None:
    np.empty(2**57)


def nest() -> None:
    nest()


def odd() -> None:
    raise OddError(1, 2, 3)


def give_what_cannot_be_sent() -> object:
    return lambda: None
