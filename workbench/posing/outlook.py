"""`endoct pose --plan-only` as a function: how well a bore could be told, by CT and plan alone."""

from pathlib import Path
from typing import TYPE_CHECKING

from endoct.base.errors import EndoctError
from endoct.modalities.device import check_device
from endoct.workbench.posing.plan import read_requested
from endoct.workbench.requests import OutlookRequest, by_request
from endoct.workbench.running.kinds import POSE, output_if_any
from endoct.workbench.running.progress import stages_for
from endoct.workbench.running.scheduler import one_blas_thread

if TYPE_CHECKING:
    from endoct.workbench.posing.outlook_result import OutlookResult

RADII_MM = (0.3, 5.0)
LEAST_SEEN_MM = 2.0


@by_request(OutlookRequest)
@one_blas_thread()
def pose_outlook(request: OutlookRequest) -> "OutlookResult":
    """Say how well a bore along a plan could be told in the patient's ``ct``, before anything is recorded.

    Recordings are rehearsed: from the CT's own air, of bores that miss the plan by up to 1 mm and 2°, with what
    instruments get wrong, by one with depth and by one that shows cells alone. Each is then looked for as :func:`pose`
    does. Arguments are those of :class:`~endoct.workbench.requests.OutlookRequest`.

    Raises :class:`EndoctError` where something cannot be used, or
    ``output`` exists and ``overwrite`` is not set. Research software, not for clinical decisions.

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
        from endoct.workbench.posing.rehearsing import rehearse  # torch: once the plan is known to be readable

        stages = stages_for(request.progress)
        return rehearse(planned, radius_mm, seen_mm, folder, device=request.device, stages=stages)
