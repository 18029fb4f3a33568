"""Figures as another process is asked for them: whoever asks need not load matplotlib, and whoever draws no page."""

from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from endoct.base.compute.worker_process import WorkerProcess
from endoct.stitching.panorama import Panorama
from endoct.workbench.report.figures.rendered import Drawn
from endoct.workbench.report.side_findings import BothSides, SideFindings, alone
from endoct.workbench.running.second_process import beside

if TYPE_CHECKING:
    from endoct.workbench.report.figures.of_both import OfBoth
    from endoct.workbench.report.figures.of_one import Drawing
    from endoct.workbench.report.findings import Findings


@dataclass(frozen=True, eq=False)
class Requested:
    """A figure that another process was asked for, and what draws it here where that has not come to it."""

    drawing: "Drawing"
    there: Future[list[Drawn]] | None

    def result(self) -> list[Drawn]:
        """Return the figure, if there is anything to draw, once it is drawn."""
        return _drawn_here(self.drawing) if self.there is None or self.there.cancel() else self.there.result()


def begin_drawing(panorama: Panorama, process: WorkerProcess | None) -> Future[list[Drawn]]:
    """Have ``process`` draw what can be drawn of a recording before its pictures of frames are there."""
    return beside(process, _draw_wall, alone(panorama, {}))


def begin_drawing_frames(side: SideFindings, process: WorkerProcess | None) -> Future[list[Drawn]]:
    """Have ``process`` draw the pictures of single frames of one recording."""
    return beside(process, _draw_pictures, side)


def begin_drawing_both(both: BothSides, process: WorkerProcess | None, *, with_sides: bool) -> list[Requested]:
    """Have ``process`` draw what can be drawn of a comparison before it is scored, one figure after the other.

    ``with_sides``: also what shows one side by itself.
    """
    from endoct.workbench.report.figures.of_both import drawings_of_sides, drawings_of_wall

    drawings = [*drawings_of_wall(both), *(drawings_of_sides() if with_sides else ())]
    if process is None:
        return [Requested(partial(draw, both), None) for draw in drawings]
    stored = process.store(both)
    return [Requested(partial(draw, both), process.call(_draw_of_both, draw, stored)) for draw in drawings]


def drawn_of(findings: "Findings", requested: Sequence[Requested]) -> list[Drawn]:
    """Return the figures of a comparison: those that are ``requested``, and those of its scores."""
    from endoct.workbench.report.figures.of_both import drawings_of_scores

    scores = [one for drawing in drawings_of_scores(findings) for one in _drawn_here(drawing)]
    # the other process began with the first figure: this one begins with the last
    return [*(one for figure in reversed(requested) for one in figure.result()), *scores]


def _drawn_here(drawing: "Drawing") -> list[Drawn]:
    from endoct.workbench.report.figures import of_one

    return of_one.drawn([drawing])


def _draw_of_both(draw: "OfBoth", both: BothSides) -> list[Drawn]:
    return _drawn_here(partial(draw, both))


def _draw_wall(side: SideFindings) -> list[Drawn]:
    from endoct.workbench.report.figures import of_one

    return of_one.draw_wall(side)


def _draw_pictures(side: SideFindings) -> list[Drawn]:
    from endoct.workbench.report.figures import of_one

    return of_one.draw_pictures(side)
