"""`endoct pose` as functions: where a bore lies in a CT, how well that could be told before drilling, and a demo."""

from pathlib import Path
from typing import TYPE_CHECKING

from endoct.base.errors import EndoctError
from endoct.base.files.output import output_if_any
from endoct.modalities.ct.label_names import OUR_TABLE
from endoct.modalities.device import check_device
from endoct.synthetic.sample.presets import PresetName
from endoct.workbench.pipeline.simulating import demonstrate, simulate
from endoct.workbench.posing.plan import read_requested, with_labels
from endoct.workbench.requests import OutlookRequest, PoseRequest, by_request
from endoct.workbench.running.outputs import POSE
from endoct.workbench.running.progress import Stages, stages_for
from endoct.workbench.running.scheduler import one_blas_thread, scheduler
from endoct.workbench.sides.sources import MOST_SIDES, side_of_comparison, source_of

if TYPE_CHECKING:
    from endoct.workbench.posing.result import OutlookResult, PoseResult

RADII_MM = (0.3, 5.0)
"""Bores whose pose can be rehearsed."""
LEAST_SEEN_MM = 2.0
VOXEL_MM = 0.3
"""Of the CT that is simulated for a demonstration, as usual in a clinic."""


@by_request(PoseRequest)
@one_blas_thread()
def pose(request: PoseRequest) -> "PoseResult":
    """Find where a bore lies in the patient's ``ct``, by one side or two, near its plan.

    Arguments are those of :class:`~endoct.workbench.requests.PoseRequest`; ``sides`` may be panoramas at hand, too.
    Everything that `endoct pose` promises is written to the folder ``output`` where one is given.

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
    check_device(request.device)
    options = ((request.modality_a, request.settings_a), (request.modality_b, request.settings_b))
    sources = tuple(
        side_of_comparison(source_of(side, modality, settings))
        for side, (modality, settings) in zip(
            request.sides, (*options, *[(None, None)] * len(request.sides)), strict=False
        )
    )
    if request.label_names is not None and request.labels is None:
        raise EndoctError("there are no labels to be named", remedy="add --labels, or leave out --label-names")
    table = None if request.label_names == OUR_TABLE else request.label_names
    given = (request.ct, request.plan, request.labels, table, *(source.path for source in sources))
    inputs, stages = [Path(path) for path in given if path is not None], stages_for(request.progress)
    with (
        output_if_any(request.output, POSE, overwrite=request.overwrite, inputs=inputs) as folder,
        scheduler(needed=len(sources) == MOST_SIDES) as second,
    ):
        second.load("endoct.workbench.posing.steps")  # while the CT is read
        planned = read_requested(request.ct, request)
        if request.labels is not None:
            planned = with_labels(planned, Path(request.labels), request.label_names, request.coordinates)
        from endoct.workbench.posing.steps import find_sources  # torch: once all that was read can be used

        return find_sources(sources, planned, folder, device=request.device, stages=stages, scheduler=second)


@by_request(OutlookRequest)
@one_blas_thread()
def pose_outlook(request: OutlookRequest) -> "OutlookResult":
    """Say how well a bore along a plan could be told in the patient's ``ct``, before anything is recorded.

    Recordings are rehearsed in the CT's own air, of bores that miss the plan by up to 1 mm and 2°. They have the errors
    of instruments, one with depth and one that shows cells alone. Each bore is then looked for as :func:`pose` does.
    Arguments are those of :class:`~endoct.workbench.requests.OutlookRequest`.

    Raises :class:`EndoctError` where something cannot be used, or ``output`` exists and ``overwrite`` is not set.
    Research software, not for clinical decisions.

    With the bone that :func:`pose` simulates in its example, of which so short a bore shows little:

    >>> from endoct.workbench import pose_outlook
    >>> pose_outlook("patient/truth/ct.nii.gz", plan="patient/plan.mrk.json").outlook.level
    'poorly'
    """
    check_device(request.device)
    radius_mm = request.radius_mm
    if not RADII_MM[0] <= radius_mm <= RADII_MM[1]:
        raise EndoctError(
            "there is no such bore",
            found=f"a radius of {radius_mm:g} mm",
            expected=f"{RADII_MM[0]:g} to {RADII_MM[1]:g} mm",
            remedy="check --radius",
        )
    inputs = [Path(path) for path in (request.ct, request.plan) if path is not None]
    with output_if_any(request.output, POSE, overwrite=request.overwrite, inputs=inputs) as folder:
        planned = read_requested(request.ct, request)
        length_mm = planned.plan.length_mm
        seen_mm = length_mm if request.seen_mm is None else request.seen_mm
        if not LEAST_SEEN_MM <= seen_mm <= length_mm:
            raise EndoctError(
                "so much of the bore cannot be seen",
                found=f"{seen_mm:g} mm",
                expected=f"{LEAST_SEEN_MM:g} mm to the length of the plan, {length_mm:.1f} mm",
                remedy="check --seen, entry and target",
            )
        from endoct.workbench.posing.steps import rehearse  # torch: once the plan is known to be readable

        stages = stages_for(request.progress)
        return rehearse(planned, radius_mm, seen_mm, folder, device=request.device, stages=stages)


def demo_pose(
    output: Path | str,
    *,
    preset: PresetName = "small-patient",
    seed: int = 7,
    overwrite: bool = False,
    progress: bool | Stages = True,
) -> "PoseResult":
    """Simulate a patient with a bore in ``output``/specimen and find it, by both recordings, in ``output``/pose.

    ``preset`` is one that has a patient: "mastoid", "patient" or "small-patient". Raises :class:`EndoctError` for
    another, and where ``output`` exists and ``overwrite`` is not set, or cannot be written.
    """
    stages = stages_for(progress)
    return demonstrate(
        Path(output),
        ("pose", POSE),
        lambda specimen: simulate(
            specimen,
            preset=preset,
            seed=seed,
            ct=True,
            vary={"ct.voxel_mm": (VOXEL_MM, VOXEL_MM)},
            overwrite=overwrite,
            progress=stages,
        ),
        lambda specimen, place: pose(
            [specimen / "endoscope", specimen / "oct"],
            specimen / "truth" / "ct.nii.gz",
            place,
            plan=specimen / "plan.mrk.json",
            labels=specimen / "truth" / "ct_labels.nii.gz",
            overwrite=overwrite,
            progress=stages,
        ),
        overwrite=overwrite,
    )
