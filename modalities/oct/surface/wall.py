"""Where the bore wall lies in one B-scan."""

import numpy as np
from numpy.typing import NDArray

from endoct.modalities.oct.bscan import Spacing
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.surface.background import Background
from endoct.modalities.oct.surface.bore import BLOCK_MM, favour_bore, gap_rows
from endoct.modalities.oct.surface.evidence import surface_evidence
from endoct.modalities.oct.surface.largest import largest
from endoct.stitching.arrays import Coordinates, Image
from endoct.stitching.circle import largest_divisor
from endoct.stitching.compiled import compiled

Rows = NDArray[np.intp]

COLUMN_MM = 0.008  # a third of the beam's width: finer columns are taken together
STIFFER = 5.0


def brightest(image: Image, first_row: Rows) -> Rows:
    """Return the index of the maximum from ``first_row`` (n,) on of every A-scan of ``image`` (n, depth).

    Laves 2019, Extracting mastoid pattern, implemented literally.
    """
    beyond = np.arange(image.shape[1]) >= first_row[:, None]
    return np.asarray(np.argmax(np.where(beyond, image, -np.inf), axis=1))


def first_edge(
    image: Image, first_row: Rows, background: Background, spacing: Spacing, parameters: OctParameters
) -> Rows:
    """Return the row of the wall's surface in every A-scan of ``image`` (θ, depth); n_depth where there is none.

    A surface has darkness before it, from ``first_row`` (n_theta,) on, and bone behind it
    (:mod:`endoct.modalities.oct.surface.evidence`). Dynamic programming finds the closed path through θ with the most
    evidence; a change of depth costs evidence in proportion, but no more than ``jump_cost``, so that the rim of a cell
    can be a jump. A stiff path over blocks of columns comes first: it gives the bore's own wall, where a surface then
    is likelier (:mod:`endoct.modalities.oct.surface.bore`).
    """
    nearest = int(first_row.min())
    # columns are taken together from a place of the specimen's on, so that it does not matter where the turn starts
    start = int(np.argmax(image.sum(axis=1)))
    together = largest_divisor(image.shape[0], round(COLUMN_MM / spacing.column_mm))
    first = np.roll(first_row, -start).reshape(-1, together).max(axis=1) - nearest
    evidence = surface_evidence(image[:, nearest:], start, first, background.from_row(nearest), spacing, parameters)
    wide = Spacing(spacing.depth_mm, spacing.column_mm * together)
    slope_cost, jump_cost = parameters.slope_cost_per_mm * spacing.depth_mm, parameters.jump_cost
    gap = _gap_of_bore(evidence, first, wide, (STIFFER * slope_cost, STIFFER * jump_cost))
    if np.isfinite(gap).all():
        favour_bore(evidence, first + gap, wide)
    return np.roll(nearest + np.repeat(_best_path(evidence, slope_cost, jump_cost), together), start)


def _gap_of_bore(evidence: Image, first: Rows, spacing: Spacing, costs: tuple[float, float]) -> Coordinates:
    """The rows from ``first`` (n,) to the bore's wall, by a stiff path over blocks of columns, float64 (n,)."""
    block = largest_divisor(first.size, round(BLOCK_MM / spacing.column_mm))
    blocks = evidence.reshape(-1, block, evidence.shape[1]).sum(axis=1)
    from_row = first.reshape(-1, block).mean(axis=1).round().astype(np.intp)
    gap = gap_rows(_best_path(blocks, *costs), from_row, blocks, spacing.depth_mm)
    middle = (np.arange(gap.size) + 0.5) * block - 0.5
    return np.interp(np.arange(first.size), middle, gap, period=first.size)


def _best_path(evidence: Image, slope_cost: float, jump_cost: float) -> Rows:
    """The closed path of states (columns of ``evidence``) over all rows that gathers the most evidence.

    One turn is extended at both ends by a quarter, so that where the path starts and ends does not matter.
    """
    n_states = evidence.shape[1]
    ramp = (slope_cost * np.arange(n_states)).astype(np.float32)
    near = int(min(jump_cost / slope_cost, n_states)) + 1 if slope_cost else n_states  # farther off, a jump costs less
    cost = np.minimum(np.arange(near + 1) * np.float32(slope_cost), np.float32(jump_cost), dtype=np.float32)
    return _followed(evidence, ramp, cost, np.float32(jump_cost))


@compiled
def _followed(evidence: Image, ramp: Image, cost: Image, jump_cost: np.float32) -> Rows:
    """The path; ``ramp`` is what a change by so many rows costs, and ``cost`` the same where it is less than a jump."""
    n_theta, n_states = evidence.shape
    lead = n_theta // 4
    n_steps = n_theta + 2 * lead
    gathered = np.empty((n_steps, n_states), np.float32)
    falling, rising = np.empty(n_states, np.float32), np.empty(n_states, np.float32)
    most = np.float32(0)  # what the step before gathered; all but the first then have theirs taken off
    for step in range(n_steps):
        here, best = evidence[(step - lead) % n_theta], gathered[step]
        if step == 0:
            best[:] = here
        else:
            before = gathered[step - 1]
            from_behind, from_before = before[n_states - 1] - ramp[n_states - 1], before[0]
            for state in range(n_states):  # both ways at once: neither has to wait for the other
                back = n_states - 1 - state
                from_behind = max(from_behind, before[back] - ramp[back])
                from_before = max(from_before, before[state] + ramp[state])
                falling[back], rising[state] = from_behind, from_before
            jump = most - jump_cost
            for state in range(n_states):
                near_by = max(rising[state] - ramp[state], falling[state] + ramp[state])
                best[state] = max(near_by, jump) + here[state]
        most = largest(best)
        if step:
            best -= most
            most = np.float32(0)
    path = np.empty(n_steps, np.intp)
    near = cost.size - 1
    state = int(np.argmax(gathered[-1]))
    path[-1] = state
    for step in range(n_steps - 2, -1, -1):
        reached = np.float32(-np.inf)
        nearest = state
        for other in range(max(state - near, 0), min(state + near + 1, n_states)):
            value = gathered[step, other] - cost[abs(other - state)]
            if value > reached:
                reached, nearest = value, other
        most = np.float32(0) if step else largest(gathered[0])
        state = nearest if reached >= most - jump_cost else int(np.argmax(gathered[step]))
        path[step] = state
    return path[lead : lead + n_theta]
