"""What cells cut out of the wall: radial rays through the nodes of a grid, and how much of the wall is missing."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from endoct.base.arrays import Mask
from endoct.base.errors import EndoctError
from endoct.synthetic.bone.cavities import OWN_SIDE, Cavities, Indices, Near, cavities, covers, near, sag
from endoct.synthetic.bone.relief import WallGrid
from endoct.synthetic.sample.parameters import Bore, Cell, Harmonic

MOST_CELL_FRACTION = 0.295
LEEWAY = 0.02  # beyond a larger fraction that was chosen
STEP_MM = 0.02
COLUMNS = 512


@dataclass(frozen=True)
class Fan:
    """Radial rays to one cavity: from each of some rows, and towards each of some columns of a grid."""

    from_rows: Near
    towards: Near

    def of(self, row: NDArray[np.intp], column: NDArray[np.intp]) -> Near:
        """Return the rays from ``row`` towards ``column``, indices into those rows and columns (n,)."""
        starts = {name: getattr(self.from_rows, name).take(row, axis=0) for name in ("u", "v", "w")}
        changes = ("du", "dv", "dw", "grows", "sinks", "fastest")
        rates = {name: getattr(self.towards, name).take(column, axis=0) for name in changes}
        return replace(self.from_rows, **starts, **rates)


def fan(grid: WallGrid, all_: Cavities, rows: NDArray[np.intp], columns: NDArray[np.intp], number: int) -> Fan:
    """Return the rays from the axis at all ``rows`` towards all ``columns`` of the wall, to one cavity."""
    cell = np.array([[number]])
    from_rows = radial(grid, all_, rows, np.zeros_like(rows), cell)
    return Fan(from_rows, radial(grid, all_, np.zeros_like(columns), columns, cell))


def radial(grid: WallGrid, all_: Cavities, rows: NDArray[np.intp], columns: NDArray[np.intp], cells: Indices) -> Near:
    """Return the rays from the axis through nodes of the wall (n,), with ``cells`` (n, k) or (1, k), float32."""
    theta = 2 * math.pi / grid.n_theta * columns
    heading = np.stack([np.cos(theta), np.sin(theta), np.zeros_like(theta)], axis=1)
    origin = np.zeros_like(heading)
    origin[:, 2] = grid.dz_mm * rows
    return near(all_, cells, origin, heading, np.float32)


def patch(grid: WallGrid, all_: Cavities, cell: Cell, number: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the rows and columns within which radial rays can meet a cavity beyond the wall."""
    centre, outward, axes = (values[number] for values in (all_.centre, all_.outward, all_.axes))
    widest = 1 / float(all_.inverse[:-1].reshape(len(all_), -1)[number].min())
    semi = 1 / np.linalg.norm(axes, axis=1) * np.array([widest, widest, 1.0])
    lowest = (cell.bulge_mm + sag(cell, grid.radius_mm, semi[0])) / semi[2]
    box = axes / np.linalg.norm(axes, axis=1)[:, None] * semi[:, None]
    low_w = -min(1.0, lowest) if cell.bulge_mm > 0 else -lowest
    points = centre + np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (low_w, 1)]) @ box
    margin = cell.edge_mm + 2 * grid.dz_mm
    low, high = points[:, 2].min() - margin, points[:, 2].max() + margin
    rows = np.arange(max(0, math.ceil(low / grid.dz_mm)), min(grid.n_z - 1, math.floor(high / grid.dz_mm)) + 1)
    angle = np.arctan2(points @ np.array([-outward[1], outward[0], 0.0]), np.maximum(points @ outward, 0.05))
    most, slack, step = math.acos(OWN_SIDE), margin / grid.radius_mm, 2 * math.pi / grid.n_theta
    left = cell.theta_rad + max(-most, float(angle.min()) - slack)
    right = cell.theta_rad + min(most, float(angle.max()) + slack)
    return rows, np.arange(math.ceil(left / step), math.floor(right / step) + 1) % grid.n_theta


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
