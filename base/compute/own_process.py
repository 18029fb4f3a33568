"""How Python and its libraries are set in processes that are ours, not a caller's, and memory given back to the system.

The C library keeps what threads have freed, in a heap of each thread, for their later requests. Between the steps of a
long recording that was up to 150 MB which nobody used any more.
"""

import atexit
import ctypes
import gc
import os
import sys

OBJECTS = 50_000
"""Python looks for objects that refer to each other in circles only beyond this many. Its own 700 cost an eighth of
the imports, for next to nothing."""


def settle_in() -> None:
    """Set what makes this process, and those it starts, faster; to be called before libraries are loaded.

    One thread for linear algebra: the matrices here are small, and a library that is loaded later than
    ``one_blas_thread`` limits them would start more. Whoever sets ``OMP_NUM_THREADS`` keeps what was set.
    """
    gc.set_threshold(OBJECTS)
    atexit.register(gc.freeze)  # as Python ends it would look through all that libraries made: 0.6 s
    os.environ.setdefault("OMP_NUM_THREADS", "1")


def give_back() -> None:
    """Give memory that is free back to the system, where the C library can: that of Linux, glibc."""
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(0)
