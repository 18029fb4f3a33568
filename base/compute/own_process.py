"""A process that is ours, not a caller's: its settings, whether it compiles much, and what it undoes at its end.

Loading it takes no time, so that a command can call it first. That is also why compiled functions are counted here:
:mod:`endoct.base.compute.compiled` loads numba, which takes half a second.
"""

import atexit
import ctypes
import gc
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

GARBAGE_THRESHOLD = 50_000
"""Number of new objects after which Python looks for circular garbage. Its own 700 cost an eighth of the time of
imports, for next to nothing."""
SAID_AFTER = 5
"""A user hears of compiling from this many functions on: one or two are no wait, and after five many more follow."""
exchanging = threading.RLock()
"""Held while an output is put in its place, which nothing may come between."""
_MMAP_THRESHOLD, _TRIM_THRESHOLD, _ARENA_MAX = -3, -1, -8
"""What glibc's malloc.h calls M_MMAP_THRESHOLD, M_TRIM_THRESHOLD and M_ARENA_MAX."""
_LARGEST_KEPT, _MOST_KEPT = 32 << 20, 128 << 20
"""Bytes of the largest array whose memory is kept, and how much is kept at the top of each heap."""
_EXCHANGE_S, _DYING_S = 0.5, 0.1
"""How long :func:`undo_all` waits for an output that is being put in its place, and for each process that it kills."""
_undoing: dict[object, Callable[[], object]] = {}


def settle_in() -> None:
    """Set what makes this process, and those it starts, faster. Call it before libraries are loaded.

    Linear algebra gets one thread, as the matrices here are small. It is set in the environment, for libraries that are
    loaded only after threads were limited. ``OMP_NUM_THREADS`` stays as it is where somebody has set it.

    Memory that arrays have given back is kept for the next ones, where the C library can, as glibc on Linux does. To
    take it from the system and clear it anew took a tenth of the time of a comparison.
    """
    if sys.platform == "linux" and (mallopt := getattr(ctypes.CDLL(None), "mallopt", None)) is not None:
        mallopt(_MMAP_THRESHOLD, _LARGEST_KEPT)
        mallopt(_TRIM_THRESHOLD, _MOST_KEPT)
        mallopt(_ARENA_MAX, 1)  # what a thread gives back serves the others, too
    gc.set_threshold(GARBAGE_THRESHOLD)
    atexit.register(gc.freeze)  # or Python looks at its end through all that libraries made: 0.6 s
    os.environ.setdefault("OMP_NUM_THREADS", "1")


class _Compiling:
    """Counts the functions that this process has compiled, and announces when there are many."""

    count = 0
    announce: Callable[[], None] | None = None


def when_compiling(announce: Callable[[], None]) -> None:
    """Have ``announce`` called once, when this process compiles so much that a user notices."""
    _Compiling.announce = announce


def announce_compiling() -> None:
    """Call what :func:`when_compiling` was given, unless that has been done."""
    announce, _Compiling.announce = _Compiling.announce, None
    if announce is not None:
        announce()


def count_compiled() -> None:
    """Count one more function that was compiled."""
    _Compiling.count += 1
    if _Compiling.count == SAID_AFTER:
        announce_compiling()


@contextmanager
def undone_in_the_end(undo: Callable[[], object]) -> Iterator[None]:
    """Have :func:`undo_all` call ``undo`` as long as the block lasts.

    A block that is left in the ordinary way undoes its own work. But libraries do not leave theirs while they compile
    or draw, and a waiting thread does not either. Whoever makes something that must not stay says here how it goes.
    """
    key = object()
    _undoing[key] = undo
    try:
        yield
    finally:
        _undoing.pop(key, None)


def undo_all() -> None:
    """Undo what is under way in this process, the last first. Only for a caller that ends the process right afterwards.

    Processes that it has started are killed first. Where an output is being put in its place and does not get there
    in time, everything stays, and the next run clears it away.
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
