"""What `endoct pose` and its outlook say, and how ``pose.json`` and ``outlook.json`` say it."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from endoct.base.arrays import Coordinates, Image
from endoct.base.doubt import Doubt
from endoct.fusion.pose.finding import PoseAnswer
from endoct.fusion.pose.outlook import Outlook, Prospect
from endoct.fusion.pose.pose import BorePose, Estimate
from endoct.fusion.pose.summary import PoseSummary, radius_of
from endoct.fusion.pose.wall import EDGE, FIRST_STRETCH, FIRST_TWIST, RADIUS, RIMS, SCALE, TURN
from endoct.modalities.ct.ct_volume import in_world
from endoct.modalities.ct.stored import SIGNS, Convention
from endoct.modalities.ct.trajectory import Point, Trajectory, as_point
from endoct.workbench.pipeline.volumes import VolumeFacts
from endoct.workbench.running.outputs import versions

FORMAT, OUTLOOK_FORMAT = "endoct-pose-1", "endoct-pose-outlook-1"
NOTICE = "Research software, not for clinical decisions."
DECISIVE = ("torch", "kornia", "SimpleITK", "pydicom", "nibabel")
"""Libraries that figures of a pose depend on."""


@dataclass(frozen=True)
class Made:
    """How a result was made: ``inputs`` sha256 by path, versions, parameters, and seconds by stage."""

    inputs: Mapping[str, str]
    versions: Mapping[str, str]
    parameters: Mapping[str, Any]
    seconds: Mapping[str, float]

    def to_json(self) -> dict[str, Any]:
        """Return it as files say it."""
        return {name: dict(value) for name, value in vars(self).items()}


def pose_versions() -> dict[str, str]:
    """Return the versions of endoct and of what a pose depends on."""
    return versions(*DECISIVE)


@dataclass(frozen=True, eq=False)
class PoseResult:
    """Where a bore lies in the patient's CT, or why that cannot be told.

    Attributes
    ----------
    answer: The pose, of all sides and of each alone.
    summary: The same in clinical words.
    coordinates: The convention, RAS or LPS, of every place in :meth:`to_json`.
    made: From what, with what and how fast.
    volumes: What was read of the CT ("ct") and of the segmentation ("labels"), with notes and doubts.
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
        return in_world(as_point(self.answer.pose.axis_lps(np.array([depth_mm]))[0]), self.coordinates)

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
            "plan": {**ends_json(plan, self.coordinates), "length_mm": plan.length_mm},
            "pose": pose if self.told else None,
            "best_unbelieved": None if self.told else pose,
            "alone": {one.names[0]: self._alone(one) for one in self.answer.alone},
            "difference": None if self.summary.difference is None else asdict(self.summary.difference),
            **self.made.to_json(),
        }

    def _pose(self) -> dict[str, Any]:
        pose, summary = self.answer.pose, self.summary
        return {
            "bore_to_world": in_convention(pose.bore_to_lps, self.coordinates).tolist(),
            **ends_json(self.axis, self.coordinates),
            "radius_mm": radius_of(pose),
            "at_entry": asdict(summary.at_entry),
            "at_target": asdict(summary.at_target),
            "beyond_target": asdict(summary.beyond),
            "facial_recess": None if summary.recess is None else asdict(summary.recess),
            "angle_deg": asdict(summary.angle_deg),
            "ellipse_beyond_mm": summary.ellipse_mm,
            "longest_bare_mm": {**asdict(summary.bare), "length_mm": summary.bare.length_mm},
            "structures": [asdict(clearance) for clearance in summary.clearances],
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
        return {**ends_json(axis_of(pose), self.coordinates), "agreement": pose.fit.agreement[0]}


@dataclass(frozen=True, eq=False)
class OutlookResult:
    """How well a bore along a ``plan`` could be told in the patient's CT.

    Attributes
    ----------
    outlook: How rehearsals went, by kind of instrument, and what the CT has on the wall.
    plan: The trajectory, LPS.
    coordinates: The convention, RAS or LPS, of every place in :meth:`to_json`.
    wall: Share of air on the wall of a bore along the plan, (n_z, n_theta) float32, as the CT has it.
    made: From what, with what and how fast.
    volumes: What was read of the CT ("ct"), with notes and doubts.
    """

    outlook: Outlook
    plan: Trajectory
    coordinates: Convention
    wall: Image
    made: Made
    volumes: Mapping[str, VolumeFacts]

    @property
    def doubts(self) -> tuple[Doubt, ...]:
        """All that is doubted of the CT."""
        return tuple(doubt for facts in self.volumes.values() for doubt in facts.doubts)

    @property
    def tellable(self) -> bool:
        """Whether the bore could be told, well or poorly."""
        return self.outlook.level != "hardly"

    def __repr__(self) -> str:
        return f"<OutlookResult: {self.outlook.sentence}>"

    def to_json(self) -> dict[str, Any]:
        """Return what ``outlook.json`` says: objects, lists, texts and numbers only."""
        return {
            "format": OUTLOOK_FORMAT,
            "notice": NOTICE,
            "level": self.outlook.level,
            "verdict": self.outlook.sentence,
            "doubts": [doubt.what for doubt in self.doubts],
            "volumes": {name: facts.to_json() for name, facts in self.volumes.items()},
            "coordinates": self.coordinates,
            "plan": {**ends_json(self.plan, self.coordinates), "length_mm": self.plan.length_mm},
            "wall": asdict(self.outlook.facts),
            "instruments": {prospect.instrument: _prospect(prospect) for prospect in self.outlook.prospects},
            **self.made.to_json(),
        }


def ends_json(line: Trajectory, coordinates: Convention) -> dict[str, Any]:
    """Return the ends of a plan, or of a bore's axis, as files say them."""
    ends = {"entry_mm": line.entry_mm, "target_mm": line.target_mm}
    return {name: list(in_world(place, coordinates)) for name, place in ends.items()}


def axis_of(pose: BorePose) -> Trajectory:
    """Return the axis of a bore from the depth of its plan's entry to that of its target."""
    entry, target = pose.axis_lps(np.array([0.0, pose.plan.length_mm]))
    return Trajectory(as_point(entry), as_point(target))


def in_convention(to_lps: Coordinates, coordinates: Convention) -> Coordinates:
    """Return a transform (4, 4) to LPS as one to ``coordinates``."""
    return np.asarray(np.diag([*SIGNS[coordinates], 1.0]) @ to_lps)


def estimate_text(value: Estimate, digits: int = 2) -> str:
    """Return "0.31 (0.22 to 0.40)"."""
    return f"{value.value:.{digits}f} ({value.low:.{digits}f} to {value.high:.{digits}f})".replace("-", "−")


def place_text(place: Point) -> str:
    """Return "12.5, −40.0, 7.1"."""
    return ", ".join(f"{value:.1f}" for value in place).replace("-", "−")


def _prospect(prospect: Prospect) -> dict[str, Any]:
    return {
        "level": prospect.level,
        "told": prospect.n_told,
        "told_at_a_wrong_place": prospect.n_misled,
        "median_error_mm": prospect.median_mm,
        "largest_error_mm": prospect.largest_mm,
        "rehearsals": [asdict(one) for one in prospect.tried],
    }
