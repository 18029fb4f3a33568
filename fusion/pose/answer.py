"""What is said of a bore's pose: where it lies, by all sides and by each alone, or why that cannot be told."""

from dataclasses import dataclass

from endoct.fusion.pose.pose import BorePose


@dataclass(frozen=True, eq=False)
class PoseAnswer:
    """The best ``pose`` there is, of all sides together, and of each ``alone``.

    ``reason``: why it cannot be told, in a full sentence; None where it is told. ``standing``: by side, how far its
    score lies above that of control patterns, in their spreads. ``doubts``, of a pose that is told, the gravest first:
    a sense of θ that is not known, long stretches without an edge, wide ellipses, a pattern that hardly stands out, and
    a side that could not tell the pose alone. The axis is by the other one then, and this one's depth and turn may be
    wrong.
    """

    pose: BorePose
    alone: tuple[BorePose, ...]
    reason: str | None
    standing: tuple[float, ...]
    doubts: tuple[str, ...] = ()
