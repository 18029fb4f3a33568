"""What `endoct pose` found, and how ``pose.json`` says it."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.doubt import Doubt
from endoct.fusion.pose.finding import PoseAnswer
from endoct.fusion.pose.pose import BorePose, Estimate
from endoct.fusion.pose.summary import PoseSummary, radius_of
from endoct.fusion.pose.wall import EDGE, FIRST_STRETCH, FIRST_TWIST, RADIUS, RIMS, SCALE, TURN
from endoct.modalities.ct.ct_volume import in_world
from endoct.modalities.ct.stored import SIGNS, Convention
from endoct.modalities.ct.trajectory import Point, Trajectory
from endoct.workbench.pipeline.inputs import versions
from endoct.workbench.pipeline.volumes import VolumeFacts

FORMAT = "endoct-pose-1"
NOTICE = "Research software, not for clinical decisions."


@dataclass(frozen=True)
class Made:
    """How a result was made: ``inputs`` sha256 by path, versions, parameters, and seconds by stage."""

    inputs: Mapping[str, str]
    versions: Mapping[str, str]
    parameters: Mapping[str, Any]
    seconds: Mapping[str, float]


DECISIVE = ("torch", "kornia", "SimpleITK", "pydicom", "nibabel")
"""Libraries that figures of a pose depend on."""


def pose_versions() -> dict[str, str]:
    """Return the versions of endoct and of what a pose depends on."""
    return versions(*DECISIVE)


@dataclass(frozen=True, eq=False)
class PoseResult:
    """Where a bore lies in the patient's CT, or why that cannot be told.

    Attributes
    ----------
    answer: the pose, of all sides and of each alone.
    summary: the same in clinical words.
    coordinates: the convention, RAS or LPS, of every place in :meth:`to_json`.
    made: from what, with what and how fast.
    volumes: what was read of the CT ("ct") and of the segmentation ("labels"), with notes and doubts.
    """

    answer: PoseAnswer
    summary: PoseSummary
    coordinates: Convention
    made: Made
    volumes: Mapping[str, VolumeFacts]

    @property
    def told(self) -> bool:
        """Whether it can be told where the bore lies."""
        return self.answer.reason is None

    @property
    def pose(self) -> BorePose | None:
        """Where the bore lies; None where that cannot be told."""
        return self.answer.pose if self.told else None

    @property
    def doubts(self) -> tuple[Doubt, ...]:
        """All that is doubted: of the pose, the gravest first, then of the volumes."""
        return (*self.answer.doubts, *(doubt for facts in self.volumes.values() for doubt in facts.doubts))

    @property
    def axis(self) -> Trajectory:
        """The bore's axis, from the depth of the plan's entry to that of its target."""
        return axis_of(self.answer.pose)

    @property
    def deepest(self) -> tuple[str, Estimate]:
        """The side that saw the bore deepest, and the depth of its deepest row, mm from the planned entry."""
        deepest = {name: max(ends, key=lambda end: end.value) for name, ends in self.summary.ends_mm.items()}
        return max(deepest.items(), key=lambda item: item[1].value)

    def place(self, depth_mm: float) -> Point:
        """Return the point of the bore's axis at a depth from the planned entry, mm in ``coordinates``."""
        return in_world(_point(self.answer.pose.axis_lps(np.array([depth_mm]))[0].tolist()), self.coordinates)

    def __repr__(self) -> str:
        target = self.summary.at_target.distance_mm
        said = f"{target.value:.2f} mm off its plan at the target" if self.told else f"not told: {self.answer.reason}"
        return f"<PoseResult of {' and '.join(self.answer.pose.names)}: {said}>"

    def to_json(self) -> dict[str, Any]:
        """Return what ``pose.json`` says: objects, lists, texts and numbers only."""
        plan, pose = self.answer.pose.plan, self._pose()
        return {
            "format": FORMAT,
            "notice": NOTICE,
            "told": self.told,
            "reason": self.answer.reason,
            "doubts": [doubt.what for doubt in self.doubts],
            "doubt_codes": [doubt.code for doubt in self.doubts],
            "volumes": {name: facts.to_json() for name, facts in self.volumes.items()},
            "sides": list(self.answer.pose.names),
            "coordinates": self.coordinates,
            "plan": plan_json(plan, self.coordinates),
            "pose": pose if self.told else None,
            "best_unbelieved": None if self.told else pose,
            "alone": {one.names[0]: self._alone(one) for one in self.answer.alone},
            "difference": None if self.summary.difference is None else asdict(self.summary.difference),
            "inputs": dict(self.made.inputs),
            "versions": dict(self.made.versions),
            "parameters": dict(self.made.parameters),
            "seconds": dict(self.made.seconds),
        }

    def _pose(self) -> dict[str, Any]:
        pose, summary = self.answer.pose, self.summary
        return {
            "bore_to_world": in_convention(pose.bore_to_lps, self.coordinates).tolist(),
            "entry_mm": list(in_world(self.axis.entry_mm, self.coordinates)),
            "target_mm": list(in_world(self.axis.target_mm, self.coordinates)),
            "radius_mm": radius_of(pose),
            "at_entry": asdict(summary.at_entry),
            "at_target": asdict(summary.at_target),
            "beyond_target": asdict(summary.beyond),
            "facial_recess": None if summary.recess is None else asdict(summary.recess),
            "angle_deg": asdict(summary.angle_deg),
            "ellipse_beyond_mm": summary.ellipse_mm,
            "longest_bare_mm": {**asdict(summary.bare), "length_mm": summary.bare.length_mm},
            "structures": [asdict(one) for one in summary.clearances],
            "by_side": {name: self._side(number, name) for number, name in enumerate(pose.names)},
        }

    def _side(self, number: int, name: str) -> dict[str, Any]:
        fit = self.answer.pose.fit
        side, sense, own = fit.sides[number], fit.senses[number], fit.of_side(number)
        first, last = self.summary.ends_mm[name]
        standing = self.answer.standing
        return {
            "agreement": fit.agreement[number],
            "standing": standing[number] if standing else None,
            "mirrored": sense.turning < 0,
            "z_reversed": sense.inward < 0,
            "first_row": self._row(float(side.z_mm[0]), first),
            "last_row": self._row(float(side.z_mm[-1]), last),
            "turn_rad": float(own[TURN] % (2 * np.pi)),
            "roll_deg": asdict(self.summary.roll_deg[name]),
            "z_scale": float(1 + own[SCALE]),
            "radius_change_mm": float(own[RADIUS]),
            "edge_mm": float(own[EDGE]),
            "rims_mm": float(own[RIMS]),
            "twist_rad": own[FIRST_TWIST:FIRST_STRETCH].tolist(),
            "stretch_mm": own[FIRST_STRETCH:].tolist(),
        }

    def _row(self, z_mm: float, depth: Estimate) -> dict[str, Any]:
        return {"z_mm": z_mm, "depth_mm": asdict(depth), "axis_mm": list(self.place(depth.value))}

    def _alone(self, pose: BorePose) -> dict[str, Any]:
        axis = axis_of(pose)
        return {
            "entry_mm": list(in_world(axis.entry_mm, self.coordinates)),
            "target_mm": list(in_world(axis.target_mm, self.coordinates)),
            "agreement": pose.fit.agreement[0],
        }


