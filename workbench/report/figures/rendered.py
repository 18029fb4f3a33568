"""Figures as they are begun, handed on and written: whoever does no more than that draws nothing.

The second process draws while this one goes on. What draws is named only, so that neither whoever has a figure drawn
nor whoever writes a page loads matplotlib.
"""

import base64
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from endoct.stitching.panorama import Panorama
from endoct.workbench.report.side_findings import BothSides, SideFindings, alone
from endoct.workbench.running.scheduler import Named, PendingCall, Scheduler

if TYPE_CHECKING:
    from endoct.workbench.report.findings import Findings

FIGURES, _FINDINGS = "endoct.workbench.report.figures.of_report", "endoct.workbench.report.figures.agreement"
"""The modules that draw, and bring matplotlib; the second also brings what findings need, for a comparison alone."""


@dataclass(frozen=True)
class Rendered:
    """A figure as the lossless PNG that lies in figures/ under ``name``, and as a page embeds it.

    ``width_in`` is its printed width; ``jpeg`` a copy for the page, None where the PNG is small enough itself.
    """

    name: str
    width_in: float
    png: bytes
    jpeg: bytes | None

    @property
    def file(self) -> str:
        """The name of its file."""
        return f"{self.name}.png"

    @property
    def embedded(self) -> str:
        """What a page embeds, as a URL that holds all of it."""
        kind, data = ("png", self.png) if self.jpeg is None else ("jpeg", self.jpeg)
        return f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"


@dataclass(frozen=True)
class Drawn:
    """One figure of a report: how it looks, what it is called and what there is to know when reading it.

    ``section`` groups figures.
    """

    rendered: Rendered
    section: str
    title: str
    caption: str


def write_figures(drawn: Iterable[Drawn], folder: Path) -> None:
    """Write figures as PNG into a new ``folder``."""
    folder.mkdir()
    for one in drawn:
        (folder / one.rendered.file).write_bytes(one.rendered.png)


Figures = PendingCall[list[Drawn]]
Drawing = Callable[[], Drawn | None]
OfBoth = Callable[[BothSides], Drawn | None]
"""A function of a module, which another process can be asked to call."""

_draw_wall: Callable[[SideFindings], list[Drawn]] = Named(f"{FIGURES}:draw_wall")
_draw_pictures: Callable[[SideFindings], list[Drawn]] = Named(f"{FIGURES}:draw_pictures")
_draw_sides: Callable[[Path, Sequence[str]], list[Drawn]] = Named(f"{FIGURES}:draw_sides")
_draw_both: Callable[[OfBoth, BothSides], list[Drawn]] = Named(f"{FIGURES}:draw_both")
_drawings_of_both: Callable[[bool], list[OfBoth]] = Named(f"{FIGURES}:drawings_of_both")
_drawn: Callable[[Iterable[Drawing]], list[Drawn]] = Named(f"{FIGURES}:drawn")
_of_findings: Callable[["Findings"], list[Drawing]] = Named(f"{_FINDINGS}:drawings_of_findings")


def begin_wall(panorama: Panorama, scheduler: Scheduler) -> Figures:
    """Begin what can be drawn of a recording before its pictures of frames are there."""
    return scheduler.begin(_draw_wall, alone(panorama, {}))


def begin_pictures(side: SideFindings, scheduler: Scheduler) -> Figures:
    """Begin the pictures of single frames of one recording."""
    return scheduler.begin(_draw_pictures, side)


def begin_sides(folder: Path, names: Sequence[str], scheduler: Scheduler) -> Figures:
    """Begin the figures of each side by itself; both will be stored in the ``folder`` of their comparison by then."""
    return scheduler.begin(_draw_sides, folder, names)


def begin_both(both: BothSides, scheduler: Scheduler, *, with_sides: bool) -> list[Figures]:
    """Begin what can be drawn of a comparison before it is scored, one figure after the other.

    ``with_sides``: also what shows one side by itself.
    """
    sent = scheduler.send(both)
    return [scheduler.begin(_draw_both, draw, sent) for draw in _drawings_of_both(with_sides)]


def drawn_of(findings: "Findings", begun: Sequence[Figures]) -> list[Drawn]:
    """Return the figures of a comparison: those that were ``begun``, and those of its scores."""
    scores = _drawn(_of_findings(findings))
    # the second process began with the first figure: this one begins with the last
    return [*(one for figures in reversed(begun) for one in figures.result_of_either()), *scores]
