"""How the simulator says how far it is."""

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Called with the title of a stage and the share of it that is done."""
