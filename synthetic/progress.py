"""How the simulator reports its progress."""

from collections.abc import Callable

Advance = Callable[[float], None]
"""Called with the share of a stage that is done, 0 to 1."""

Progress = Callable[[str, float], None]
"""Called with the title of a stage and the share of it that is done."""