def plan_json(plan: Trajectory, coordinates: Convention) -> dict[str, Any]:
    """Return a plan as files say it."""
    return {
        "entry_mm": list(in_world(plan.entry_mm, coordinates)),
        "target_mm": list(in_world(plan.target_mm, coordinates)),
        "length_mm": plan.length_mm,
    }


def axis_of(pose: BorePose) -> Trajectory:
    """Return the axis of a bore from the depth of its plan's entry to that of its target."""
    entry, target = pose.axis_lps(np.array([0.0, pose.plan.length_mm])).tolist()
    return Trajectory(_point(entry), _point(target))


def in_convention(to_lps: Coordinates, coordinates: Convention) -> Coordinates:
    """Return a transform (4, 4) to LPS as one to ``coordinates``."""
    return np.asarray(np.diag([*SIGNS[coordinates], 1.0]) @ to_lps)


def estimate_text(value: Estimate, digits: int = 2) -> str:
    """Return "0.31 (0.22 to 0.40)"."""
    return f"{value.value:.{digits}f} ({value.low:.{digits}f} to {value.high:.{digits}f})".replace("-", "−")


def place_text(place: Point) -> str:
    """Return "12.5, −40.0, 7.1"."""
    return ", ".join(f"{value:.1f}" for value in place).replace("-", "−")


def _point(values: list[float]) -> Point:
    x, y, z = values
    return x, y, z
