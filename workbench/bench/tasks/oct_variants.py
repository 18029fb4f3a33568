"""Our own unrolling of a pullback as methods of the task "oct": as it is, and with steps of the task "ablate" off."""

from collections.abc import Callable
from pathlib import Path

from endoct.stitching.panorama import Panorama
from endoct.workbench import api
from endoct.workbench.bench.tasks.ablate import STEPS


def _without(*steps: str) -> Callable[[Path], Panorama]:
    """Return the method that unrolls as `endoct unroll` does, with ``steps`` off."""
    settings = {name: value for step in steps for name, value in STEPS[step].oct.items()}

    def method(recording: Path) -> Panorama:
        return api.unroll(recording, settings=settings)

    return method


ours = _without()
without_rotation = _without("no-rotation")
without_turn_length = _without("no-turn-length")
without_start_angle = _without("no-start-angle")
without_lost_ascans = _without("no-lost-ascans")
even = _without("no-turning")
sine = _without("no-circle")
# Laves 2019, with our wall, and as published: the brightest sample for the wall
sine_even = _without("no-turning", "no-circle")
literal = _without("literal")
brightest = _without("no-turning", "no-edge")
