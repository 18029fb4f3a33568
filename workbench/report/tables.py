"""What the tables of a report say of overlaps and of either side."""

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from endoct.fusion.result import Result, Threshold
from endoct.stitching.grid import SurfaceGrid
from endoct.workbench.report.findings import Findings, NamedOverlap
from endoct.workbench.report.side_findings import SideFindings
from endoct.workbench.report.wording import NOTHING, area_text, count_text, share_text, without_stop

OVERLAP_COLUMNS: Mapping[str, Callable[[NamedOverlap], str]] = {
    "Jaccard": lambda named: share_text(named.overlap.jaccard),
    "Dice": lambda named: share_text(named.overlap.dice),
    "Both": lambda named: area_text(named.overlap.both_mm2),
    "Only one": lambda named: _only_one(named),
    "Neither": lambda named: area_text(named.overlap.neither_mm2),
    "Places": lambda named: count_text(named.overlap.sites),
}
ALWAYS = ("Jaccard", "Dice")
"""Columns that are there also where nothing is known."""


def side_table(findings: Findings) -> tuple[list[str], list[list[str]]]:
    """Return header and rows of what there is to say of either side."""
    columns = [_side_facts(side, findings.result) for side in findings.sides]
    rows = [[name, *(column[name] for column in columns)] for name in columns[0]]
    return ["", *(side.name for side in findings.sides)], rows


def overlap_table(overlaps: Sequence[NamedOverlap]) -> tuple[list[str], list[list[str]]]:
    """Return header and rows of ``overlaps``, without columns of which nothing is known."""
    columns = {title: [text(named) for named in overlaps] for title, text in OVERLAP_COLUMNS.items()}
    columns = {title: cells for title, cells in columns.items() if title in ALWAYS or set(cells) != {NOTHING}}
    names = [f"{named.of[0]} and {named.of[1]}, {named.where}" for named in overlaps]
    return ["", *columns], [list(row) for row in zip(names, *columns.values(), strict=True)]


def conditions(result: Result, grid: SurfaceGrid) -> str:
    """Return on which grid two sides were compared, and by what their cells were segmented."""
    thresholds = result.threshold or {}
    parts = [
        f"Common grid: {grid.n_z} × {grid.n_theta} samples (z × θ), {grid.dz_mm * 1000:.3g} µm along the bore and "
        f"{grid.dtheta_mm * 1000:.3g} µm around it at a bore radius of {grid.radius_mm:.3f} mm."
    ]
    parts += [f"Cells of {side}: {threshold_text(thresholds[side])}." for side in result.sides if side in thresholds]
    return " ".join(parts)


def threshold_text(threshold: Threshold | None) -> str:
    """Return what cells were segmented by: "wall relief, capped at 0.4 mm, above 0.03 mm"."""
    if threshold is None:
        return NOTHING
    of = without_stop(threshold.of) or "as given"
    unit = f" {threshold.unit}" if threshold.unit not in (None, "", "1") else ""
    return of if threshold.value is None else f"{of}, above {threshold.value:.3g}{unit}"


def _only_one(named: NamedOverlap) -> str:
    """Return "endoscope 0.47 mm², oct 0.21 mm²"."""
    areas = zip(named.of, (named.overlap.only_a_mm2, named.overlap.only_b_mm2), strict=True)
    known = [f"{name} {area_text(area)}" for name, area in areas if area is not None]
    return ", ".join(known) or NOTHING


def _side_facts(side: SideFindings, result: Result) -> dict[str, str]:
    panorama = side.panorama
    cells = float(side.mask[side.valid].mean()) if side.valid.any() else math.nan
    depth = NOTHING
    if side.depth_mm is not None:
        low, high = (float(v) for v in np.nanpercentile(side.depth_mm[side.valid], (5, 95)))
        depth = f"{low:.3f} to {high:.3f} mm".replace("-", "−")
    frames = side.frame_z_mm.size
    return {
        "Recorded": f"{frames} {panorama.frame_dim}{'s' if frames != 1 else ''}" if frames else NOTHING,
        "Own panorama, z × θ": f"{panorama.grid.n_z} × {panorama.grid.n_theta} samples",
        "Observed of its own panorama": f"{panorama.valid.mean():.1%}",
        "Observed of the common grid": f"{side.valid.mean():.1%}",
        "Cells, of the wall it observed": f"{cells:.1%}" if math.isfinite(cells) else NOTHING,
        "Depth, 5th to 95th percentile": depth,
        "Cells segmented by": threshold_text((result.threshold or {}).get(side.name)),
        "Cells look": (result.polarity or {}).get(side.name) or NOTHING,
    }
