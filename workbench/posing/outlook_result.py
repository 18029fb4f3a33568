"""What `endoct pose --plan-only` says, and how ``outlook.json`` says it."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from endoct.base.arrays import Image
from endoct.base.doubt import Doubt
from endoct.fusion.pose.outlook import Outlook, Prospect
from endoct.modalities.ct.stored import Convention
from endoct.modalities.ct.trajectory import Trajectory
from endoct.workbench.pipeline.volumes import VolumeFacts
from endoct.workbench.posing.result import NOTICE, Made, plan_json

FORMAT = "endoct-pose-outlook-1"


@dataclass(frozen=True, eq=False)
class OutlookResult:
    """How well a bore along a ``plan`` could be told in the patient's CT.

    Attributes
    ----------
    outlook: how rehearsals went, by kind of instrument, and what the CT has on the wall.
    plan: the trajectory, LPS.
    coordinates: the convention, RAS or LPS, of every place in :meth:`to_json`.
    wall: share of air on the wall of a bore along the plan, (n_z, n_theta) float32, as the CT has it.
    made: from what, with what and how fast.
    volumes: what was read of the CT ("ct"), with notes and doubts.
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
            "format": FORMAT,
            "notice": NOTICE,
            "level": self.outlook.level,
            "verdict": self.outlook.sentence,
            "doubts": [doubt.what for doubt in self.doubts],
            "volumes": {name: facts.to_json() for name, facts in self.volumes.items()},
            "coordinates": self.coordinates,
            "plan": plan_json(self.plan, self.coordinates),
            "wall": asdict(self.outlook.facts),
            "instruments": {one.instrument: _prospect(one) for one in self.outlook.prospects},
            "inputs": dict(self.made.inputs),
            "versions": dict(self.made.versions),
            "parameters": dict(self.made.parameters),
            "seconds": dict(self.made.seconds),
        }


def _prospect(prospect: Prospect) -> dict[str, Any]:
    return {
        "level": prospect.level,
        "told": prospect.n_told,
        "told_at_a_wrong_place": prospect.n_misled,
        "median_error_mm": prospect.median_mm,
        "largest_error_mm": prospect.largest_mm,
        "rehearsals": [asdict(one) for one in prospect.tried],
    }
