"""At which scale along the bore one side would fit the other, far beyond what an alignment searches.

A pitch that a sidecar states wrongly stretches a recording by more than instruments differ. A search over every scale
from the outset would give chance more to choose from; so scales farther off are only looked at where the usual search
fails, or ends at its limit.
"""

from endoct.fusion.evidence.evidence import Evidence
from endoct.fusion.geometry.alignment import Alignment, Orientation
from endoct.fusion.registration.refinement import refine
from endoct.fusion.registration.search import search

FARTHEST = 0.5, 2.0
"""Scales looked at: a pitch stated at half of what it is, or at twice that."""


def stretched(
    a: Evidence, b: Evidence, orientations: tuple[Orientation, ...], searched: tuple[float, float]
) -> Alignment | None:
    """Return where ``b`` lies on ``a`` best at a scale from ``FARTHEST`` that is not within ``searched``, refined.

    None where it fits best within, or nowhere.
    """
    farthest = min(FARTHEST[0], searched[0]), max(FARTHEST[1], searched[1])
    best = search(a, b, orientations, farthest)
    if best is None:
        return None
    refined = refine(a, b, best, farthest)
    return None if searched[0] < refined.z_scale < searched[1] else refined
