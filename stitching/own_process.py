"""How Python and its libraries are set in processes that are ours, not a caller's."""

import atexit
import gc
import os

OBJECTS = 50_000
"""More than there are until Python looks again for objects that refer to each other in circles. Its own 700 cost an
eighth of the imports, for next to nothing."""


def settle_in() -> None:
    """Set what makes this process, and those it starts, faster; to be called before libraries are loaded.

    One thread for linear algebra: the matrices here are small, and a library that is loaded later than
    ``one_blas_thread`` limits them would start more. Whoever sets ``OMP_NUM_THREADS`` keeps what was set.
    """
    gc.set_threshold(OBJECTS)
    atexit.register(gc.freeze)  # as Python ends it would look through all that libraries made: 0.6 s
    os.environ.setdefault("OMP_NUM_THREADS", "1")
