"""The command that finds where a bore lies in the patient's CT."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypedDict

from tyro.conf import Positional, arg

from endoct.base.errors import EndoctError
from endoct.modalities.device import Device
from endoct.workbench.commands.console import command_stages, print_json, print_line, status_of
from endoct.workbench.commands.options import ModalityName, Output, Place, Settings
from endoct.workbench.running.progress import Stages
from endoct.workbench.running.refusals import UNTOLD

if TYPE_CHECKING:
    from endoct.modalities.ct.trajectory import Point
    from endoct.workbench.posing.outlook_result import OutlookResult
    from endoct.workbench.posing.result import PoseResult


class _Asked(TypedDict):
    """What is asked with a recording and without one."""

    entry_mm: "Point | None"
    target_mm: "Point | None"
    plan: Path | None
    coordinates: Literal["ras", "lps"] | None
    device: Device
    overwrite: bool
    progress: Stages


def pose(
    sides: Positional[tuple[Path, ...]],
    output: Output,
    ct: Path,
    entry: Place = None,
    target: Place = None,
    plan: Path | None = None,
    coordinates: Literal["ras", "lps"] | None = None,
    labels: Path | None = None,
    label_names: Annotated[str | None, arg(metavar="FILE|endoct")] = None,
    modality_a: ModalityName = None,
    modality_b: ModalityName = None,
    set_a: Settings = (),
    set_b: Settings = (),
    plan_only: bool = False,
    radius: float | None = None,
    seen: float | None = None,
    device: Device = "cpu",
    strict: bool = False,
    overwrite: bool = False,
    json: bool = False,
) -> int:
    """Find where a bore lies in the patient's CT (see docs/how-to/pose.md). Research software.

    Args:
        sides: one or two of one bore, none with --plan-only: a recording, a panorama, or one side of a
            comparison as DIR:SIDE
        output: folder to write to
        ct: CT from before drilling: a file .nrrd, .nii.gz, .mha, or a folder of DICOM
        entry: where the bore was planned to begin, mm, as --entry=12.5,-40,7
        target: where it was planned to end, mm
        plan: instead of these two, a line of 3D Slicer (.mrk.json)
        coordinates: what x, y and z of these two mean; default: as the file says (NIfTI RAS, NRRD its space, else LPS)
        labels: segmentation in the world of the CT, with the names of its labels in it or in a table next to it
        label_names: table of these names, of 3D Slicer or ITK-SNAP; or the word endoct: 1 bone, 2 facial nerve,
            3 chorda tympani, 4 cochlea, 5 sigmoid sinus, 6 antrum
        modality_a: plug-in to read the first side with
        modality_b: plug-in to read the second side with
        set_a: a key of the first side's sidecar or a parameter of its processing
        set_b: a key of the second side's sidecar or a parameter of its processing
        plan_only: before there is a recording: how well this trajectory could be told, by the CT alone
        radius: with --plan-only, of the bore, mm; default: 1.25
        seen: with --plan-only, how much of the bore a recording would show, mm; default: the plan's length
        device: where to compute; cuda: on a GPU
        strict: end with exit status 3 where there is a doubt; the output is written all the same
        overwrite: replace the output if it exists
        json: print the result as JSON
    """
    from endoct.workbench.pipeline.settings import parse, parse_place
    from endoct.workbench.posing.pose import pose as find_pose

    of_sides: dict[str, object] = {
        "a side": sides, "--labels": labels, "--label-names": label_names, "--modality-a": modality_a,
        "--modality-b": modality_b, "--set-a": set_a, "--set-b": set_b,
    }  # fmt: skip
    _check_options(plan_only, of_sides, {"--radius": radius, "--seen": seen})
    asked: _Asked = {
        "entry_mm": parse_place("entry", entry),
        "target_mm": parse_place("target", target),
        "plan": plan,
        "coordinates": coordinates,
        "device": device,
        "overwrite": overwrite,
        "progress": command_stages(json),
    }
    if plan_only:
        from endoct.workbench.posing.outlook import RADIUS_MM, pose_outlook

        radius_mm = RADIUS_MM if radius is None else radius
        outlook = pose_outlook(ct, output, radius_mm=radius_mm, seen_mm=seen, **asked)
        if json:
            print_json(outlook.to_json())
        else:
            print_line(outlook.outlook.sentence)
            _print_doubts(outlook)
            print_line(f"report: {output / 'report.html'}")
        return status_of(outlook.doubts, strict=strict) if outlook.tellable else UNTOLD
    result = find_pose(
        sides,
        ct,
        output,
        labels=labels,
        label_names=label_names,
        modality_a=modality_a,
        modality_b=modality_b,
        settings_a=parse(set_a),
        settings_b=parse(set_b),
        **asked,
    )
    return print_pose(result, output, as_json=json, strict=strict)


def print_pose(result: "PoseResult", folder: Path, *, as_json: bool, strict: bool = False) -> int:
    """Print the result of a pose that was written to ``folder``; return the exit status, ``strict`` about doubts."""
    if as_json:
        print_json(result.to_json())
    else:
        _print(result)
        print_line(f"report: {folder / 'report.html'}")
    return status_of(result.doubts, strict=strict) if result.told else UNTOLD


def _check_options(plan_only: bool, of_sides: Mapping[str, object], of_plan: Mapping[str, object]) -> None:
    """Raise :class:`EndoctError` where something is given that has no meaning with, or without, --plan-only."""
    if plan_only and (given := [name for name, value in of_sides.items() if value]):
        raise EndoctError(
            "with --plan-only there is no recording", found=", ".join(given), remedy="leave out that, or --plan-only"
        )
    if not plan_only and (given := [name for name, value in of_plan.items() if value is not None]):
        raise EndoctError(
            "a recording says what it shows of its bore",
            found=", ".join(given),
            remedy="leave it out, or add --plan-only",
        )


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
    for one in summary.clearances:
        print_line(f"{one.name}: {estimate_text(one.distance_mm)} mm from the bore")
    print_line(f"In brackets: 95 % intervals. {NOTICE}")


def _print_doubts(result: "PoseResult | OutlookResult") -> None:
    for doubt in result.doubts:
        print_line(f"doubt: {doubt.what}")
    for facts in result.volumes.values():
        for note in facts.notes:
            print_line(f"note ({facts.title}): {note}")
