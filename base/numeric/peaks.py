"""Where a peak lies between samples: the vertex of the parabola through the highest and its neighbours."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.compute.compiled import compiled


def vertex(before: Any, here: Any, after: Any) -> NDArray[Any]:
    """Return where parabolas through three even samples, numbers or arrays, have their top, in steps; 0 without one."""
    bend = np.asarray(before - 2 * here + after)
    return np.asarray(np.divide(0.5 * (before - after), bend, out=np.zeros_like(bend), where=bend < 0))


@compiled
def vertex_in_loops(before: float, here: float, after: float) -> float:
    """Return :func:`vertex` of numbers inside compiled loops."""
    bend = before - 2 * here + after
    return 0.5 * (before - after) / bend if bend < 0 else 0.0
