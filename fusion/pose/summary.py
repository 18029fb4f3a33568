"""All that is said of a pose in clinical words, for the file, the console and the page."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from endoct.fusion.pose.finding import PoseAnswer
from endoct.fusion.pose.pose import (
    BEYOND_MM,
    BorePose,
    Difference,
    Estimate,
    Offset,
    angle_of,
    difference,
    ends_of,
    offset_at,
    roll_of,
)
from endoct.fusion.pose.structures import Clearance, Structure, clearance, depth_of_passing
from endoct.fusion.pose.support import BareStretch, ellipse_mm, longest_bare_stretch

SEED = 1986


@dataclass(frozen=True)
class PoseSummary:
    """A pose against its plan.

    Attributes
    ----------
    at_entry, at_target: offset of the axis from the plan at the depths of the plan's entry and target.
    beyond: the same, 5 mm beyond the target.
    recess: the same where the bore passes the facial nerve; None where that is not labelled.
    angle_deg: the angle between the axis and the plan.
    ends_mm: by side, the depth along the bore of its first and its last row.
    roll_deg: by side, the angle of its θ = 0 about the axis, from x of the bore frame.
    bare: the longest observed stretch of the bore without an edge of a cell.
    ellipse_mm: half the long axis of the 95 % ellipse of the axis at ``beyond``.
    clearances: how far the bore stays from each labelled structure.
    difference: of the two sides' own axes; None for one side.
    """

    at_entry: Offset
    at_target: Offset
    beyond: Offset
    recess: Offset | None
    angle_deg: Estimate
    ends_mm: dict[str, tuple[Estimate, Estimate]]
    roll_deg: dict[str, Estimate]
    bare: BareStretch
    ellipse_mm: float
    clearances: tuple[Clearance, ...]
    difference: Difference | None


def summary_of(answer: PoseAnswer, structures: Sequence[Structure]) -> PoseSummary:
    """Return the pose by all sides in clinical words, with the ``structures`` near it."""
    pose, length = answer.pose, answer.pose.plan.length_mm
    nerve = next((one for one in structures if one.is_facial_nerve), None)
    radius = radius_of(pose)
    return PoseSummary(
        at_entry=offset_at(pose, 0.0),
        at_target=offset_at(pose, length),
        beyond=offset_at(pose, length + BEYOND_MM),
        recess=None if nerve is None else offset_at(pose, depth_of_passing(pose, nerve)),
        angle_deg=angle_of(pose),
        ends_mm={name: ends_of(pose, name) for name in pose.names},
        roll_deg={name: roll_of(pose, name) for name in pose.names},
        bare=longest_bare_stretch(pose),
        ellipse_mm=ellipse_mm(pose),
        clearances=tuple(clearance(pose, one, radius, np.random.default_rng([SEED, one.label])) for one in structures),
        difference=difference(*answer.alone) if len(answer.alone) == 2 else None,
    )


def radius_of(pose: BorePose) -> float:
    """Return the radius of the bore's envelope: the largest that a side's panorama states."""
    return max(side.radius_mm for side in pose.fit.sides)
