"""Panoramas, truth and answers side by side, of specimens of a published set: what the figures of a board look like.

    python -m benchmarks.board_answers DATA/simulator-easy-001 DATA/simulator-hard-001 … -o docs/figures/answers.png

A row a recording, an OCT's by its relief, and one for the wall of both. Found cells are grey where they are true and
red where they are not; missed cells are blue. θ runs to the right, z down.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from endoct.base.arrays import Image, Mask
from endoct.base.errors import EndoctError
from endoct.fusion.scoring.overlap import jaccard
from endoct.workbench.bench.task import AnyTask, load_method
from endoct.workbench.bench.tasks import segmentation, wall

OF_CELLS = "endoct", "chan-vese-prepared", "behind-the-median", "otsu-prepared"
OF_WALLS = "endoct", "believed", "mean-of-distances", "union"
TRUE, WRONG, MISSED, UNKNOWN = (0.55, 0.55, 0.55), (0.84, 0.25, 0.2), (0.15, 0.4, 0.8), (0.85, 0.88, 0.92)
PANEL_IN = 2.6, 1.5


@dataclass(frozen=True, eq=False)
class Row:
    """What is shown of a recording, or of a wall: its panorama, the true cells, where they count, and each answer."""

    name: str
    panorama: Image
    true: Mask
    valid: Mask
    answers: Sequence[tuple[str, Mask | str]]


def rows_of(specimen: Path) -> Iterator[Row]:
    """Yield a row for each of both recordings, then one for their wall."""
    for case in segmentation.own_cases(specimen):
        panorama = case.given
        name = f"{specimen.name}\n{panorama.modality}"
        answers = [(method, _answer(segmentation.TASK, method, panorama)) for method in OF_CELLS]
        shown = panorama.intensity if panorama.depth_mm is None else -panorama.depth_mm
        yield Row(name, shown, case.truth, panorama.valid, answers)
    of_wall = wall.case_of(specimen)
    pair = of_wall.given
    valid = pair.sides.observed[0] & pair.sides.observed[1] & np.isfinite(of_wall.truth.relief_mm)
    walls = [(method, _answer(wall.TASK, method, pair)) for method in OF_WALLS]
    yield Row(f"{specimen.name}\none wall", pair.intensity, of_wall.truth.cell, valid, walls)


def _answer(task: AnyTask, method: str, given: object) -> Mask | str:
    """Return the cells that a method finds, or that it declines."""
    try:
        answer = load_method(task, method)(given)
    except EndoctError:
        return "declined"
    return np.asarray(getattr(answer, "cells", answer))


def picture(rows: Sequence[Row]) -> Figure:
    """Return the rows as a figure."""
    columns = 2 + max(len(row.answers) for row in rows)
    figure = Figure((columns * PANEL_IN[0], len(rows) * PANEL_IN[1]), layout="compressed")
    for k, (row, axes) in enumerate(zip(rows, figure.subplots(len(rows), columns, squeeze=False), strict=True)):
        known = row.panorama[row.valid]
        low, high = np.percentile(known, (1, 99)) if known.size else (0, 1)
        axes[0].imshow(np.where(row.valid, row.panorama, np.nan), cmap="gray", vmin=low, vmax=high, aspect="auto")
        axes[1].imshow(_painted(row.true, row), aspect="auto", interpolation="nearest")
        axes[0].set_ylabel(row.name, fontsize=8)
        for title, axis in zip(("panorama", "truth"), axes, strict=False):
            axis.set_title(title if k == 0 else "", fontsize=8)
        for (method, answer), axis in zip(row.answers, axes[2:], strict=True):
            if isinstance(answer, str):
                axis.set_title(f"{method}: {answer}", fontsize=8)
                continue
            axis.imshow(_painted(answer, row), aspect="auto", interpolation="nearest")
            axis.set_title(f"{method}: {jaccard(answer, row.true, row.valid):.3f}", fontsize=8)
        for axis in axes:
            axis.set(xticks=[], yticks=[])
    return figure


def _painted(answer: Mask, row: Row) -> NDArray[np.float64]:
    painted = np.ones((*answer.shape, 3))
    for where, colour in (
        (answer & row.true, TRUE),
        (answer & ~row.true, WRONG),
        (~answer & row.true, MISSED),
        (~row.valid, UNKNOWN),
    ):
        painted[where] = colour
    return painted


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.board_answers", description=__doc__)
    parser.add_argument("specimens", type=Path, nargs="+")
    parser.add_argument("-o", "--output", type=Path, required=True)
    options = parser.parse_args()
    mpl.use("agg")
    picture([row for specimen in options.specimens for row in rows_of(specimen)]).savefig(options.output, dpi=75)


if __name__ == "__main__":
    main()
