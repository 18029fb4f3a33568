"""`endoct pose --plan-only` as a function: how well a bore could be told, by CT and plan alone."""

from pathlib import Path
from typing import TYPE_CHECKING

from endoct.base.errors import EndoctError
from endoct.base.files.output import new_output
from endoct.modalities.ct.stored import Convention
from endoct.modalities.ct.trajectory import Point
from endoct.modalities.device import Device, check_device
from endoct.workbench.posing.plan import read_plan
from endoct.workbench.running.kinds import POSE
from endoct.workbench.running.progress import Stages, stages_for
from endoct.workbench.running.scheduler import one_blas_thread

if TYPE_CHECKING:
    from endoct.workbench.posing.outlook_result import OutlookResult

RADIUS_MM = 1.25
"""Of the hole that is usual here, as the simulator's."""
RADII_MM = (0.3, 5.0)
LEAST_SEEN_MM = 2.0


@one_blas_thread()
def pose_outlook(
    ct: Path | str,
    output: Path | str | None = None,
    *,
    entry_mm: Point | None = None,
    target_mm: Point | None = None,
    plan: Path | str | None = None,
    coordinates: Convention | None = None,
    radius_mm: float = RADIUS_MM,
    seen_mm: float | None = None,
    device: Device = "cpu",
    overwrite: bool = False,
    progress: bool | Stages = True,
) -> "OutlookResult":
    """Say how well a bore along a plan could be told in the patient's ``ct``, before anything is recorded.

    Recordings are rehearsed: from the CT's own air, of bores that miss the plan by up to 1 mm and 2°, with what
    instruments get wrong, by one with depth and by one that shows cells alone. Each is then looked for as :func:`pose`
    does. ``radius_mm`` of the bore; ``seen_mm``: how much of it a recording shows, all of the plan's length unless
    stated. The rest is as of :func:`pose`.

    Raises :class:`EndoctError` where something cannot be used, or
    ``output`` exists and ``overwrite`` is not set. Research software, not for clinical decisions.

    With the bone that :func:`pose` simulates in its example, of which so short a bore shows little:

    >>> from endoct.workbench import pose_outlook
    >>> pose_outlook("patient/truth/ct.nii.gz", plan="patient/plan.mrk.json").outlook.level
    'poorly'
    """
    check_device(device)
    if not RADII_MM[0] <= radius_mm <= RADII_MM[1]:
        raise EndoctError(
            "there is no such bore",
            found=f"a radius of {radius_mm:g} mm",
            expected=f"{RADII_MM[0]:g} to {RADII_MM[1]:g} mm",
            remedy="check --radius",
        )
    inputs = [Path(one) for one in (ct, plan) if one is not None]

    def run(folder: Path | None) -> "OutlookResult":
        planned = read_plan(Path(ct), entry_mm, target_mm, None if plan is None else Path(plan), coordinates)
        length = planned.plan.length_mm
        if not LEAST_SEEN_MM <= (seen := length if seen_mm is None else seen_mm) <= length:
            raise EndoctError(
                "so much of the bore cannot be seen",
                found=f"{seen:g} mm",
                expected=f"{LEAST_SEEN_MM:g} mm to the length of the plan, {length:.1f} mm",
                remedy="check --seen, entry and target",
            )
        from endoct.workbench.posing.rehearsing import rehearse  # torch is loaded once the plan is known to be readable

        return rehearse(planned, radius_mm, seen, folder, device=device, stages=stages_for(progress))

    if output is None:
        return run(None)
    with new_output(Path(output), POSE, overwrite=overwrite, inputs=inputs) as scratch:
        return run(scratch)
