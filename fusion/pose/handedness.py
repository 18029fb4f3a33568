"""Whether the CT is a mirror image of what was recorded: settled by a side of which the sense of θ is known."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.doubt import Doubt
from endoct.fusion.pose.air import AirAround
from endoct.fusion.pose.observation import Observation
from endoct.fusion.pose.search import candidates_along, pattern_of, senses_of
from endoct.fusion.pose.wall import Sense

OPEN = "handedness-open"
"""The code of the doubt where no side settles it."""
SETTLED = 0.1
"""By how much one sense has to correlate better than the other."""


def favours_mirror(air: AirAround, side: Observation, axis: Coordinates) -> bool | None:
    """Return whether ``side``, its sense of θ known, fits the mirror image along ``axis`` (4,); None if it is open."""
    known = {sense.turning for sense in senses_of(side)}
    senses = senses_of(replace(side, handed=False))
    patterns = [pattern_of(side, sense, str(air.values.device)) for sense in senses]
    scores = [some[0].score for some in candidates_along(air, side, patterns, axis[np.newaxis])]
    right = max(score for score, sense in zip(scores, senses, strict=True) if sense.turning in known)
    wrong = max(score for score, sense in zip(scores, senses, strict=True) if sense.turning not in known)
    return wrong > right if abs(wrong - right) >= SETTLED else None


def mirror_reason(side: str) -> str:
    """Return why nothing is told where a side's mirror image fits."""
    return (
        f"the {side}, of which the sense of θ is known, fits the mirror image of the CT: the CT is mirrored, or "
        "it is of the other ear"
    )


def open_handedness(sides: Sequence[tuple[str, Sense]]) -> Doubt:
    """Return the doubt about a pose that rests on sides of unknown sense of θ, each with the sense that fits."""
    names = " and ".join(name for name, _ in sides)
    fits = ", ".join(f'"{"mirrored" if sense.turning < 0 else "same"}" for {name}' for name, sense in sides)
    return Doubt(
        OPEN,
        f"the sense of θ of {names} is not known: a mirrored CT, or one of the other ear, would fit as well, at a "
        f"place that is wrong. This pose holds only if handedness is {fits}: state it in the sidecar",
    )
