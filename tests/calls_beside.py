"""Functions for a process beside to call: it imports them by name."""

import os
import time

import numpy as np

from endoct.stitching.errors import EndoctError
from endoct.workbench.running.worker import Tell

LONG_S = 600


def count_to(tell: Tell, last: int) -> int:
    for k in range(last):
        tell(k)
    print("what is printed is no answer")
    return last


def refuse(tell: Tell, what: str) -> None:
    raise EndoctError(what, found="nothing", expected="something", remedy="look again")


def divide(tell: Tell, a: float, b: float) -> float:
    return a / b


def end(tell: Tell) -> None:
    os._exit(3)


def sleep(tell: Tell) -> None:
    tell(os.getpid())
    time.sleep(LONG_S)


class OddError(OSError):
    def __init__(self, one: int, two: int, three: int) -> None:
        super().__init__(f"{one} {two} {three}")


def run_out_of_memory(tell: Tell) -> None:
    np.empty(2**57)


def nest(tell: Tell) -> None:
    nest(tell)


def odd(tell: Tell) -> None:
    raise OddError(1, 2, 3)


def give_what_cannot_be_sent(tell: Tell) -> object:
    return lambda: None
