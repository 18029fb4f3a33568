"""The cells that are drawn with a bore: holes drilled into bone substitute, or a pneumatised mastoid.

In the drilled phantom, holes of several diameters and directions cross the bore. In the mastoid, air cells of many
sizes are widest behind the wall, with thin septa between them. A cell is placed next to an earlier one, at a distance
of about ``septum_mm``. A share ``communicating`` lies so close that the two run into each other. Distances are taken
along the line through the centres.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Mask
from endoct.base.errors import EndoctError
from endoct.synthetic.bone.cavities import cavities, covers, frame
from endoct.synthetic.bone.rays import fan, patch
from endoct.synthetic.bone.relief import WallGrid
from endoct.synthetic.sample.parameters import Bore, Cell, Harmonic

MOST_CELL_FRACTION = 0.295
LEEWAY = 0.02
"""Up to the first is cut away of a wall; where a larger fraction was chosen, up to this much more than that."""
STEP_MM = 0.02
COLUMNS = 512
HOLE_TRIES = 20
"""Number of holes tried for each mm² to be cut away; ten times as many are tried besides."""
MOST_LEAN_RAD = 0.6
CELL_TRIES = 120
"""Number of cells tried for each mm² to be cut away; ten times as many are tried besides."""
SEED_SHARE = 0.12
"""This share of the cells starts a group of its own."""
MEDIAN_OPENING_MM, SPREAD = 0.5, 0.45
"""Openings are log-normal, with this median and this σ of their logarithm."""
SMALLER_AFTER = 12
"""Each time so many tries were in vain, cells are drawn a tenth smaller."""
HARMONICS = 4


def draw_cells(rng: Generator, bore: Bore) -> tuple[Cell, ...]:
    """Draw planted cells until ``bore.cell_fraction`` of the wall is cut away, or at most 0.02 more, never over 0.295.

    Bone in three dimensions and tubes have none. Raises :class:`EndoctError` where there is no room for so many.
    """
    if bore.bone == "phantom":
        return draw_holes(rng, bore)
    return draw_network(rng, bore) if bore.bone == "mastoid" else ()


@dataclass(eq=False)
class CutWall:
    """The wall of a bore while cells are drawn into it: which of its nodes are cut away."""

    bore: Bore
    cells: list[Cell] = field(default_factory=list)

    def __post_init__(self) -> None:
        n_z = max(1, math.floor(self.bore.length_mm / STEP_MM))
        self._grid = WallGrid(n_z, COLUMNS, STEP_MM, self.bore.diameter_mm / 2)
        self._cut: Mask = np.zeros((n_z, COLUMNS), np.bool_)
        self._n_cut = 0

    @property
    def enough(self) -> bool:
        """Whether the wanted part of the wall is cut away."""
        return self._n_cut >= self.bore.cell_fraction * self._cut.size

    def take(self, cell: Cell) -> bool:
        """Cut ``cell`` out unless too much would be missing then; say whether."""
        one = cavities([cell], self._grid.radius_mm)
        rows, columns = patch(self._grid, one, cell, 0)
        if not rows.size:
            return False
        across, around = (index.ravel() for index in np.indices((rows.size, columns.size)))
        rays = fan(self._grid, one, rows, columns, 0).of(across, around)
        row, column = rows[across], columns[around]
        at_wall = np.full(row.size, self._grid.radius_mm, np.float32)
        open_ = covers(one.inverse, rays, at_wall)[:, 0]
        row, column = row[open_], column[open_]
        more = int((~self._cut[row, column]).sum())
        most = max(MOST_CELL_FRACTION, self.bore.cell_fraction + LEEWAY)
        if not row.size or self._n_cut + more > most * self._cut.size:
            return False
        self._cut[row, column] = True
        self._n_cut += more
        self.cells.append(cell)
        return True

    def all_taken(self) -> tuple[Cell, ...]:
        """Return the cells; raise :class:`EndoctError` where they are not enough."""
        if not self.enough:
            raise EndoctError(
                "no room for so many cells",
                found=f"{self._n_cut / self._cut.size:.2f} of the wall cut away",
                expected=f"bore.cell_fraction {self.bore.cell_fraction:.2f}",
                remedy="lower bore.cell_fraction, or bore.septum_mm",
            )
        return tuple(self.cells)


def drawn_outline(rng: Generator, amplitude: float, orders: int) -> tuple[Harmonic, ...]:
    """Draw the harmonics 2, 3, … of an outline; the k-th has an rms of ``amplitude``/k, their sum is below 0.4."""
    order = np.arange(2, 2 + orders)
    outline = amplitude * rng.normal(size=(orders, 2)) / order[:, None]
    outline *= min(1.0, 0.4 / float(np.hypot(*outline.T).sum()))
    return tuple((float(cos), float(sin)) for cos, sin in outline)


def drawn_contents(rng: Generator, bore: Bore, depth_mm: float) -> dict[str, object]:
    """Draw what is in a cell of that depth and how it looks, in the shares that ``bore`` gives."""
    lined, filled, level = rng.random(3)
    under_lining = lined < bore.lining
    edge = rng.uniform(0.06, 0.15) if under_lining else rng.uniform(0.005, 0.02)
    albedo = rng.uniform(0.92, 1.0) if under_lining else rng.uniform(0.55, 0.92)
    rim = rng.uniform(0.2, 0.8) if rng.random() < 0.2 and not under_lining else 0.0
    filling = "dust" if filled < bore.dust else "fluid" if filled < bore.dust + bore.fluid else "air"
    # the level is anywhere from near the brim to near the floor
    fill = {"air": 1.0, "dust": 0.9 * level, "fluid": 0.15 + 0.75 * level}[filling] * depth_mm
    return {
        "edge_mm": float(edge),
        "lining": float(albedo),
        "rim_gain": float(rim),
        "filling": filling,
        "fill_mm": float(fill),
    }


def draw_holes(rng: Generator, bore: Bore) -> tuple[Cell, ...]:
    """Draw holes until the wanted part of the wall is cut away.

    Raises :class:`EndoctError` where it cannot be, after a bounded number of tries.
    """
    wall = CutWall(bore)
    wanted_mm2 = bore.cell_fraction * math.pi * bore.diameter_mm * bore.length_mm
    for _ in range(10 * HOLE_TRIES + math.ceil(HOLE_TRIES * wanted_mm2)):
        if wall.enough:
            break
        wall.take(_hole(rng, bore))
    return wall.all_taken()


def _hole(rng: Generator, bore: Bore) -> Cell:
    opening = float(np.exp(rng.uniform(np.log(0.2), np.log(1.5))))
    depth = float(np.exp(rng.uniform(np.log(0.05), np.log(min(1.5, 1.1 * opening)))))
    # a shallow hole that leans more would leave the wall on one side
    lean = rng.uniform(0, min(MOST_LEAN_RAD, math.atan(1.2 * depth / opening)))
    contents: dict[str, Any] = drawn_contents(rng, bore, depth)
    return Cell(
        z_mm=float(rng.uniform(0, bore.length_mm)),
        theta_rad=float(rng.uniform(0, 2 * np.pi)),
        diameter_mm=max(0.2, opening * math.sqrt(math.cos(lean))),
        depth_mm=depth,
        bulge_mm=0.0,
        aspect=float(rng.uniform(0.85, 1)),
        tilt_rad=float(rng.uniform(0, np.pi)),
        lean_rad=lean,
        lean_direction_rad=float(rng.uniform(0, 2 * np.pi)),
        squareness=float(rng.uniform(5, 12)),
        outline=drawn_outline(rng, 0.08, 6),
        **contents,
    )


def draw_network(rng: Generator, bore: Bore) -> tuple[Cell, ...]:
    """Draw air cells until the wanted part of the wall is cut away.

    Raises :class:`EndoctError` where it cannot be, after a bounded number of tries.
    """
    wall, packed = CutWall(bore), _Packed(bore.diameter_mm / 2)
    wanted_mm2 = bore.cell_fraction * math.pi * bore.diameter_mm * bore.length_mm
    vain = 0
    for _ in range(10 * CELL_TRIES + math.ceil(CELL_TRIES * wanted_mm2)):
        if wall.enough:
            break
        cell = _cell(rng, bore, 0.9 ** (vain / SMALLER_AFTER))
        joins = rng.random() < bore.communicating
        gap = -rng.uniform(0.02, 0.08) if joins else bore.septum_mm * rng.uniform(0.85, 1.15)
        share, direction = rng.random(), rng.uniform(0, 2 * np.pi)
        chosen = int(rng.integers(2**31))
        neighbour = None
        if packed.cells and share > SEED_SHARE:
            neighbour = chosen % len(packed.cells)
            cell = packed.placed_next_to(cell, neighbour, direction, gap)
        fits = 0 <= cell.z_mm <= bore.length_mm and packed.fits(cell, neighbour, 0.8 * bore.septum_mm, gap)
        if fits and wall.take(cell):
            packed.add(cell)
            vain = 0
        else:
            vain += 1
    return wall.all_taken()


def _cell(rng: Generator, bore: Bore, scale: float) -> Cell:
    opening = float(np.clip(scale * MEDIAN_OPENING_MM * np.exp(SPREAD * rng.normal()), 0.2, 1.5))
    squareness = float(rng.uniform(2, 3))
    depth = float(np.clip(opening * np.exp(rng.normal() * 0.4 - 0.1), 0.05, 1.5))
    # how far the widest part is behind the wall, against the semi-axis along the cell
    behind = float(rng.uniform(0, 0.8)) if rng.random() < 0.75 else 0.0
    along = depth / (1 + behind)
    widest = opening / (1 - behind**squareness) ** (1 / squareness)
    contents: dict[str, Any] = drawn_contents(rng, bore, depth)
    return Cell(
        z_mm=float(rng.uniform(0, bore.length_mm)),
        theta_rad=float(rng.uniform(0, 2 * np.pi)),
        diameter_mm=min(2.0, widest),
        depth_mm=depth,
        bulge_mm=depth - along,
        aspect=float(rng.uniform(0.65, 1)),
        tilt_rad=float(rng.uniform(0, np.pi)),
        lean_rad=float(rng.uniform(0, min(0.4, math.atan(depth / opening)))),
        lean_direction_rad=float(rng.uniform(0, 2 * np.pi)),
        squareness=squareness,
        outline=drawn_outline(rng, 0.12, HARMONICS),
        **contents,
    )


class _Packed:
    """The cells put down so far, as arrays."""

    def __init__(self, radius_mm: float) -> None:
        self.radius_mm = radius_mm
        self.cells: list[Cell] = []
        self._centre = np.zeros((16, 3))
        self._axes = np.zeros((16, 3, 3))
        self._power = np.zeros(16)
        self._closed = np.zeros(16)
        self._outline = np.zeros((16, HARMONICS, 2))

    def add(self, cell: Cell) -> None:
        n = len(self.cells)
        if n == len(self._centre):
            for name in ("_centre", "_axes", "_power", "_closed", "_outline"):
                values = getattr(self, name)
                setattr(self, name, np.concatenate([values, np.zeros_like(values)]))
        self._centre[n], self._axes[n], _ = frame(cell, self.radius_mm)
        self._power[n], self._outline[n] = cell.squareness, cell.outline
        self._closed[n] = cell.bulge_mm > 0
        self.cells.append(cell)

    def placed_next_to(self, cell: Cell, neighbour: int, direction_rad: float, gap_mm: float) -> Cell:
        """Return ``cell`` moved along the wall to where it leaves ``gap_mm`` to the neighbour."""
        other = self.cells[neighbour]
        away = (cell.diameter_mm + other.diameter_mm) / 2
        for _ in range(3):
            theta = other.theta_rad + away * math.sin(direction_rad) / self.radius_mm
            moved = {"z_mm": other.z_mm + away * math.cos(direction_rad), "theta_rad": theta % (2 * math.pi)}
            cell = cell.model_copy(update=moved)
            away = min(math.pi, max(0.0, away + gap_mm - float(self._gaps(cell, [neighbour])[0])))
        return cell

    def fits(self, cell: Cell, neighbour: int | None, least_mm: float, gap_mm: float) -> bool:
        """Whether the cell leaves ``least_mm`` to all, and about ``gap_mm`` to the neighbour it was placed next to."""
        n = len(self.cells)
        close = np.flatnonzero(np.abs(self._centre[:n, 2] - cell.z_mm) < 3.0)
        gaps = self._gaps(cell, close)
        if neighbour is not None:
            gap_there = gaps[close == neighbour]
            if not gap_there.size or abs(float(gap_there[0]) - gap_mm) > 0.01:
                return False
            gaps = gaps[close != neighbour]
        return bool(np.all(gaps >= least_mm))

    def _gaps(self, cell: Cell, others: Sequence[int] | NDArray[np.intp]) -> Coordinates:
        """Return the bone between the cell and others along the lines of their centres, mm; < 0 where they overlap."""
        centre, axes, _ = frame(cell, self.radius_mm)
        between = self._centre[others] - centre
        apart = np.linalg.norm(between, axis=1)
        unit = between / np.maximum(apart, 1e-9)[:, None]
        outline = np.asarray(cell.outline)[None]
        own = _reach(axes[None], np.array([cell.squareness]), np.array([float(cell.bulge_mm > 0)]), outline, unit)
        theirs = _reach(self._axes[others], self._power[others], self._closed[others], self._outline[others], -unit)
        gaps: Coordinates = apart - own - theirs
        return gaps


def _reach(
    axes: Coordinates, power: Coordinates, closed: Coordinates, outline: Coordinates, unit: Coordinates
) -> Coordinates:
    """Return how far cavities reach from their centres in the directions ``unit`` (n, 3), mm."""
    u, v, w = np.einsum("nij,nj->in", axes, unit)
    angle = np.arctan2(v, u)
    order = np.arange(2, 2 + outline.shape[1])[None, :] * angle[:, None]
    edge = 1 + np.sum(outline[:, :, 0] * np.cos(order) + outline[:, :, 1] * np.sin(order), axis=1)
    norm = ((np.hypot(u, v) / edge) ** power + np.maximum(w, -closed * w) ** power) ** (1 / power)
    reach: Coordinates = 1 / norm
    return reach
