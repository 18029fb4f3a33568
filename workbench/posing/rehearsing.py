"""How well a bore could be told, step by step. Loads torch: imported only where recordings are rehearsed."""

import time
from pathlib import Path

from endoct.base.files.files import check_unchanged, digests, state_of
from endoct.fusion.pose import outlook
from endoct.fusion.pose.air import air_around
from endoct.fusion.pose.rehearsal import BY_CELLS, WITH_DEPTH
from endoct.modalities.ct.trajectory import write_line
from endoct.modalities.device import Device
from endoct.workbench.pipeline.inputs import json_text
from endoct.workbench.pipeline.volumes import facts_of
from endoct.workbench.posing.outlook_page import write_outlook_page
from endoct.workbench.posing.outlook_result import OutlookResult
from endoct.workbench.posing.plan import Planned
from endoct.workbench.posing.result import Made, pose_versions
from endoct.workbench.posing.side_in_air import one_thread
from endoct.workbench.running.progress import Stages


def rehearse(
    planned: Planned, radius_mm: float, seen_mm: float, folder: Path | None, *, device: Device, stages: Stages
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
        seconds={
            **{title: round(seconds, 3) for title, seconds in stages.seconds.items()},
            "in all, before the files": round(time.perf_counter() - start, 3),
        },
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
            write_outlook_page(result, radius_mm, folder)
    return result
