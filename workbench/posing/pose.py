"""`endoct pose` as a function: from sides, a CT and a plan to where the bore lies, and to a folder of it.

The CT and the planned trajectory in it are read into one world: nothing of their convention is guessed.
"""

import time
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from endoct.base.compute.worker_process import WorkerProcess
from endoct.base.errors import EndoctError
from endoct.base.files.files import check_unchanged, digests, state_of
from endoct.base.files.output import new_output
from endoct.modalities.ct.ct_volume import CtVolume, check_within, in_world, meaning_of, read_ct, with_label_names
from endoct.modalities.ct.label_names import OUR_TABLE
from endoct.modalities.ct.stored import Convention
from endoct.modalities.ct.trajectory import Point, Trajectory, read_line
from endoct.modalities.device import Device, check_device
from endoct.stitching.panorama import Panorama
from endoct.workbench.pipeline.inputs import versions
from endoct.workbench.pipeline.sources import Source, inputs_of
from endoct.workbench.pipeline.volumes import facts_of
from endoct.workbench.posing.sides import MOST_SIDES, make_sides, open_sides, side_of_comparison
from endoct.workbench.running.kinds import POSE
from endoct.workbench.running.progress import Stages, stages_for
from endoct.workbench.running.second_process import one_blas_thread, second_process

if TYPE_CHECKING:
    from endoct.workbench.posing.result import PoseResult


@dataclass(frozen=True, eq=False)
class Planned:
    """A CT with the plan in it.

    ``coordinates``: what the numbers mean that the user states and is told. ``files``: all that were read.
    """

    ct: CtVolume
    plan: Trajectory
    coordinates: Convention
    files: tuple[Path, ...]


def read_plan(
    ct: Path, entry_mm: Point | None, target_mm: Point | None, plan: Path | None, coordinates: Convention | None
) -> Planned:
    """Return the CT and the plan: ``entry_mm`` and ``target_mm``, or the markups file ``plan``.

    ``coordinates``: what ``entry_mm`` and ``target_mm`` mean, and the CT's own numbers where its file does not say;
    left out, they mean what the file of the CT says. Raises :class:`EndoctError` where something cannot be read, is not
    said, or where the plan lies outside the CT.
    """
    if (plan is None) == (entry_mm is None and target_mm is None):
        raise EndoctError(
            "it is not said where the bore was planned" if plan is None else "the plan is given twice",
            expected="--entry=x,y,z and --target=x,y,z in mm, or --plan with a markups file",
        )
    if plan is None and (entry_mm is None or target_mm is None):
        raise EndoctError(
            "it is not said where the bore was planned",
            found="an entry" if target_mm is None else "a target",
            expected="both --entry=x,y,z and --target=x,y,z, mm",
        )
    line = None if plan is None else read_line(plan)
    volume = read_ct(ct, coordinates)
    meaning = meaning_of(volume, coordinates, str(ct))
    if line is not None:
        trajectory, meaning = line[0], coordinates or line[1]
    elif entry_mm is not None and target_mm is not None:
        trajectory = Trajectory(in_world(entry_mm, meaning), in_world(target_mm, meaning))
    check_within(volume, trajectory, meaning, "the CT")
    files = files_read(ct, volume)
    return Planned(volume, trajectory, meaning, files if plan is None else (*files, plan))


def files_read(path: Path, volume: CtVolume) -> tuple[Path, ...]:
    """Return what a volume was read from: the folder ``path``, or the file and those that belong to it."""
    return (path,) if path.is_dir() else volume.files or (path,)


DECISIVE = ("torch", "kornia", "SimpleITK", "pydicom", "nibabel")
"""Libraries that figures of a pose depend on."""


