"""Rays through air and bone: where they first meet a surface, leave bone, or enter fluid.

The clearance of bore and cells together is a polynomial smooth maximum over each cell's ``edge_mm``, which adds at
most a quarter of it. Rays step by what no surface can be nearer than, but at least ``STEP_MM``. Within such a step the
surface follows from the secant rule. Radial rays go from the bore's axis through the nodes of a wall.
"""

import math
from dataclasses import dataclass, replace
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Mask
from endoct.synthetic.bone.cavities import OWN_SIDE, Cavities, Indices, Near, chosen, clearance, near, sag
from endoct.synthetic.bone.relief import WallGrid
from endoct.synthetic.elementary import Numbers
from endoct.synthetic.sample.parameters import Cell

STEP_MM = 0.004
"""No step is shorter than this."""
BLOCK = 32_000
"""Number of pairs of ray and cell traced at once: what fits a cache."""
STEPS, LOOKS = 10, 16
"""After so many steps few rays are left, and each is looked at in so many places at once: calls cost more than looks.

The number of rays does not decide, so that where a ray ends does not depend on which others are traced with it.
"""
MOST_AT_REST = 0.25
"""Up to this share of rays that have ended is carried along: to sort them out costs as much as a step."""


class BoreAlong(Protocol):
    """The bore without cells, along n rays."""

    def of(self, which: Indices) -> Self:
        """Return the bore along some of the rays."""
        ...

    def at(self, t: Numbers) -> tuple[Numbers, Numbers]:
        """Return the clearance at ``t`` (n,), mm, and the largest rate at which it can fall along the ray."""
        ...


def joined(bore_mm: Numbers, cells_mm: Numbers, edge_mm: Numbers) -> Numbers:
    """Return the clearance of bore (n,) and cells (n, k) together, (n,): rounded at rims, sharp between cells."""
    if not cells_mm.shape[1]:
        return bore_mm
    bore = bore_mm[:, None]
    blend = np.maximum(edge_mm - np.abs(bore - cells_mm), 0)
    return _most(np.maximum(bore, cells_mm) + blend * blend / (4 * edge_mm))


def _most(values: Numbers) -> Numbers:
    """Return the largest of each row of (n, k)."""
    return values[:, 0] if values.shape[1] == 1 else values.max(1)


def first_solid(cells: Cavities, rays: Near, bore: BoreAlong, start: Numbers, limit: Numbers) -> Numbers:
    """Return where rays that are in air at ``start`` (n,) first meet a surface, NaN beyond ``limit`` (n,)."""
    return _first_crossing(cells, rays, bore, start, limit, 1)


def first_air(cells: Cavities, rays: Near, bore: BoreAlong, start: Numbers, limit: Numbers) -> Numbers:
    """Return where rays that are in bone at ``start`` first leave it, NaN beyond ``limit``."""
    return _first_crossing(cells, rays, bore, start + STEP_MM / 2, limit, -1)


def _first_crossing(cells: Cavities, rays: Near, bore: BoreAlong, start: Numbers, limit: Numbers, sign: int) -> Numbers:
    """Return where sign·clearance of rays first falls to 0 between ``start`` and ``limit``, NaN where it does not."""
    crossing = np.full_like(start, math.nan)
    which = np.flatnonzero(start <= limit)
    part, along, t, stop = rays.of(which), bore.of(which), start[which], limit[which]
    last, last_clear = t, np.zeros_like(t)
    ends: list[tuple[NDArray[Any], ...]] = []
    for _ in range(STEPS):
        if not len(which):
            break
        clear, step = _look(cells, part, along, t, sign)
        ahead = t + np.maximum(step, STEP_MM)
        on = (clear > 0) & (ahead < stop)
        if np.count_nonzero(on) >= (1 - MOST_AT_REST) * len(which):
            # those that have ended stay where they are
            last, last_clear = np.where(on, t, last), np.where(on, clear, last_clear)
            t = np.where(on, ahead, t)
            continue
        met, kept = np.flatnonzero(clear <= 0), np.flatnonzero(on)
        ends.append(tuple(values.take(met) for values in (which, last, last_clear, t, clear)))
        last, last_clear, t, stop = (values.take(kept) for values in (t, clear, ahead, stop))
        which = which.take(kept)
        part, along = part.of(kept), along.of(kept)
    while len(which):
        each = np.repeat(np.arange(len(which)), LOOKS)
        further = STEP_MM * np.arange(LOOKS - 1, dtype=t.dtype)
        places = np.concatenate([last[:, None], t[:, None] + further], axis=1)
        looked = _look(cells, part.of(each), along.of(each), places.ravel(), sign)
        clear, step = (values.reshape(-1, LOOKS) for values in looked)
        past = (clear <= 0) & (places <= stop[:, None])
        is_met = past.any(1)
        met = np.flatnonzero(is_met)
        high = past[met].argmax(1)
        pairs = (values[met, at] for at in (np.maximum(high - 1, 0), high) for values in (places, clear))
        ends.append((which[met], *pairs))
        ahead = places[:, -1] + np.maximum(step[:, -1], STEP_MM)
        kept = np.flatnonzero(~is_met & (ahead < stop))
        last, t, stop = (values.take(kept) for values in (places[:, -1], ahead, stop))
        which = which.take(kept)
        part, along = part.of(kept), along.of(kept)
    if ends:
        at, low, at_low, high, at_high = (np.concatenate(parts) for parts in zip(*ends, strict=True))
        middle = _between(low, at_low, high, at_high)
        clear = _look(cells, rays.of(at), bore.of(at), middle, sign)[0]
        short = clear > 0
        low, at_low = np.where(short, middle, low), np.where(short, clear, at_low)
        high, at_high = np.where(short, high, middle), np.where(short, at_high, clear)
        crossing[at] = _between(low, at_low, high, at_high)
    return crossing


