"""The sides of which a bore's pose is found: recordings, panoramas, sides of comparisons."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from endoct.base.errors import EndoctError
from endoct.fusion.evidence.side import DrawnMask, Side, two_sides
from endoct.stitching.panorama import Panorama
from endoct.workbench.kinds import is_comparison
from endoct.workbench.pipeline.sources import Opened, Ready, Source, open_both, open_source, unroll_sources
from endoct.workbench.pipeline.unrolling import Recording, Unrolled, unroll_recording
from endoct.workbench.running.progress import Stages
from endoct.workbench.running.scheduler import Scheduler

MOST_SIDES = 2
EXPECTED = "a recording, a panorama, or one side of a comparison as DIR:SIDE"


def open_sides(sources: Sequence[Source]) -> tuple[Opened, ...]:
    """Open one source or two. Raises :class:`EndoctError` where one cannot be used, or both are one."""
    if not 1 <= len(sources) <= MOST_SIDES:
        raise EndoctError(
            "a pose is found by one side or two",
            found=f"{len(sources)} sides",
            remedy="" if sources else "name a recording, or ask before there is one with --plan-only",
        )
    opened = open_both((sources[0], sources[1])) if len(sources) == MOST_SIDES else (open_source(sources[0]),)
    for source, one in zip(sources, opened, strict=True):
        if isinstance(one, DrawnMask | Path):
            raise EndoctError(f"{source.path} is a mask drawn by hand", expected=EXPECTED)
    return opened


def make_sides(opened: Sequence[Opened], stages: Stages, scheduler: Scheduler) -> tuple[Side, ...]:
    """Return the sides, with recordings unrolled, two of them at the same time where there is a second process."""
    if len(opened) == MOST_SIDES:
        return two_sides(*(_panorama(one) for one in unroll_sources((opened[0], opened[1]), stages, scheduler)))
    only = opened[0]
    panorama = _panorama(unroll_recording(only, stages) if isinstance(only, Recording) else only)
    return (Side(panorama.modality, panorama),)


def side_of_comparison(source: Source) -> Source:
    """Return the panorama that ``DIR:SIDE`` names in the comparison ``DIR``; any other source as it is.

    Raises :class:`EndoctError` where the comparison has no such side, or only ``DIR`` is named.
    """
    if source.path is None:
        return source
    if is_comparison(source.path):
        names = ", ".join(f"{source.path}:{name}" for name in _names(source.path))
        raise EndoctError(f"{source.path} is a comparison of two sides", expected=names, remedy="name one of them")
    folder, _, name = str(source.path).rpartition(":")
    if source.path.exists() or not folder or not is_comparison(Path(folder)):
        return source
    if name not in (names_there := _names(Path(folder))):
        expected = ", ".join(names_there) or "panoramas in it"
        raise EndoctError(f"the comparison {folder} has no such side", found=name, expected=expected)
    return replace(source, given=Path(folder) / "panoramas" / f"{name}.zarr")


def _names(folder: Path) -> list[str]:
    return sorted(path.stem for path in (folder / "panoramas").glob("*.zarr"))


def _panorama(made: Ready) -> Panorama:
    if isinstance(made, Unrolled):
        return made.panorama
    if isinstance(made, Panorama):
        return made
    raise TypeError(f"{type(made).__name__} is no side of a pose")
