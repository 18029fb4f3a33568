"""What is undone where a process has to end before its blocks are left: while a library computes, or a thread waits.

A block that is left in the ordinary way undoes its own work. Libraries do not leave theirs while they compile or draw,
so whoever makes something that must not stay says here how it goes.
"""

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

exchanging = threading.RLock()
"""Held while an output is put in its place, which nothing may come between."""
_EXCHANGE_S, _DYING_S = 0.5, 0.1
_undoing: dict[object, Callable[[], object]] = {}


@contextmanager
def undone_in_the_end(undo: Callable[[], object]) -> Iterator[None]:
    """Have :func:`undo_all` call ``undo`` as long as the block lasts."""
    key = object()
    _undoing[key] = undo
    try:
        yield
    finally:
        _undoing.pop(key, None)


def undo_all() -> None:
    """Undo what is under way in this process, the last first; only to be called by who ends it right afterwards.

    Processes that it has started are killed first. Where an output is being put in its place and does not get there
    in time, everything stays: the next run clears it away.
    """
    if (processes := sys.modules.get("multiprocessing")) is not None:
        children = processes.active_children()
        for process in children:
            process.kill()
        for process in children:
            process.join(_DYING_S)  # what they held is free then
    if not exchanging.acquire(timeout=_EXCHANGE_S):
        return
    for undo in reversed(list(_undoing.values())):
        with suppress(Exception):  # what was not begun, or is undone by its block just now
            undo()
