"""`endoct pose` as a function: from sides, a CT and a plan to where the bore lies, and to a folder of it."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from endoct.base.errors import EndoctError
from endoct.base.files.output import new_output
from endoct.modalities.ct.label_names import OUR_TABLE
from endoct.modalities.ct.stored import Convention
from endoct.modalities.ct.trajectory import Point
from endoct.modalities.device import Device, check_device
from endoct.stitching.panorama import Panorama
from endoct.workbench.pipeline.sources import Source
from endoct.workbench.posing.plan import read_plan, with_labels
from endoct.workbench.posing.sides import MOST_SIDES, side_of_comparison
from endoct.workbench.running.kinds import POSE
from endoct.workbench.running.progress import Stages, stages_for
from endoct.workbench.running.scheduler import one_blas_thread, scheduler

if TYPE_CHECKING:
    from endoct.workbench.posing.result import PoseResult


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
    stages = stages_for(progress)
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
        with scheduler(needed=len(sources) == MOST_SIDES) as second:
            second.load("endoct.workbench.posing.finding")  # while the CT is read
            planned = read_plan(Path(ct), entry_mm, target_mm, None if plan is None else Path(plan), coordinates)
            if labels is not None:
                planned = with_labels(planned, Path(labels), label_names, coordinates)
            from endoct.workbench.posing.finding import find_sources  # torch: once all that was read can be used

            return find_sources(sources, planned, folder, device=device, stages=stages, scheduler=second)

    if output is None:
        return run(None)
    with new_output(Path(output), POSE, overwrite=overwrite, inputs=read) as scratch:
        return run(scratch)
