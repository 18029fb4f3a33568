"""The pose of a bore from one recording or two: searched for, fitted, and told from chance."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from endoct.fusion.pose.air import AirAround
from endoct.fusion.pose.fit import Fit, fit_pose, start_of
from endoct.fusion.pose.observation import Observation
from endoct.fusion.pose.search import best_candidates, pattern_of, senses_of
from endoct.fusion.pose.wall import SHARED

STARTS = 3
"""Of the best candidates of the search that a fit begins at."""


@dataclass(frozen=True, eq=False)
class Found:
    """The best pose of one side, and how far it stands out."""

    fit: Fit


def find_alone(air: AirAround, side: Observation) -> Found:
    """Return the pose that ``side`` alone has in ``air``."""
    device = str(air.values.device)
    patterns = [pattern_of(side, sense, device) for sense in senses_of(side)]
    by_sense = best_candidates(air, side, patterns, STARTS)
    candidates = sorted((one for some in by_sense for one in some), key=lambda one: -one.score)[:STARTS]
    fits = [fit_pose(air, [side], [one.sense], start_of(one)) for one in candidates]
    return Found(max(fits, key=lambda fit: fit.agreement[0]))


def find_together(air: AirAround, found: Sequence[Found]) -> Fit:
    """Return the pose of sides that were found alone: one axis, each side's own depth and turn."""
    fits = [one.fit for one in found]
    weights = np.linalg.inv(np.stack([fit.covariance[:SHARED, :SHARED] for fit in fits]))
    axes = np.stack([fit.parameters[:SHARED] for fit in fits])
    axis = np.linalg.solve(weights.sum(axis=0), np.einsum("sij,sj->i", weights, axes))
    start = np.concatenate([axis, *(fit.of_side(0) for fit in fits)])
    sides, senses = [fit.sides[0] for fit in fits], [fit.senses[0] for fit in fits]
    return fit_pose(air, sides, senses, torch.as_tensor(start))
