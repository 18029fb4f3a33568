"""Writes all labels of a specimen."""

from pathlib import Path

from endoct.synthetic.labels.cells import write_cells
from endoct.synthetic.labels.endoscope import write_endoscope_labels
from endoct.synthetic.labels.oct import write_oct_labels
from endoct.synthetic.labels.pullback import look_along
from endoct.synthetic.model import Model
from endoct.synthetic.progress import Advance


def write_labels(folder: Path, model: Model, advance: Advance, workers: int) -> None:
    """Write ``oct.zarr``, ``oct_clean.tif``, ``endoscope.zarr``, ``endoscope_clean/`` and ``cells.csv``.

    The arrays say of themselves what they hold (``long_name``); cells have the ids of ``truth/wall.zarr``.
    """
    folder.mkdir()
    pullback = look_along(model, workers)
    pixels, per_cell = write_endoscope_labels(folder, model, pullback, lambda share: advance(share / 2), workers)
    write_oct_labels(folder, model, pullback, pixels, lambda share: advance((1 + share) / 2), workers)
    write_cells(folder / "cells.csv", model, pullback, per_cell)
