"""The CT with the planned trajectory in it, in one world: nothing of their convention is guessed."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from endoct.base.errors import EndoctError
from endoct.modalities.ct.ct_volume import CtVolume, check_within, in_world, meaning_of, read_ct, with_label_names
from endoct.modalities.ct.stored import Convention
from endoct.modalities.ct.trajectory import Point, Trajectory, read_line
from endoct.workbench.settings import parse_place

if TYPE_CHECKING:
    from endoct.workbench.requests import PlanRequest


@dataclass(frozen=True, eq=False)
class PlannedBore:
    """A CT with the plan in it, and the ``labels`` of its structures, where there are any.

    ``coordinates``: what the numbers mean that the user states and reads. ``files``: all that were read.
    """

    ct: CtVolume
    plan: Trajectory
    coordinates: Convention
    files: tuple[Path, ...]
    labels: CtVolume | None = None


def read_plan(
    ct: Path, entry_mm: Point | None, target_mm: Point | None, plan: Path | None, coordinates: Convention | None
) -> PlannedBore:
    """Return the CT and the plan: ``entry_mm`` and ``target_mm``, or the markups file ``plan``.

    ``coordinates`` says what ``entry_mm`` and ``target_mm`` mean, and the CT's own numbers where its file does not.
    Left out, they mean what the file of the CT says. Raises :class:`EndoctError` where something cannot be read or is
    not said, or where the plan lies outside the CT.
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
        volume = replace(volume, notes=(*volume.notes, trajectory.note)) if trajectory.note else volume
    elif entry_mm is not None and target_mm is not None:
        trajectory = Trajectory(in_world(entry_mm, meaning), in_world(target_mm, meaning))
    check_within(volume, trajectory, meaning, "the CT")
    files = _files_read(ct, volume)
    return PlannedBore(volume, trajectory, meaning, files if plan is None else (*files, plan))


def read_requested(ct: Path | str, request: "PlanRequest") -> PlannedBore:
    """Return the CT and the plan of a request, as :func:`read_plan`."""
    entry_mm, target_mm = parse_place("entry", request.entry_mm), parse_place("target", request.target_mm)
    plan = None if request.plan is None else Path(request.plan)
    return read_plan(Path(ct), entry_mm, target_mm, plan, request.coordinates)


def with_labels(
    planned: PlannedBore, labels: Path, names: Path | str | None, coordinates: Convention | None
) -> PlannedBore:
    """Return the plan with the segmentation ``labels`` in the world of its CT.

    ``names`` is a table of their names where the file has none, or the word for ours; ``coordinates`` are those of
    :func:`read_plan`. Raises :class:`EndoctError` where something cannot be read.
    """
    named = with_label_names(read_ct(labels, coordinates), names)
    return replace(planned, labels=named, files=(*planned.files, *_files_read(labels, named)))


def _files_read(path: Path, volume: CtVolume) -> tuple[Path, ...]:
    """Return what a volume was read from: the folder ``path``, or the file and those that belong to it."""
    return (path,) if path.is_dir() else volume.files or (path,)
