"""The pose of a bore and the outlook on it, step by step, each with its folder.

Loads torch: imported only where a pose is looked for, or recordings are rehearsed.
"""

import time
from collections.abc import Sequence
from pathlib import Path

from endoct.base.files.contents import write_marked
from endoct.base.files.files import check_unchanged, digests, state_of
from endoct.fusion.pose import outlook
from endoct.fusion.pose.air import AirAround, air_around
from endoct.fusion.pose.finding import PoseAnswer, SidePose, answer, find_alone
from endoct.fusion.pose.observation import observe
from endoct.fusion.pose.pose import BorePose
from endoct.fusion.pose.rehearsal import BY_CELLS, WITH_DEPTH
from endoct.fusion.pose.structures import label_doubts, structures_near
from endoct.fusion.pose.summary import summary_of
from endoct.modalities.ct.trajectory import Trajectory, write_line
from endoct.modalities.device import Device
from endoct.workbench.pipeline.volumes import facts_of
from endoct.workbench.posing.figures import draw_cut, draw_wall, draw_wall_of_plan
from endoct.workbench.posing.handover import write_handover
from endoct.workbench.posing.pages import outlook_page, pose_page
from endoct.workbench.posing.plan import PlannedBore
from endoct.workbench.posing.prediction import SideInAir, compare_with, one_thread, predicted, save_compared
from endoct.workbench.posing.result import Made, OutlookResult, PoseResult, pose_versions
from endoct.workbench.report.figures.rendered import Drawn, write_figures
from endoct.workbench.running.outputs import json_text
from endoct.workbench.running.progress import Stages
from endoct.workbench.running.scheduler import ALONE, Scheduler, Spread
from endoct.workbench.sides.sources import Source, inputs_of, open_recorded, read_sides, unroll_sources

PREDICTED = "predicted"


def find_sources(
    sources: Sequence[Source],
    planned: PlannedBore,
    folder: Path | None,
    *,
    device: Device,
    stages: Stages,
    scheduler: Scheduler,
) -> PoseResult:
    """Find where a bore lies by its ``sources``; write everything `endoct pose` promises into ``folder``, if given.

    Raises :class:`EndoctError` where a side cannot be used, or something is changed while it is read.
    """
    start = time.perf_counter()
    labels = planned.labels
    files = {path: state_of(path) for path in (*planned.files, *(one.path for one in sources if one.path is not None))}
    opened = open_recorded(sources)
    structures = () if labels is None else structures_near(labels, planned.plan)
    volumes = {"ct": facts_of(planned.ct, "CT", planned.coordinates)}
    if labels is not None:
        volumes["labels"] = facts_of(labels, "labels", planned.coordinates, label_doubts(labels))
    with stages.stage("CT around the plan"):
        air = air_around(planned.ct, planned.plan)
    # what cannot be used was refused before the work of unrolling
    sides = read_sides(unroll_sources(opened, stages, scheduler))
    at_once = scheduler if device == "cpu" else ALONE
    in_air = at_once.spread([SideInAir(air, side) for side in sides])
    found = find(air, planned.plan, in_air, device, stages)
    with stages.stage("in clinical words"):
        summary = summary_of(found, structures)
    of_sides = [inputs_of(source, side) for source, side in zip(sources, sides, strict=True)]
    made = Made(
        inputs={name: digest for one in (*map(digests, planned.files), *of_sides) for name, digest in one.items()},
        versions=pose_versions(),
        parameters={"device": device, **{side.name: side.panorama.provenance.get("parameters", {}) for side in sides}},
        seconds=_seconds(stages, start),
    )
    result = PoseResult(found, summary, planned.coordinates, made, volumes)
    for path, state in files.items():
        check_unchanged(path, state)
    if folder is not None:
        write_folder(result, planned, in_air, folder, stages)
    return result


