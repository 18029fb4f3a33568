"""Whether this process compiles much, for whoever displays its progress.

Apart from :mod:`endoct.base.compute.compiled`, since numba takes half a second to load.
"""

from collections.abc import Callable

SAID_AFTER = 5
"""So many functions are compiled before a user is told: one or two are no wait, and after five there are many more."""


class _Compiling:
    """How many functions this process compiled, and what is called when they become many."""

    count = 0
    announce: Callable[[], None] | None = None


def when_compiling(announce: Callable[[], None]) -> None:
    """Have ``announce`` called, once, when this process compiles so much that a user will notice."""
    _Compiling.announce = announce


def announce_compiling() -> None:
    """Call what :func:`when_compiling` was given, if nobody did yet."""
    announce, _Compiling.announce = _Compiling.announce, None
    if announce is not None:
        announce()


def count_compiled() -> None:
    """Count one more function that was compiled."""
    _Compiling.count += 1
    if _Compiling.count == SAID_AFTER:
        announce_compiling()
