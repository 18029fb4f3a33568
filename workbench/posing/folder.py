"""The folder that `endoct pose` writes."""

from pathlib import Path

from endoct.fusion.pose.pose import BorePose
from endoct.modalities.ct.ct_volume import CtVolume
from endoct.modalities.ct.trajectory import write_line
from endoct.workbench.pipeline.inputs import json_text
from endoct.workbench.posing.each_side import EachSide, OneSide, one_thread
from endoct.workbench.posing.figures import draw_cut, draw_wall
from endoct.workbench.posing.handover import write_handover
from endoct.workbench.posing.page import pose_page
from endoct.workbench.posing.prediction import compare_with, predicted, save_compared
from endoct.workbench.posing.result import Made, PoseResult
from endoct.workbench.report.figures.rendered import Drawn, write_figures
from endoct.workbench.running.progress import Stages

PREDICTED = "predicted"


def write_folder(
    result: PoseResult, ct: CtVolume, labels: CtVolume | None, each: EachSide, folder: Path, stages: Stages
) -> None:
    """Write all of a pose into ``folder``, which must not exist.

    A pose that is not told is not handed over: no transform, trajectory or mesh of it is written.
    """
    pose = result.answer.pose
    folder.mkdir()
    (folder / "pose.json").write_text(json_text(result.to_json()) + "\n", encoding="utf-8")
    write_line(pose.plan, "plan", folder / "plan.mrk.json")
    if result.told:
        # who sees the line in another program sees no report
        write_handover(pose, "bore (doubted: see report.html)" if result.doubts else "bore", folder)
    with stages.stage("compare with the CT"):
        walls = each.map(write_side, pose, result.made, folder)
    with stages.stage("report"):
        drawn = [draw_cut(ct, labels, pose, result.told), *walls]
        write_figures(drawn, folder / "figures")
        (folder / "report.html").write_text(pose_page(result, folder.name, drawn), encoding="utf-8")


@one_thread()
def write_side(one: OneSide, pose: BorePose, made: Made, folder: Path) -> Drawn:
    """Write a side beside what the CT predicts of it into the ``folder`` of a pose; return their figure."""
    prediction = predicted(one.air, pose, one.side)
    if (compared := compare_with(prediction, pose, one)) is not None:
        save_compared(compared, prediction, one.side, made, folder / PREDICTED / one.side.name)
    return draw_wall(one.side, prediction)
