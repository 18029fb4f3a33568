"""What depth and light of one wall leave between them: an offset along the bore, and errors that no residual shows."""

from dataclasses import replace

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.numeric.regions import label
from endoct.fusion.evidence.evidence import Evidence, clipped
from endoct.fusion.geometry.alignment import Alignment, as_covariance

LEFT_BY_INSTRUMENTS = 0.002, 0.009, 0.002
"""How far depth and light of one wall still lie apart after perfect alignment: rad, mm, and a share of the scale of z.
Rotation and feed are known no better, and residuals do not show it."""
LEFT_BY_THE_EYE = 0.002, 0.005, 0.0015
"""The same for cells as a learned eye sees them, which end where they do in depth. Seeds 9300–9335 of `quick`, `hard`,
`mastoid`, and of few, floors, sound and tiny of benchmarks/independent set it: 102 pairs."""
LEFT_BY_CELL = 0.02, 0.01
"""How far one cell's middle lies apart in depth and in light, around the bore or along it: mm, and a share of its
width. Its floor slopes, its lining is bright, and its rim is not where either sees it. Residuals do not show that."""
FEW_CELLS = 4.0
"""With so many cells that decide, all of that is √2 times as much: few do not make up for each other's faults."""
ALIKE = 0.8
"""The correlation of depth and light at which that holds. What is left grows as its square falls."""
LEAST_ALIKE = 0.2
"""A correlation below this counts as this.

All of these were set by simulated specimens: `quick`, `mastoid` 100–119, `hard` 100–115, `small-patient` 100–111. Pairs
of a second generator, which shares nothing with them, had a say too. In benchmarks/independent they are few 0–23, sound
0–39, sparse, specks 0–19, tiny, mirrors 0–11, many 0–7."""
UNKNOWN_SLANT = 0.3
"""Standard deviation of the slant of an unknown view: cone mirrors of 36° to 54° have −0.4 to 0.9."""
LEAST_CELL_MM2 = 0.01
LEAST_SPREAD_MM = 0.5
CELL_MM = 0.04
"""A sample with more relief counts as cell when the depth of cells is averaged."""


def corrected_for_instruments(alignment: Alignment, a: Evidence, b: Evidence) -> Alignment:
    """Correct ``alignment`` for the offset that depth and light always have, and widen its covariance by the rest.

    Rays that meet the wall at a slant see a cell's near rim where it is. Before its far rim they see the wall below
    that rim. So the cell's dark part ends early, by what the slant makes of the depth that still counts. Its middle
    lies half of that too near. A learned eye knows that. The scale errs about B's middle.
    """
    light, relief = (b, a) if a.kind == "relief" else (a, b)
    by_eye = light.kind == "probability"
    slant = 0.0 if by_eye else light.slant if light.kind == "darkness" else None
    half_depth_mm = 0.5 * _depth_mm(relief)
    lag_mm = (slant or 0.0) * half_depth_mm
    unknown_mm = UNKNOWN_SLANT * half_depth_mm if slant is None else 0.0
    direction = -1.0 if alignment.z_reversed else 1.0
    shift_mm = lag_mm if light is a else -direction * alignment.z_scale * lag_mm
    alignment = replace(alignment, z_shift_mm=alignment.z_shift_mm + shift_mm)
    if alignment.covariance is None:
        return alignment
    turn_rad, along_mm, of_scale = LEFT_BY_THE_EYE if by_eye else LEFT_BY_INSTRUMENTS
    middle_mm = direction * float(b.z_mm[[0, -1]].mean())
    by_instruments = _covariance_about(middle_mm, turn_rad, float(np.hypot(along_mm, unknown_mm)), of_scale)
    by_cells = _left_by_cells(relief, alignment, of_b=relief is b, unknown_mm=unknown_mm)
    return replace(alignment, covariance=as_covariance(np.array(alignment.covariance) + by_instruments + by_cells))


def _covariance_about(middle_mm: float, turn_rad: float, along_mm: float, of_scale: float) -> Coordinates:
    """Return the covariance of (turn, shift, scale), float64 (3, 3), from independent errors of turn, place and scale.

    ``along_mm`` is the error of the place of ``middle_mm``, on B's z as the alignment's scale multiplies it.
    """
    to_origin = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, -middle_mm], [0.0, 0.0, 1.0]]) * (turn_rad, along_mm, of_scale)
    return np.asarray(to_origin @ to_origin.T)


def _left_by_cells(relief: Evidence, alignment: Alignment, *, of_b: bool, unknown_mm: float) -> Coordinates:
    """Return what :data:`LEFT_BY_CELL` of all cells together adds to the covariance, float64 (3, 3).

    Cells tell where the wall lies where they are; farther along the bore it follows from the scale. ``unknown_mm`` is
    what in addition separates depth and light of each cell along the bore. Cells differ in depth by about as much as
    they are deep, and so in what an unknown slant makes of them.
    """
    labels, n = label(relief.valid & (relief.values > CELL_MM))
    count = np.bincount(labels.ravel(), minlength=n + 1)[1:]
    width_mm = np.sqrt(count * relief.dz_mm * relief.column_mm)
    rims = np.where(width_mm**2 > LEAST_CELL_MM2, width_mm, 0)  # a cell counts by the length of its rim
    if not rims.any():
        return np.zeros((3, 3))
    rows = np.repeat(relief.z_mm[:, np.newaxis], labels.shape[1], axis=1)
    z_mm = np.bincount(labels.ravel(), rows.ravel(), n + 1)[1:] / count
    # on B's z as the scale multiplies it
    z_mm = z_mm * (-1.0 if alignment.z_reversed else 1.0) if of_b else (z_mm - alignment.z_shift_mm) / alignment.z_scale
    middle_mm = float(np.average(z_mm, weights=rims))
    spread_mm = max(float(np.sqrt(np.average((z_mm - middle_mm) ** 2, weights=rims))), LEAST_SPREAD_MM)
    shares = rims / rims.sum()
    off_mm, of_width = LEFT_BY_CELL
    few = float(np.sqrt(1 + FEW_CELLS * (shares**2).sum()))
    unlike = (ALIKE / max(abs(alignment.correlation), LEAST_ALIKE)) ** 2
    around_mm = few * unlike * float(np.linalg.norm(shares * np.hypot(off_mm, of_width * width_mm)))
    along_mm = float(np.hypot(around_mm, np.linalg.norm(shares * unknown_mm)))
    return _covariance_about(middle_mm, around_mm / relief.radius_mm, along_mm, along_mm / spread_mm)


def largest_cell_share(evidence: Evidence) -> float:
    """Return the largest cell's share of the area of all cells that a side's relief shows; 0 without any."""
    if evidence.kind != "relief":
        return 0.0
    labels, n = label(evidence.valid & (evidence.values > CELL_MM))
    area = np.bincount(labels.ravel(), minlength=n + 1)[1:]
    return float(area.max() / area.sum()) if n else 0.0


def _depth_mm(relief: Evidence) -> float:
    """Return how deep cells are on average, up to where more depth says no more."""
    depth_mm = clipped(relief).values[relief.valid]
    cells = depth_mm[depth_mm > CELL_MM]
    return float(cells.mean()) if cells.size else 0.0
