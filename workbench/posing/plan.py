"""The CT and the planned trajectory in it, in one world: nothing of its convention is guessed."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from endoct.modalities.ct_volume import SIGNS, Convention, CtVolume, read_ct
from endoct.modalities.markups import Point, read_line
from endoct.modalities.trajectory import Trajectory
from endoct.stitching.errors import EndoctError


@dataclass(frozen=True, eq=False)
class Planned:
    """A CT with the plan in it. ``coordinates``: what the numbers mean that the user states and is told."""

    ct: CtVolume
    plan: Trajectory
    coordinates: Convention


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
    meaning = coordinates or volume.coordinates
    if meaning is None:
        raise EndoctError(
            f"{ct} does not say whether its coordinates are RAS or LPS",
            expected="a 'space' of right-anterior-superior or left-posterior-superior",
            remedy="state --coordinates ras or --coordinates lps",
        )
    if line is not None:
        trajectory, meaning = line[0], coordinates or line[1]
    elif entry_mm is not None and target_mm is not None:
        trajectory = Trajectory(in_world(entry_mm, meaning), in_world(target_mm, meaning))
    _check_inside(volume, trajectory, meaning)
    return Planned(volume, trajectory, meaning)


def in_world(place_mm: Point, coordinates: Convention) -> Point:
    """Return a place of LPS in ``coordinates``, or one of these in LPS: the same signs both ways."""
    x, y, z = (float(sign * value) for sign, value in zip(SIGNS[coordinates], place_mm, strict=True))
    return x, y, z


def _check_inside(ct: CtVolume, plan: Trajectory, coordinates: Convention) -> None:
    size = np.array(ct.voxels.shape)
    for name, place in (("entry", plan.entry_mm), ("target", plan.target_mm)):
        index = (np.array(place) - ct.origin_mm) @ np.linalg.inv(ct.steps_mm)
        if np.all(index >= -0.5) and np.all(index <= size - 0.5):
            continue
        corners = np.stack([ct.origin_mm, ct.origin_mm + (size - 1.0) @ ct.steps_mm]) * SIGNS[coordinates]
        extent = ", ".join(f"{low:.1f} … {high:.1f}" for low, high in np.sort(corners, axis=0).T)
        raise EndoctError(
            f"the {name} lies outside the CT",
            found=", ".join(f"{value:g}" for value in in_world(place, coordinates)),
            expected=f"within {extent} mm ({coordinates.upper()})",
            remedy="check the numbers, and --coordinates",
        )