def find(air: AirAround, plan: Trajectory, sides: Spread[SideInAir], device: str, stages: Stages) -> PoseAnswer:
    """Return where the bore lies in ``air``. Raises :class:`EndoctError` where a side shows nothing."""
    with stages.stage("pose by each side"):
        found = sides.map(find_side, device)
    with stages.stage("pose by all"), one_thread():
        return answer(air.to(device), plan, found)


@one_thread()
def find_side(given: SideInAir, device: str) -> SidePose:
    """Return where a side alone lies in the air around the plan."""
    cells = None if given.side.relief is not None else given.cells.mask
    return find_alone(given.air.to(device), observe(given.side, cells))


def write_folder(
    result: PoseResult, planned: PlannedBore, sides: Spread[SideInAir], folder: Path, stages: Stages
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
        walls = sides.map(write_side, pose, result.made, folder)
    with stages.stage("report"):
        drawn = [draw_cut(planned.ct, planned.labels, pose, result.told), *walls]
        write_figures(drawn, folder / "figures")
        write_marked(pose_page(result, folder.name, drawn), folder / "report.html")


@one_thread()
def write_side(given: SideInAir, pose: BorePose, made: Made, folder: Path) -> Drawn:
    """Write a side beside what the CT predicts of it into the ``folder`` of a pose; return their figure."""
    prediction = predicted(given.air, pose, given.side)
    if (compared := compare_with(prediction, pose, given)) is not None:
        save_compared(compared, prediction, given.side, made, folder / PREDICTED / given.side.name)
    return draw_wall(given.side, prediction)


def rehearse(
    planned: PlannedBore, radius_mm: float, seen_mm: float, folder: Path | None, *, device: Device, stages: Stages
) -> OutlookResult:
    """Rehearse recordings of a bore along a plan; write everything `endoct pose --plan-only` promises into ``folder``.

    ``radius_mm`` is the bore's, ``seen_mm`` how much of it a recording shows. Raises :class:`EndoctError` where the CT
    or the plan is changed while it is read.
    """
    start = time.perf_counter()
    files = {path: state_of(path) for path in planned.files}
    with stages.stage("CT around the plan"):
        air = air_around(planned.ct, planned.plan)
        wall = outlook.wall_of_plan(air, radius_mm)
    prospects = []
    for instrument in (WITH_DEPTH, BY_CELLS):
        with stages.stage(f"rehearsals by {instrument.name}") as advance:
            tried = []
            for number in range(outlook.REHEARSALS):
                with one_thread():
                    tried.append(outlook.rehearsed(air, instrument, radius_mm, seen_mm, number, device))
                advance((number + 1) / outlook.REHEARSALS)
        prospects.append(outlook.Prospect(instrument.name, tuple(tried)))
    made = Made(
        inputs={name: digest for path in planned.files for name, digest in digests(path).items()},
        versions=pose_versions(),
        parameters={"device": device, "radius_mm": radius_mm, "seen_mm": seen_mm, "seed": outlook.SEED},
        seconds=_seconds(stages, start),
    )
    volumes = {"ct": facts_of(planned.ct, "CT", planned.coordinates)}
    found = outlook.Outlook(outlook.facts_of(wall), tuple(prospects))
    result = OutlookResult(found, planned.plan, planned.coordinates, wall, made, volumes)
    for path, state in files.items():
        check_unchanged(path, state)
    if folder is not None:
        folder.mkdir()
        (folder / "outlook.json").write_text(json_text(result.to_json()) + "\n", encoding="utf-8")
        write_line(planned.plan, "plan", folder / "plan.mrk.json")
        with stages.stage("report"):
            drawn = [draw_wall_of_plan(wall, radius_mm)]
            write_figures(drawn, folder / "figures")
            write_marked(outlook_page(result, folder.name, drawn), folder / "report.html")
    return result


def _seconds(stages: Stages, start: float) -> dict[str, float]:
    """Return what every stage took, and all since ``start`` of ``time.perf_counter``."""
    of_stages = {title: round(seconds, 3) for title, seconds in stages.seconds.items()}
    return {**of_stages, "in all, before the files": round(time.perf_counter() - start, 3)}
