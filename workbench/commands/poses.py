"""The command that finds where a bore lies in the patient's CT."""

from dataclasses import KW_ONLY, dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from endoct.base.errors import EndoctError
from endoct.workbench.commands.console import command_stages, print_json, print_line, status_of
from endoct.workbench.requests import UNSET, OutlookRequest, Output, PlanRequest, PoseRequest
from endoct.workbench.running.refusals import UNTOLD

if TYPE_CHECKING:
    from endoct.workbench.posing.result import OutlookResult, PoseResult


@dataclass(frozen=True, eq=False)
class Pose(PoseRequest):
    """Find where a bore lies in the patient's CT (see docs/how-to/pose.md). Research software.

    Args:
        plan_only: before there is a recording: how well this trajectory could be told, by the CT alone
        radius: with --plan-only, of the bore, mm; default: 1.25
        seen: with --plan-only, how much of the bore a recording would show, mm; default: the plan's length
        strict: end with exit status 3 where there is a doubt; the output is written all the same
        json: print the result as JSON
    """

    output: Output = field()
    _: KW_ONLY
    plan_only: bool = False
    radius: Annotated[float | None, UNSET] = None
    seen: Annotated[float | None, UNSET] = None
    strict: bool = False
    json: bool = False

    def __call__(self) -> int:
        """Find the pose, or say how well it could be told; print that, and return the exit status."""
        self._check()
        if self.plan_only:
            return self._plan_only()
        from endoct.workbench.posing.pose import pose

        result = pose(replace(self, progress=command_stages(self.json)))
        return print_pose(result, Path(self.output), as_json=self.json, strict=self.strict)

    def _plan_only(self) -> int:
        from endoct.workbench.posing.pose import pose_outlook

        of_plan = {one.name: getattr(self, one.name) for one in fields(PlanRequest)}
        of_bore = {"seen_mm": self.seen} | ({} if self.radius is None else {"radius_mm": self.radius})
        request = OutlookRequest(self.ct, self.output, **of_plan | of_bore)
        outlook = pose_outlook(replace(request, progress=command_stages(self.json)))
        if self.json:
            print_json(outlook.to_json())
        else:
            print_line(outlook.outlook.sentence)
            _print_doubts(outlook)
            print_line(f"report: {Path(self.output) / 'report.html'}")
        return status_of(outlook.doubts, strict=self.strict) if outlook.tellable else UNTOLD

    def _check(self) -> None:
        """Raise :class:`EndoctError` where something is given that has no meaning with, or without, --plan-only."""
        of_sides = {
            "a side": self.sides, "--labels": self.labels, "--label-names": self.label_names,
            "--modality-a": self.modality_a, "--modality-b": self.modality_b, "--set-a": self.settings_a,
            "--set-b": self.settings_b,
        }  # fmt: skip
        of_plan = {"--radius": self.radius, "--seen": self.seen}
        if self.plan_only and (given := [name for name, value in of_sides.items() if value]):
            raise EndoctError(
                "with --plan-only there is no recording",
                found=", ".join(given),
                remedy="leave out that, or --plan-only",
            )
        if not self.plan_only and (given := [name for name, value in of_plan.items() if value is not None]):
            raise EndoctError(
                "a recording says what it shows of its bore",
                found=", ".join(given),
                remedy="leave it out, or add --plan-only",
            )


def print_pose(result: "PoseResult", folder: Path, *, as_json: bool, strict: bool = False) -> int:
    """Print the result of a pose that was written to ``folder``; return the exit status, ``strict`` about doubts."""
    if as_json:
        print_json(result.to_json())
    else:
        _print(result)
        print_line(f"report: {folder / 'report.html'}")
    return status_of(result.doubts, strict=strict) if result.told else UNTOLD


def _print(result: "PoseResult") -> None:
    from endoct.workbench.posing.result import NOTICE, estimate_text, place_text

    if not result.told:
        print_line(f"cannot be told: {result.answer.reason}")
        _print_doubts(result)
        return
    summary, length_mm = result.summary, result.answer.pose.plan.length_mm
    _print_doubts(result)  # before any number: these hold as far as that
    print_line(
        f"offset from the plan (mm): entry {estimate_text(summary.at_entry.distance_mm)}, target "
        f"{estimate_text(summary.at_target.distance_mm)}; angle {estimate_text(summary.angle_deg)}°"
    )
    print_line(
        f"the bore's axis in the CT ({result.coordinates.upper()}, mm): {place_text(result.place(0.0))} at the depth "
        f"of the planned entry, {place_text(result.place(length_mm))} at that of the target"
    )
    name, depth = result.deepest
    print_line(
        f"the deepest row, by {name}: {place_text(result.place(depth.value))} at {estimate_text(depth)} mm depth"
    )
    for name, roll in summary.roll_deg.items():
        print_line(f"roll of {name}: θ = 0 lies at {estimate_text(roll, 0)}° about the axis")
    for clearance in summary.clearances:
        print_line(f"{clearance.name}: {estimate_text(clearance.distance_mm)} mm from the bore")
    print_line(f"In brackets: 95 % intervals. {NOTICE}")


def _print_doubts(result: "PoseResult | OutlookResult") -> None:
    for doubt in result.doubts:
        print_line(f"doubt: {doubt.what}")
    for facts in result.volumes.values():
        for note in facts.notes:
            print_line(f"note ({facts.title}): {note}")
