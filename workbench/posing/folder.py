"""The folder that `endoct pose` writes."""

from collections.abc import Sequence
from pathlib import Path

from endoct.fusion.evidence.side import Side
from endoct.fusion.pose.air import AirAround
from endoct.modalities.ct_volume import CtVolume
from endoct.modalities.markups import write_line
from endoct.workbench.pipeline.inputs import json_text
from endoct.workbench.posing.figures import draw_cut, draw_wall
from endoct.workbench.posing.handover import write_handover
from endoct.workbench.posing.page import pose_page
from endoct.workbench.posing.prediction import compare_with, predicted, save_compared
from endoct.workbench.posing.result import PoseResult
from endoct.workbench.report.figures.drawing import write_figures
from endoct.workbench.running.progress import Stages


def write_folder(
    result: PoseResult,
    ct: CtVolume,
    labels: CtVolume | None,
    air: AirAround,
    sides: Sequence[Side],
    folder: Path,
    stages: Stages,
) -> None:
    """Write all of a pose into ``folder``, which must not exist.

    A pose that is not told is not handed over: no transform, trajectory or mesh of it is written.
    """
    pose = result.answer.pose
    folder.mkdir()
    (folder / "pose.json").write_text(json_text(result.to_json()) + "\n", encoding="utf-8")
    write_line(pose.plan, "plan", folder / "plan.mrk.json")
    if result.told:
        write_handover(pose, folder)
    predictions = [predicted(air, pose, side) for side in sides]
    with stages.stage("compare with the CT"):
        for side, prediction in zip(sides, predictions, strict=True):
            if (compared := compare_with(prediction, pose, side)) is not None:
                save_compared(compared, prediction, side, result.made, folder / "predicted" / side.name)
    with stages.stage("report"):
        walls = [draw_wall(side, prediction) for side, prediction in zip(sides, predictions, strict=True)]
        drawn = [draw_cut(ct, labels, pose, result.told), *walls]
        write_figures(drawn, folder / "figures")
        (folder / "report.html").write_text(pose_page(result, folder.name, drawn), encoding="utf-8")
