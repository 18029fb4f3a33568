"""Our own unrolling of a pullback as methods of the task "oct": as it is, and with the steps of "ablate" off."""

from pathlib import Path

from endoct.stitching.panorama import Panorama
from endoct.workbench.api import unroll
from endoct.workbench.bench.tasks.ablate import STEPS


def ours(recording: Path) -> Panorama:
    """Unroll as `endoct unroll` does."""
    return unroll(recording)


def without_rotation(recording: Path) -> Panorama:
    """The same, without the smooth error within turns."""
    return unroll(recording, settings=STEPS["no-rotation"].oct)


def without_turn_length(recording: Path) -> Panorama:
    """The same, turns taken for one length."""
    return unroll(recording, settings=STEPS["no-turn-length"].oct)


def without_start_angle(recording: Path) -> Panorama:
    """The same, turns taken to start at one angle."""
    return unroll(recording, settings=STEPS["no-start-angle"].oct)


def without_lost_ascans(recording: Path) -> Panorama:
    """The same, no A-scan taken for lost."""
    return unroll(recording, settings=STEPS["no-lost-ascans"].oct)


def even(recording: Path) -> Panorama:
    """The catheter off its axis, turns taken for even."""
    return unroll(recording, settings=STEPS["no-turning"].oct)


def sine(recording: Path) -> Panorama:
    """The sine in place of the circle off the axis, rotation corrected."""
    return unroll(recording, settings=STEPS["no-circle"].oct)


def sine_even(recording: Path) -> Panorama:
    """The sine, turns taken for even (Laves 2019), with our wall."""
    return unroll(recording, settings={**STEPS["no-turning"].oct, **STEPS["no-circle"].oct})


def literal(recording: Path) -> Panorama:
    """The sine and the brightest sample for the wall (Laves 2019)."""
    return unroll(recording, settings=STEPS["literal"].oct)


def brightest(recording: Path) -> Panorama:
    """Our geometry with the brightest sample for the wall."""
    return unroll(recording, settings={**STEPS["no-turning"].oct, **STEPS["no-edge"].oct})
