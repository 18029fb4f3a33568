"""Memory that is free again, given back to the system.

The C library keeps what threads have freed, in a heap of each thread, for their later requests. Between the steps of a
long recording that was up to 150 MB which nobody used any more.
"""

import ctypes
import sys


def give_back() -> None:
    """Give memory that is free back to the system, where the C library can: that of Linux, glibc."""
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(0)
