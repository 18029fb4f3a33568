"""How often Python looks for objects that refer to each other in circles."""

import gc

OBJECTS = 50_000
"""More than there are until it looks again. Python's own 700 cost an eighth of the imports, for next to nothing."""


def collect_rarely() -> None:
    """Have a process that is ours, not a caller's, look for circles of objects rarely."""
    gc.set_threshold(OBJECTS)
