"""Functions for a process beside to call: it imports them by name."""

import os
import time

from endoct.stitching.errors import EndoctError
from endoct.workbench.beside import Tell

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
