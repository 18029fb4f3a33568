"""Where rivals of the task "pose" begin: everywhere around the plan, ranked by what each of them minimises.

A start is given in the plan's bore frame, as endoct's own search has it. Of the bore's axis it holds x and y at
the middle of the plan, mm, and the tilt about x and y, rad. The depth of the side's middle row, mm, and its turn, rad,
follow.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from endoct.base.arrays import Coordinates, Image
from endoct.fusion.evidence.side import Side
from endoct.fusion.pose.air import AirAround
from endoct.fusion.pose.observation import Observation, observe
from endoct.fusion.pose.wall import Sense
from endoct.modalities.ct.trajectory import Trajectory
from endoct.stitching.panorama import Panorama
from endoct.workbench.bench.tasks.pose import LocatedSide

ASIDE_MM, ASIDE_STEP_MM = 1.5, 0.5
TILTS_RAD = tuple(float(np.radians(tilt)) for tilt in (-1.2, 0.0, 1.2))
DEPTH_MM, DEPTH_STEP_MM = 2.0, 0.3
"""A side may reach this far beyond the plan; starts are this far apart along it."""
TURNS = 36
APART_MM, APART_RAD = 0.6, 0.25
AT_A_TIME = 400_000
"""Places that are looked up at one go."""
RANKED_BY, FIRST_BY, KEPT = 240, 60, 3000
"""Samples that starts are ranked by, those that all of them are ranked by first, and the starts kept of that."""

Score = Callable[[Coordinates, Coordinates], Image]
"""Places (n, m, 3) of samples at n starts, turned by one rotation (3, 3), to how well they fit, (n,)."""


@dataclass(frozen=True, eq=False)
class Matching:
    """How a side is matched with a CT.

    ``samples``: what starts are ranked by in one sense, in the side's own frame, (m, 3), and how. ``refine``: a sense,
    a transform (4, 4) and a scale along z to how well it fits near there, and the transform there.
    """

    samples: Callable[[Sense], tuple[Coordinates, Callable[[slice], Score]]]
    refine: Callable[[Sense, Coordinates, float], tuple[float, Coordinates]]


def observed(panorama: Panorama) -> Observation:
    """Return what a panorama shows of air, as endoct's own method prepares it."""
    return observe(Side(panorama.modality, panorama))


def transform_of(start: Coordinates, length_mm: float) -> Coordinates:
    """Return the transform (4, 4) of a side's own frame, 0 at its middle row, to the plan's bore frame."""
    x, y, about_x, about_y, depth_mm, turn_rad = start
    tilt = Rotation.from_rotvec([about_x, about_y, 0.0]).as_matrix()
    transform = np.eye(4)
    transform[:3, :3] = tilt @ Rotation.from_rotvec([0.0, 0.0, turn_rad]).as_matrix()
    transform[:3, 3] = np.array([x, y, length_mm / 2]) + (depth_mm - length_mm / 2) * tilt[:, 2]
    return transform


def ranked_starts(
    side: Observation, air: AirAround, samples: Coordinates, score_of: Callable[[slice], Score], most: int
) -> Coordinates:
    """Return the starts (n, 6) that score best and lie apart, best first, ``most`` at most.

    ``samples`` (m, 3) of the side in its own frame; ``score_of`` some of them.
    """
    few, every = slice(None, None, max(1, len(samples) // FIRST_BY)), slice(None)
    spare = max(0.0, air.length_mm - side.length_mm) / 2 + DEPTH_MM
    depths = air.length_mm / 2 + np.arange(-spare, spare + DEPTH_STEP_MM / 2, DEPTH_STEP_MM)
    tilts = [(x, y) for x in TILTS_RAD for y in TILTS_RAD]
    turns = 2 * np.pi / TURNS * np.arange(TURNS)
    first = np.stack(
        [_scores(samples[few], score_of(few), tilt, turn, depths, air) for tilt, turn in product(tilts, turns)]
    )
    line = np.sort(first, axis=None)[-min(KEPT, first.size)]
    starts, scores = [], []
    for (tilt, turn), of_first in zip(product(tilts, turns), first, strict=True):
        kept = np.flatnonzero(of_first >= line)
        if kept.size:
            starts.append(_all_starts(tilt, turn, depths)[kept])
            scores.append(_scores(samples, score_of(every), tilt, turn, depths, air, kept))
    order = np.argsort(-np.concatenate(scores), kind="stable")
    return _apart(iter(np.concatenate(starts)[order]), most)


def located(
    side: Observation, sense: Sense, panorama: Panorama, transform: Coordinates, plan: Trajectory, scale: float = 1.0
) -> LocatedSide:
    """Return where a panorama lies whose own frame, stretched along z by ``scale``, has this ``transform``."""
    to_lps = plan.to_lps @ transform
    along = sense.inward * scale * (panorama.z_mm[[0, -1]] - side.middle_mm)
    return LocatedSide(to_lps[:3, 3] + along[:, np.newaxis] * to_lps[:3, 2], to_lps[:3, 0])


def _all_starts(tilt: tuple[float, float], turn_rad: float, depths: Coordinates) -> Coordinates:
    """Return the starts of one tilt and turn, (n, 6)."""
    line = np.arange(-ASIDE_MM, ASIDE_MM + ASIDE_STEP_MM / 2, ASIDE_STEP_MM)
    return np.array(
        [(x, y, *tilt, depth, turn_rad) for x in line for y in line if np.hypot(x, y) <= ASIDE_MM for depth in depths]
    )


def _scores(
    samples: Coordinates,
    score: Score,
    tilt: tuple[float, float],
    turn_rad: float,
    depths: Coordinates,
    air: AirAround,
    kept: NDArray[np.intp] | None = None,
) -> Image:
    """Return how well the starts of one tilt and turn fit, or of them those ``kept``."""
    starts = _all_starts(tilt, turn_rad, depths)
    starts = starts if kept is None else starts[kept]
    turn = transform_of(starts[0], air.length_mm)[:3, :3]
    inward = turn[:, 2]
    pivots = np.column_stack([starts[:, :2], np.full(len(starts), air.length_mm / 2)])
    shifts = pivots + (starts[:, 4] - air.length_mm / 2)[:, np.newaxis] * inward
    blocks = np.array_split(shifts, max(1, len(shifts) * len(samples) // AT_A_TIME))
    return np.concatenate([score((samples @ turn.T) + some[:, np.newaxis], turn) for some in blocks])


def _apart(starts: Iterator[Coordinates], most: int) -> Coordinates:
    def differ(first: Coordinates, other: Coordinates) -> bool:
        apart_mm = np.abs(first - other)[[0, 1, 4]].max()
        turn = abs((first[5] - other[5] + np.pi) % (2 * np.pi) - np.pi)
        return bool(apart_mm > APART_MM or turn > APART_RAD)

    chosen: list[Coordinates] = []
    for start in starts:
        if all(differ(start, other) for other in chosen):
            chosen.append(start)
        if len(chosen) == most:
            break
    return np.array(chosen)
