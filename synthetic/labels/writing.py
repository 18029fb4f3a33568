"""Writes all labels of a specimen."""

from collections.abc import Callable
from pathlib import Path

from endoct.synthetic.bone.wall import Wall
from endoct.synthetic.labels.cells import write_cells
from endoct.synthetic.labels.endoscope import write_endoscope_labels
from endoct.synthetic.labels.oct import write_oct_labels
from endoct.synthetic.labels.pullback import look_along
from endoct.synthetic.oct.appearance import Appearance
from endoct.synthetic.sample.parameters import Sample


def write_labels(
    folder: Path, sample: Sample, wall: Wall, appearance: Appearance, tell: Callable[[float], None], workers: int
) -> None:
    """Write ``oct.zarr``, ``oct_clean.tif``, ``endoscope.zarr``, ``endoscope_clean/`` and ``cells.csv``.

    The arrays say of themselves what they hold (``long_name``); cells have the ids of ``truth/wall.zarr``.
    """
    folder.mkdir()
    pullback = look_along(sample, wall, workers)
    pixels, seen = write_endoscope_labels(folder, sample, wall, pullback, lambda share: tell(0.5 * share), workers)
    write_oct_labels(folder, sample, wall, appearance, pullback, pixels, lambda share: tell(0.5 + 0.5 * share), workers)
    write_cells(folder / "cells.csv", sample, wall, pullback, seen)
