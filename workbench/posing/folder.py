"""The folder that `endoct pose` writes."""

from pathlib import Path

from endoct.fusion.pose.pose import BorePose
from endoct.modalities.ct.trajectory import write_line
from endoct.workbench.pipeline.inputs import json_text
from endoct.workbench.posing.figures import draw_cut, draw_wall
from endoct.workbench.posing.handover import write_handover
from endoct.workbench.posing.page import pose_page
from endoct.workbench.posing.plan import Planned
from endoct.workbench.posing.prediction import compare_with, predicted, save_compared
from endoct.workbench.posing.result import Made, PoseResult
from endoct.workbench.posing.side_in_air import SideInAir, one_thread
from endoct.workbench.report.figures.rendered import Drawn, write_figures
from endoct.workbench.running.progress import Stages
from endoct.workbench.running.scheduler import Spread

PREDICTED = "predicted"


def write_folder(result: PoseResult, planned: Planned, sides: Spread[SideInAir], folder: Path, stages: Stages) -> None:
    """Write all of a pose into ``folder``, which must not exist.

    A pose that is not told is not handed over: no transform, trajectory or mesh of it is written.
    """
    pose = result.answer.pose
    folder.mkdir()
    (folder / "pose.json").write_text(json_text(result.to_json()) + "\n", encoding="utf-8")
    write_line(pose.plan, "plan", folder / "plan.mrk.json")
    if result.told:
        write_handover(pose, folder)
    with stages.stage("compare with the CT"):
        walls = sides.map(write_side, pose, result.made, folder)
    with stages.stage("report"):
        drawn = [draw_cut(planned.ct, planned.labels, pose, result.told), *walls]
        write_figures(drawn, folder / "figures")
        (folder / "report.html").write_text(pose_page(result, folder.name, drawn), encoding="utf-8")


@one_thread()
def write_side(given: SideInAir, pose: BorePose, made: Made, folder: Path) -> Drawn:
    """Write a side beside what the CT predicts of it into the ``folder`` of a pose; return their figure."""
    prediction = predicted(given.air, pose, given.side)
    if (compared := compare_with(prediction, pose, given)) is not None:
        save_compared(compared, prediction, given.side, made, folder / PREDICTED / given.side.name)
    return draw_wall(given.side, prediction)