def _look(cells: Cavities, rays: Near, bore: BoreAlong, t: Numbers, sign: int) -> tuple[Numbers, Numbers]:
    """Return sign·clearance at ``t``, and how far its sign surely does not change."""
    bore_mm, falls = bore.at(t)
    if not rays.cell.shape[1]:
        return sign * bore_mm, sign * bore_mm / falls
    each = clearance(cells.inverse, rays, t)
    clear = sign * joined(bore_mm, each.air_mm, rays.edge)
    if sign > 0:
        step = np.maximum(bore_mm / falls, _most(each.step_mm))
        # in the rounding of a rim neither bore nor cell, only their joint clearance is positive
        return clear, np.maximum(step, 0.5 * clear * (step <= 0))
    step = -_most(each.step_mm)
    near_rim = bore_mm > -2 * _most(rays.edge)
    return clear, np.where(near_rim, np.minimum(step, 0.5 * clear), step)


def _between(low: Numbers, at_low: Numbers, high: Numbers, at_high: Numbers) -> Numbers:
    """Return where a linear clearance, ``at_low`` > 0 and ``at_high`` ≤ 0, would be 0."""
    return low + np.clip(at_low / np.maximum(at_low - at_high, 1e-12), 0, 1) * (high - low)


def owner_of(cells: Cavities, rays: Near, bore: BoreAlong, t: Numbers) -> tuple[Indices, Mask]:
    """Return 1 + index of the cavity whose surface is at ``t`` (n,), 0 for the bore's, and whether it is dust."""
    nobody = np.zeros(len(t), np.intp)
    if not rays.cell.shape[1]:
        return nobody, nobody > 0
    each = clearance(cells.inverse, rays, t)
    slot = each.air_mm.argmax(1)
    of_cell = chosen(each.air_mm, slot) > bore.at(t)[0]
    number = np.where(of_cell, rays.numbers(slot), 0)
    if each.in_dust is None:
        return number, nobody > 0
    return number, of_cell & chosen(each.in_dust, slot)


def first_fluid(cells: Cavities, rays: Near, start: Numbers, limit: Numbers) -> Numbers:
    """Return where rays enter fluid between ``start`` and ``limit`` (n,), NaN where they do not."""
    surface = cells.fluid[rays.cell].astype(rays.power.dtype)
    nearest = np.full_like(start, math.inf)
    for slot in range(rays.cell.shape[1]):
        level = np.broadcast_to(surface[:, slot], start.shape)
        which = np.flatnonzero(np.isfinite(level))
        if not len(which):
            continue
        one = rays.of(which).alone(slot)
        sinks = one.dw[:, 0] * one.along[:, 0]
        below = sinks > 0
        with np.errstate(divide="ignore", invalid="ignore"):  # a ray along the fluid's surface is above it or below
            plane = (level[which] - one.bulge[:, 0] - one.w[:, 0] * one.along[:, 0]) / sinks
        t = np.where(below, np.maximum(plane, start[which]), start[which])
        stop = np.where(below, limit[which], np.minimum(plane, limit[which]))
        while len(which):
            step = clearance(cells.inverse, one, t).step_mm[:, 0]
            inside = (step > 0) & (t < stop)
            nearest[which[inside]] = np.minimum(nearest[which[inside]], t[inside])
            on = np.flatnonzero(~inside & (t < stop))
            which, t, stop, one = which[on], (t + np.maximum(-step, STEP_MM))[on], stop[on], one.of(on)
    return np.where(np.isfinite(nearest), nearest, math.nan)


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
