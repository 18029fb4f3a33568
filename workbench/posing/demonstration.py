"""`endoct demo --pose` as a function: a bore in a simulated patient, and where it is found."""

from pathlib import Path

from endoct.synthetic.sample.presets import PresetName
from endoct.workbench.pipeline.simulating import demonstrate, simulate
from endoct.workbench.posing.pose import pose
from endoct.workbench.posing.result import PoseResult
from endoct.workbench.running.kinds import POSE
from endoct.workbench.running.progress import Stages, stages_for

VOXEL_MM = 0.3
"""Of the simulated CT, as usual in a clinic."""


def demo_pose(
    output: Path | str,
    *,
    preset: PresetName = "small-patient",
    seed: int = 7,
    overwrite: bool = False,
    progress: bool | Stages = True,
) -> PoseResult:
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