@one_blas_thread()
def pose(
    sides: Sequence[Panorama | Path | str],
    ct: Path | str,
    output: Path | str | None = None,
    *,
    entry_mm: Point | None = None,
    target_mm: Point | None = None,
    plan: Path | str | None = None,
    coordinates: Convention | None = None,
    labels: Path | str | None = None,
    label_names: Path | str | None = None,
    modality_a: str | None = None,
    modality_b: str | None = None,
    settings_a: Mapping[str, object] | None = None,
    settings_b: Mapping[str, object] | None = None,
    device: Device = "cpu",
    overwrite: bool = False,
    progress: bool | Stages = True,
) -> "PoseResult":
    """Find where a bore lies in the patient's ``ct``, by one side or two, near its plan.

    ``sides`` are panoramas at hand, or paths of recordings, panoramas or sides of comparisons ("DIR:SIDE"). The plan
    goes from ``entry_mm`` to ``target_mm``, whose ``coordinates`` are what the file of the CT says unless stated, or is
    the line in ``plan``, a markups file of 3D Slicer. ``labels`` is a segmentation in the world of the CT, with the
    structures that the bore has to miss; ``label_names`` is a table of their names where it has none itself, or
    "endoct" for those that :func:`simulate` gives. Everything that `endoct pose` promises is written to the folder
    ``output`` where one is given. ``modality_a``, ``settings_a`` and so on are those of :func:`compare`; ``device``:
    where to compute.

    Where it cannot be told where the bore lies, the result's ``pose`` is None and ``answer.reason`` says why. Raises
    :class:`EndoctError` where something cannot be used, or ``output`` exists and ``overwrite`` is
    not set. Research software, not for clinical decisions.

    In the CT of a simulated bone, with the truth for a plan:

    >>> import json, pathlib
    >>> from endoct.workbench import pose, simulate
    >>> simulate("patient", preset="learning", seed=7, ct=True, vary={"bore.bone": ("network",)})
    >>> world = json.loads(pathlib.Path("patient/truth/recording.json").read_text())["world"]
    >>> plan = {"entry_mm": world["entry_mm"], "target_mm": world["target_mm"]}
    >>> found = pose(["patient/endoscope"], "patient/truth/ct.nii.gz", **plan)
    >>> found.answer.pose.names, found.coordinates
    (('endoscope',), 'ras')
    """
    check_device(device)
    options = ((modality_a, settings_a), (modality_b, settings_b))
    sources = tuple(
        side_of_comparison(Source(side if isinstance(side, Panorama) else Path(side), modality, settings or {}, device))
        for side, (modality, settings) in zip(sides, (*options, *[(None, None)] * len(sides)), strict=False)
    )
    if label_names is not None and labels is None:
        raise EndoctError("there are no labels to be named", remedy="add --labels, or leave out --label-names")
    table = [] if label_names in (None, OUR_TABLE) else [label_names]
    read = [
        *(Path(one) for one in (ct, plan, labels, *table) if one is not None),
        *(source.path for source in sources if source.path is not None),
    ]

    def run(folder: Path | None) -> "PoseResult":
        planned = read_plan(Path(ct), entry_mm, target_mm, None if plan is None else Path(plan), coordinates)
        with second_process() if len(sources) == MOST_SIDES else nullcontext() as process:
            if process is not None:  # it loads what it will need while the CT is read
                process.preload("endoct.workbench.posing.finding", "endoct.workbench.posing.folder")
            named = None if labels is None else with_label_names(read_ct(Path(labels), coordinates), label_names)
            files = planned.files if named is None else (*planned.files, *files_read(Path(str(labels)), named))
            return _found(sources, planned, named, files, device, folder, stages_for(progress), process)

    if output is None:
        return run(None)
    with new_output(Path(output), POSE, overwrite=overwrite, inputs=read) as scratch:
        return run(scratch)


def pose_versions() -> dict[str, str]:
    """Return the versions of endoct and of what a pose depends on."""
    return versions(*DECISIVE)


def _found(
    sources: Sequence[Source],
    planned: Planned,
    labels: CtVolume | None,
    paths: Sequence[Path],
    device: Device,
    folder: Path | None,
    stages: Stages,
    process: WorkerProcess | None,
) -> "PoseResult":
    from endoct.fusion.pose.air import air_around
    from endoct.fusion.pose.structures import label_doubts, structures_near
    from endoct.fusion.pose.summary import summary_of
    from endoct.workbench.posing.each_side import EachSide
    from endoct.workbench.posing.finding import find
    from endoct.workbench.posing.result import Made, PoseResult

    start = time.perf_counter()
    files = {path: state_of(path) for path in (*paths, *(one.path for one in sources if one.path is not None))}
    opened = open_sides(sources)
    structures = () if labels is None else structures_near(labels, planned.plan)
    volumes = {"ct": facts_of(planned.ct, "CT", planned.coordinates)}
    if labels is not None:
        volumes["labels"] = facts_of(labels, "labels", planned.coordinates, label_doubts(labels))
    with stages.stage("CT around the plan"):
        air = air_around(planned.ct, planned.plan)
    # what cannot be used was refused before the work of unrolling
    sides = make_sides(opened, stages, process)
    each = EachSide(air, sides, process if device == "cpu" else None)
    answer = find(air, planned.plan, each, device, stages)
    with stages.stage("in clinical words"):
        summary = summary_of(answer, structures)
    inputs = [*map(digests, paths), *(inputs_of(source, side) for source, side in zip(sources, sides, strict=True))]
    made = Made(
        inputs={name: digest for one in inputs for name, digest in one.items()},
        versions=pose_versions(),
        parameters={"device": device, **{one.name: one.panorama.provenance.get("parameters", {}) for one in sides}},
        seconds={
            **{title: round(seconds, 3) for title, seconds in stages.seconds.items()},
            "in all, before the files": round(time.perf_counter() - start, 3),
        },
    )
    result = PoseResult(answer, summary, planned.coordinates, made, volumes)
    for path, state in files.items():
        check_unchanged(path, state)
    if folder is not None:
        from endoct.workbench.posing.folder import write_folder  # only who draws loads matplotlib

        write_folder(result, planned.ct, labels, each, folder, stages)
    return result
