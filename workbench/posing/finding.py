"""The pose of a bore by the sides at hand, stage by stage. Loads torch: imported only where a pose is looked for."""

from endoct.fusion.pose.air import AirAround
from endoct.fusion.pose.finding import Found, PoseAnswer, answer, find_alone
from endoct.fusion.pose.observation import observe
from endoct.modalities.ct.trajectory import Trajectory
from endoct.workbench.posing.each_side import EachSide, OneSide, one_thread
from endoct.workbench.running.progress import Stages


def find(air: AirAround, plan: Trajectory, each: EachSide, device: str, stages: Stages) -> PoseAnswer:
    """Return where the bore lies in ``air``. Raises :class:`EndoctError` where a side shows nothing."""
    with stages.stage("pose by each side"):
        found = each.map(find_side, device)
    with stages.stage("pose by all"), one_thread():
        return answer(air.to(device), plan, found)


@one_thread()
def find_side(one: OneSide, device: str) -> Found:
    """Return where a side alone lies in the air around the plan."""
    cells = None if one.side.relief is not None else one.segmented.segmentation.mask
    return find_alone(one.air.to(device), observe(one.side, cells))
