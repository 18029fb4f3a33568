"""The folder of a comparison: of each side its panorama, pictures of its frames and figures; the result; a report.

What a step has made is stored and drawn while the next ones are done.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from endoct.fusion.evidence.side import Side
from endoct.fusion.files.cell_table import write_cells
from endoct.fusion.files.store import save_comparison
from endoct.fusion.sides import Comparison, Placed
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import save_panorama
from endoct.workbench.pipeline.hand_masks import Against, write_drawings, write_mask
from endoct.workbench.pipeline.inputs import json_text
from endoct.workbench.pipeline.unrolled_store import copy_sample_frames, save_sample_frames
from endoct.workbench.pipeline.unrolling import Unrolled
from endoct.workbench.report.figures.rendered import FIGURES, Figures, begin_both, begin_sides
from endoct.workbench.report.findings import both_sides, findings_of
from endoct.workbench.running.scheduler import Scheduler, Task

REPORT = "endoct.workbench.page.report", FIGURES
"""Modules that a report needs: loaded while there is nothing else to do, since they bring matplotlib."""

Pictured = Unrolled | Path | None
"""What pictures of a side's frames come from: the recording as it was unrolled, or the store of a panorama."""


@dataclass(frozen=True, eq=False)
class ComparisonFolder:
    """A folder that is being written; ``stored`` and ``figures`` have been begun."""

    path: Path
    sides: tuple[Side, Side]
    scheduler: Scheduler
    stored: list[Task[None]] = field(default_factory=list)
    figures: list[Figures] = field(default_factory=list)

    def begin(self, pictured: Sequence[Pictured]) -> None:
        """Make the folder, and begin to store and draw each side: that does not depend on how they are aligned."""
        self.path.mkdir()
        for side, of in zip(self.sides, pictured, strict=True):
            self.stored.append(self.scheduler.begin(store_side, self.path, side.name, side.panorama, of))
        self.figures.append(begin_sides(self.path, [side.name for side in self.sides], self.scheduler))

    def draw(self, placed: Placed) -> None:
        """Begin the figures of both sides as they were ``placed``: scores are computed meanwhile."""
        panoramas = [side.panorama for side in self.sides]
        both = both_sides(placed.grid, placed.sides, panoramas, {}, aligned=placed.aligned)
        self.figures.extend(begin_both(both, self.scheduler, with_sides=False))

    def write(self, comparison: Comparison, against: Against) -> None:
        """Write the comparison, its cells, and the masks it was held ``against``."""
        save_comparison(comparison, self.path / "comparison.zarr")
        write_cells(comparison.cells, self.path / "cells.csv")
        if against.consensus is not None:
            write_mask(against.consensus, comparison.grid, self.path / "consensus.png")
        write_drawings(against, comparison.grid, self.path)
        for task in self.stored:
            task.result()

    def write_result(self, comparison: Comparison) -> None:
        """Write ``result.json``."""
        text = json_text(comparison.result.to_json())
        (self.path / "result.json").write_text(text + "\n", encoding="utf-8")

    def write_report(self, comparison: Comparison) -> None:
        """Write the page and its figures; all else is there."""
        from endoct.workbench.page.report import write_comparison_report  # was loaded while sides were unrolled

        findings = findings_of(comparison, [side.panorama for side in self.sides], {})
        write_comparison_report(self.path, findings, self.figures)


def store_side(folder: Path, name: str, panorama: Panorama, pictured: Pictured) -> None:
    """Write the panorama of a side and pictures of its frames into the ``folder`` of a comparison."""
    save_panorama(panorama, folder / "panoramas" / f"{name}.zarr")
    if isinstance(pictured, Unrolled):
        save_sample_frames(pictured, folder, name)
    elif pictured is not None:
        copy_sample_frames(pictured, folder, name)
