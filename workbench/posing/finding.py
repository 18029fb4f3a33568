"""The pose of a bore by the sides at hand, stage by stage. Loads torch: imported only where a pose is looked for."""

from collections.abc import Sequence

import torch

from endoct.fusion.evidence.side import Side
from endoct.fusion.pose.air import AirAround
from endoct.fusion.pose.answer import PoseAnswer
from endoct.fusion.pose.finding import answer, find_alone
from endoct.fusion.pose.observation import observe
from endoct.modalities.trajectory import Trajectory
from endoct.stitching.errors import EndoctError
from endoct.workbench.running.progress import Stages


def check_device(device: str) -> None:
    """Raise :class:`EndoctError` where there is no such device."""
    if device == "cuda" and not torch.cuda.is_available():
        raise EndoctError("there is no CUDA device", found="cuda", expected="cpu", remedy="leave out --device")


def find(air: AirAround, plan: Trajectory, sides: Sequence[Side], device: str, stages: Stages) -> PoseAnswer:
    """Return where the bore lies in ``air``. Raises :class:`EndoctError` where a side shows nothing."""
    air = air.to(device)
    found = []
    for side in sides:
        with stages.stage(f"pose by {side.name}"):
            found.append(find_alone(air, observe(side)))
    if len(found) == 1:
        return answer(air, plan, found)
    with stages.stage("pose by both"):
        return answer(air, plan, found)
