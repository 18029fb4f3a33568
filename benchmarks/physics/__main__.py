"""Measure the simulator's physics, draw every figure of docs/results/physics.md and print the table.

    python -m benchmarks.physics [-o docs/figures]

Real recordings are measured too where ENDOCT_RECORDINGS names their folder.
"""

import argparse
import math
import os
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

from benchmarks.light.report import cells
from benchmarks.physics import instrument_plots, plots, realism


def main() -> int:
    """Return 1 if a line of the table is beyond its tolerance."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/figures"))
    folder = parser.parse_args().output
    print(f"{'':64s} {'measured':>10s} {'expected':>10s} {'tolerance':>10s}")
    figures = (
        plots.speckle,
        plots.grain,
        plots.roll_off,
        plots.point_spread,
        plots.attenuation,
        plots.density,
        instrument_plots.speckle_of_bone,
        instrument_plots.focus,
        instrument_plots.reflections,
        plots.cone,
        plots.light,
        cells,
    )
    lines = [
        line
        for figure in (*figures, plots.motion_of_oct, plots.motion_of_endoscope)
        for line in _printed(figure(folder))
    ]
    if recordings := os.environ.get("ENDOCT_RECORDINGS"):
        lines += list(_printed(plots.real_speckle(folder, Path(recordings))))
    failed = sum(not line.holds for line in lines)
    held = sum(not math.isnan(line.expected) for line in lines)
    realism.hard_bscan(folder / "hard_bscan.png")
    realism.paper_frame(folder / "paper_frame.png")
    realism.mastoid(folder / "mastoid.png")
    print(f"{held - failed} of {held} within their tolerance")
    return 1 if failed else 0


def _printed(lines: Iterable[plots.Line]) -> Iterator[plots.Line]:
    for line in lines:
        mark = "" if line.holds else "  beyond"
        numbers = " ".join(f"{value:10.4g}" for value in (line.measured, line.expected, line.tolerance))
        print(f"{line.name:64s} {numbers} {line.unit}{mark}", flush=True)
        yield line


if __name__ == "__main__":
    sys.exit(main())
