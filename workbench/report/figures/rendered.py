"""Figures that are drawn: pictures with what there is to know about them; whoever only writes them draws nothing."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Rendered:
    """A figure as the lossless PNG that lies in figures/ under ``name``, and the WebP copy that a page embeds.

    ``width_in`` is its printed width.
    """

    name: str
    width_in: float
    png: bytes
    webp: bytes

    @property
    def file(self) -> str:
        """The name of its file."""
        return f"{self.name}.png"


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
