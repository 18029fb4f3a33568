"""How one would find a bore in a CT with existing libraries.

All get what ours is given, prepared as ours does it: air around the plan from the CT, and what a side shows of air.
Some hundred thousand places around the plan are ranked, at any turn, by what the method minimises. It begins at the
best of these, and its best result is taken. None of them can put two sides together, so of two they take the one with
depth.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.fusion.pose.air import AirAround, air_around
from endoct.fusion.pose.observation import Observation
from endoct.fusion.pose.search import senses_of
from endoct.fusion.pose.wall import Sense
from endoct.modalities.ct.ct_volume import CtVolume
from endoct.modalities.ct.trajectory import Trajectory
from endoct.stitching.panorama import Panorama
from endoct.workbench.bench.rivals.pose_points import open3d_matching, small_gicp_matching
from endoct.workbench.bench.rivals.pose_starts import (
    Matching,
    located,
    observed,
    ranked_starts,
    transform_of,
)
from endoct.workbench.bench.task import Declined
from endoct.workbench.bench.tasks.pose import Located, judged_side

STARTS = 8
SCALES = (0.985, 0.99, 0.995, 1.005, 1.01, 1.015)
"""These scales of z are tried at the best result: a drive's pitch is known to 1 % or so, and no method here fits
it."""

Library = Callable[[AirAround], Callable[[Observation, Panorama], Matching]]
"""The air in a CT to how a side is matched with it."""


def matched_by(library: Library) -> Callable[[tuple[Panorama, ...], CtVolume, Trajectory], Located]:
    """Return the method that matches a side with ``library``."""

    def method(sides: tuple[Panorama, ...], ct: CtVolume, plan: Trajectory) -> Located:
        air, number = air_around(ct, plan), judged_side(sides)
        side = observed(sides[number])
        best = _best(side, air, library(air)(side, sides[number]))
        place = located(side, best.sense, sides[number], best.transform, plan, best.scale)
        return Located(tuple(place if at == number else None for at in range(len(sides))))

    return method


@dataclass(frozen=True, eq=False)
class _Result:
    """How well a side fits, its sense, its transform (4, 4) to the plan's bore frame, and its scale along z."""

    score: float
    sense: Sense
    transform: Coordinates
    scale: float


def _best(side: Observation, air: AirAround, matching: Matching) -> _Result:
    def refined(sense: Sense, transform: Coordinates, scale: float) -> _Result:
        score, better = matching.refine(sense, transform, scale)
        return _Result(score if np.isfinite(better).all() else -np.inf, sense, better, scale)

    starts = [(sense, ranked_starts(side, air, *matching.samples(sense), STARTS)) for sense in senses_of(side)]
    results = [refined(sense, transform_of(one, air.length_mm), 1.0) for sense, some in starts for one in some]
    best = max(results, key=lambda result: result.score)
    best = max([best, *(refined(best.sense, best.transform, scale) for scale in SCALES)], key=lambda one: one.score)
    if not np.isfinite(best.score):
        raise Declined("no start came to a result")
    return best


# points of the wall, by small_gicp's point-to-plane ICP, and by Open3D's with Tukey's kernel
small_gicp, open3d = matched_by(small_gicp_matching), matched_by(open3d_matching)
