"""The task "pose": where a bore lies in the patient's CT, by what one recording of its wall shows, or two.

The judge asks for one point: on the axis, 5 mm beyond the end of the bore, where the drill would go next.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.base.numeric.circle import wrap_rad
from endoct.modalities.ct.ct_volume import CtVolume
from endoct.modalities.ct.trajectory import Trajectory
from endoct.stitching.panorama import Panorama
from endoct.workbench.bench.cases.bores import (
    PLAN_ASIDE_MM,
    PLAN_TILT_DEG,
    Given,
    PoseCase,
    own_cases,
    posed_case,
)
from endoct.workbench.bench.cases.specimens import DIFFICULTIES, PRESET_WORDS, simulated
from endoct.workbench.bench.program import read_answer, write_answer, write_given, write_panoramas
from endoct.workbench.bench.task import SUCCESS, Declined, Exchange, Range, Task, draw

if TYPE_CHECKING:
    from endoct.fusion.pose.pose import BorePose

BEYOND_MM = 5.0
SUCCESS_MM = 0.5
"""A bore past the facial nerve has to be known to this accuracy."""
CHI_SQUARE_95 = 5.991
"""The 95 % quantile of χ² with two degrees of freedom."""
CT_VOXEL_MM = "ct.voxel_mm"
SIDES: Mapping[str, Sequence[str]] = {"both": ("oct", "endoscope"), "oct": ("oct",), "endoscope": ("endoscope",)}
RANGES: Mapping[str, Range] = {
    "preset": ("patient",),
    "sides": tuple(SIDES),
    "plan_aside_mm": (PLAN_ASIDE_MM, PLAN_ASIDE_MM),
    "plan_tilt_deg": (PLAN_TILT_DEG, PLAN_TILT_DEG),
    CT_VOXEL_MM: (0.3, 0.3),
}
OPTIONAL: Mapping[str, Range] = {
    "preset": PRESET_WORDS,
    **{name: range_ for name, range_ in DIFFICULTIES.items() if name not in RANGES},
}


@dataclass(frozen=True, eq=False)
class LocatedSide:
    """Where a panorama lies in the patient, LPS, mm.

    ``ends_mm`` (2, 3): the points of the bore's axis at its first and its last row. ``zero`` (3,): the direction from
    the axis to its θ = 0.
    """

    ends_mm: Coordinates
    zero: Coordinates


@dataclass(frozen=True, eq=False)
class Located:
    """Where the panoramas of a bore lie, in the order in which they were given; None for one that was left aside.

    Of two, the one with depth has to be located: the judge goes by it. Methods that state how sure they are have a
    ``covariance``: (3, 3) in mm², of the axis across it, at a place (3,) along it, LPS: a square along the axis, which
    does not bend.
    """

    sides: tuple[LocatedSide | None, ...]
    covariance: Callable[[Coordinates], Coordinates] | None = None


def cases(seed: int, index: int, ranges: Mapping[str, Range]) -> PoseCase:
    """Simulate a bore with its CT, and draw a plan that lies off it."""
    drawn = draw(seed, index, {**RANGES, **ranges})
    given = {name: float(value) for name, value in drawn.items() if not isinstance(value, str)}
    difficulties = {name: value for name, value in drawn.items() if name in DIFFICULTIES}
    scratch = simulated(str(drawn["preset"]), seed, index, difficulties, ct=True)
    try:
        case = posed_case(
            Path(scratch.name) / "specimen",
            SIDES[str(drawn["sides"])],
            seed=seed if index == 0 else 1_000_000 * (1 + seed) + index,
            plan_aside_mm=given["plan_aside_mm"],
            plan_tilt_deg=given["plan_tilt_deg"],
        )
        return replace(case, name=f"{drawn['preset']}-{seed}-{index}", conditions=drawn, scratch=scratch)
    except BaseException:
        scratch.cleanup()
        raise


def judged_side(panoramas: Sequence[Panorama]) -> int:
    """Return which of the sides says where the bore lies along its axis: the first one with depth."""
    return next((at for at, one in enumerate(panoramas) if one.depth_mm is not None), 0)


def judge(case: PoseCase, answer: Located) -> dict[str, float]:
    """Score where the axis lies ``BEYOND_MM`` beyond the end of the bore, how it runs, and how it is turned.

    Of two sides the depth is that of the first one with depth. Where only the true line is known, depth and roll are
    not judged.
    """
    truth, panoramas = case.truth, case.given[0]
    number = judged_side(panoramas)
    if (side := answer.sides[number]) is None:
        raise ValueError(f"the {panoramas[number].modality} was not located")
    true = truth.axis_lps(truth.length_mm + BEYOND_MM)
    across, inward = truth.to_lps[:3, :2], truth.to_lps[:3, 2]
    if truth.sides:
        depths = truth.sides[number].z_bore(panoramas[number].z_mm[[0, -1]])
        last = int(np.argmax(depths))  # the row nearest to the end
        direction = _direction(side.ends_mm[last] - side.ends_mm[1 - last])
        place = side.ends_mm[last] + (truth.length_mm + BEYOND_MM - depths[last]) * direction
    else:
        direction = _direction(side.ends_mm[1] - side.ends_mm[0])
        direction = direction if direction @ inward > 0 else -direction
        place = side.ends_mm[1] + direction * ((true - side.ends_mm[1]) @ inward) / (direction @ inward)
    off = place - true
    aside_mm = float(np.linalg.norm(across.T @ off))
    tilt_rad = np.arctan2(np.linalg.norm(np.cross(direction, inward)), direction @ inward)
    scores = {"across_mm": aside_mm, "axis_deg": float(np.degrees(tilt_rad))}
    if truth.sides:
        x, y = across.T @ side.zero
        turn_rad = np.arctan2(y, x) - truth.sides[number].theta_bore(np.zeros(1))[0]
        scores |= {
            "target_mm": float(np.linalg.norm(off)),
            "roll_deg": float(np.degrees(np.abs(wrap_rad(np.array(turn_rad))))),
        }
    if answer.covariance is not None:
        stated = across.T @ answer.covariance(place) @ across
        scores["chi_square"] = float((across.T @ off) @ np.linalg.solve(stated, across.T @ off))
        scores["inside_95"] = float(scores["chi_square"] < CHI_SQUARE_95)
    return {SUCCESS: float(scores.get("target_mm", aside_mm) < SUCCESS_MM), **scores}


def _direction(vector: Coordinates) -> Coordinates:
    return np.asarray(vector / np.linalg.norm(vector))


def _write_given(given: Given, folder: Path) -> None:
    sides, ct, plan = given
    write_panoramas({str(number): panorama for number, panorama in enumerate(sides)}, folder)
    facts = {
        "sides": len(sides),
        "ct_to_lps": ct.to_lps.tolist(),
        "entry_mm": plan.entry_mm,
        "target_mm": plan.target_mm,
    }
    write_given(folder, facts, ct=ct.voxels)


def _write_located(answer: Located, folder: Path) -> None:
    sides = [None if side is None else {"ends_mm": side.ends_mm, "zero": side.zero} for side in answer.sides]
    said: dict[str, object] = {"sides": sides}
    axis = next((side.ends_mm for side in answer.sides if side is not None), None)
    if answer.covariance is not None and axis is not None:
        places = np.linspace(axis[0], axis[1], 3)
        said["covariance"] = {"places_mm": places, "mm2": [answer.covariance(place) for place in places]}
    write_answer(folder, said)


def _stated(covariance: Mapping[str, object]) -> Callable[[Coordinates], Coordinates]:
    """Return the covariance anywhere along an axis, of what it is at three places of it."""
    places = np.asarray(covariance["places_mm"], np.float64).reshape(3, 3)
    stated = np.asarray(covariance["mm2"], np.float64).reshape(3, 3, 3)
    along = places[2] - places[0]

    def at(place: Coordinates) -> Coordinates:
        t = float((place - places[0]) @ along / (along @ along))
        weights = 2 * (t - 0.5) * (t - 1), 4 * t * (1 - t), 2 * t * (t - 0.5)
        return np.asarray(np.tensordot(weights, stated, 1))

    return at


def _read_located(given: Given, folder: Path) -> Located:
    said = read_answer(folder)
    answered = said.get("sides")
    if not isinstance(answered, list) or len(answered) != len(given[0]):
        raise EndoctError("the answer lacks its sides", expected=f"a list of {len(given[0])}, null for one left aside")
    sides: list[LocatedSide | None] = []
    for side in answered:
        if side is None:
            sides.append(None)
            continue
        ends, zero = np.asarray(side["ends_mm"], np.float64), np.asarray(side["zero"], np.float64)
        if ends.shape != (2, 3) or zero.shape != (3,) or not np.isfinite([*ends.ravel(), *zero]).all():
            expected = "ends_mm, two points, and zero, a direction"
            raise EndoctError("a side of the answer lies nowhere", expected=expected)
        sides.append(LocatedSide(ends, zero))
    covariance = said.get("covariance")
    return Located(tuple(sides), _stated(covariance) if isinstance(covariance, dict) else None)


TASK = Task(
    name="pose",
    title="where a bore lies in the patient's CT, by its wall",
    signature=(
        "method(sides: tuple[Panorama, ...], ct: CtVolume, plan: Trajectory) -> Located\n"
        "sides: one panorama, or two of one bore, whose θ and z may run either way unless handedness_known and "
        "travel_known say otherwise. The bore lies within 2 mm and 4° of the plan, at any roll, and is not in the CT. "
        "Located (endoct.workbench.bench.tasks.pose) says by side where the axis is at its first and last row, and "
        "which way its θ = 0 points, LPS, mm. Raise Declined where it cannot be told."
    ),
    cases=cases,
    judge=judge,
    ranges=RANGES,
    optional=OPTIONAL,
    scores={
        "target_mm": "error of the point of the axis 5 mm beyond the bore's end, mm",
        "across_mm": "its part across the axis, mm",
        "axis_deg": "angle between the axis and the true one, °",
        "roll_deg": "error of the turn about the axis, °",
        "chi_square": "squared error across the axis over its stated covariance: 2 on average where that is right",
        "inside_95": "share whose stated 95 % ellipse across the axis holds the truth",
    },
    own=own_cases,
    exchange=Exchange(
        write=_write_given,
        read=_read_located,
        answer=_write_located,
    ),
    success=(
        f"an error of less than {SUCCESS_MM:g} mm at the point of the axis {BEYOND_MM:g} mm beyond the bore's end; "
        "where only the true line is known, across it alone"
    ),
)


def ours(sides: tuple[Panorama, ...], ct: CtVolume, plan: Trajectory) -> Located:
    """Find the bore as `endoct pose` does."""
    from endoct.fusion.evidence.side import Side, two_sides
    from endoct.fusion.pose.air import air_around
    from endoct.fusion.pose.finding import find_pose
    from endoct.fusion.pose.observation import observe

    named = two_sides(*sides) if len(sides) == 2 else (Side(sides[0].modality, sides[0]),)
    found = find_pose(air_around(ct, plan), plan, [observe(side) for side in named])
    if found.reason is not None:
        raise Declined(found.reason)
    return located(found.pose, sides)


def located(pose: "BorePose", sides: Sequence[Panorama]) -> Located:
    """Return a pose that was found by ``sides``, in the order of its own."""

    def covariance(place: Coordinates) -> Coordinates:
        x_y, z = pose.bore_to_lps[:3, :2], pose.bore_to_lps[:3, 2]
        stated = pose.axis_covariance(float((place - pose.bore_to_lps[:3, 3]) @ z))
        return np.asarray(x_y @ stated @ x_y.T)

    places = []
    for name, panorama in zip(pose.names, sides, strict=True):
        rows, zeros = panorama.z_mm, np.zeros(panorama.z_mm.size)
        axis = pose.axis_lps(pose.depth_of(name, rows))
        zero = (pose.to_lps(name, zeros, rows, zeros) - axis).mean(axis=0)
        places.append(LocatedSide(axis[[0, -1]], _direction(zero)))
    return Located(tuple(places), covariance)
