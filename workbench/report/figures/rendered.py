"""Figures that are drawn: pictures with what there is to know about them; whoever only writes them draws nothing."""

import base64
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

FIGURES = "endoct.workbench.report.figures.of_report"
"""The module that draws, and brings matplotlib."""


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
