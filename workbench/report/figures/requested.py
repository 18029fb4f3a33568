"""Figures as another process is asked for them: whoever asks need not load matplotlib, and whoever draws no page."""

from concurrent.futures import Future
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from endoct.stitching.panorama import Panorama
from endoct.stitching.worker_process import WorkerProcess
from endoct.workbench.report.figures.rendered import Drawn
from endoct.workbench.report.side_findings import SideFindings, alone
from endoct.workbench.running.second_process import beside

if TYPE_CHECKING:
    from endoct.workbench.report.figures.of_one import Drawing
    from endoct.workbench.report.findings import Findings


def begin_drawing(panorama: Panorama, process: WorkerProcess | None) -> Future[list[Drawn]]:
    """Have ``process`` draw what can be drawn of a recording before its pictures of frames are there."""
    return beside(process, _draw_wall, alone(panorama, {}))


def draw_pictures(side: SideFindings) -> list[Drawn]:
    """Draw the pictures of single frames of one recording."""
    from endoct.workbench.report.figures import of_one

    return of_one.draw_pictures(side)


def drawings_of(findings: "Findings", *, with_sides: bool) -> "list[Drawing]":
    """Return what draws the figures of a comparison: :func:`endoct.workbench.report.figures.of_both.drawings_of`."""
    from endoct.workbench.report.figures import of_both

    return of_both.drawings_of(findings, with_sides=with_sides)


def drawn(drawing: "Drawing") -> list[Drawn]:
    """Return what ``drawing`` gives, if anything."""
    from endoct.workbench.report.figures import of_one

    return of_one.drawn([drawing])


def make_ready(folder: Path, with_sides: bool) -> None:
    """Read the comparison in ``folder`` for :func:`draw_one`."""
    _drawings_in(folder, with_sides)


def draw_one(folder: Path, with_sides: bool, number: int) -> list[Drawn]:
    """Draw one of the :func:`drawings_of` the comparison in ``folder``."""
    return drawn(_drawings_in(folder, with_sides)[number])


@lru_cache(maxsize=1)
def _drawings_in(folder: Path, with_sides: bool) -> "list[Drawing]":
    """What draws a comparison's figures, read once for all calls of one report: a process serves a single one."""
    from endoct.workbench.report.findings import read_findings

    return drawings_of(read_findings(folder), with_sides=with_sides)


def _draw_wall(side: SideFindings) -> list[Drawn]:
    from endoct.workbench.report.figures import of_one

    return of_one.draw_wall(side)
