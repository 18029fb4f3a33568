"""Rays through air and bone: where they first meet a surface, leave bone, or enter fluid.

The clearance of bore and cells together is a polynomial smooth maximum over each cell's ``edge_mm``, which adds at
most a quarter of it. Rays step by what no surface can be nearer than, but at least ``STEP_MM``, within which the
surface is then found by the secant rule.
"""

import math
from typing import Protocol, Self

import torch
from torch import Tensor

from endoct.synthetic.cavity import Cavities, Near, clearance

STEP_MM = 0.004
BLOCK = 32_000  # pairs of a ray and a cell traced at once: what fits a cache, and what torch leaves to one thread
# after so many steps few rays are left: these are looked at in so many places at once, as calls cost more than looks;
# not the number of rays decides, so that where a ray ends does not depend on which others are traced with it
STEPS, LOOKS = 10, 16
MOST_AT_REST = 0.25  # of rays that have ended and are carried along: to sort them out costs as much as a step


class BoreAlong(Protocol):
    """The bore without cells, along n rays."""

    def of(self, which: Tensor) -> Self:
        """Return it for some of the rays only, int64 indices."""
        ...

    def at(self, t: Tensor) -> tuple[Tensor, Tensor]:
        """Return the clearance at ``t`` (n,), mm, and the largest rate at which it can fall along the ray."""
        ...


def joined(bore_mm: Tensor, cells_mm: Tensor, edge_mm: Tensor) -> Tensor:
    """Return the clearance of bore (n,) and cells (n, k) together, (n,): rounded at rims, sharp between cells."""
    if not cells_mm.shape[1]:
        return bore_mm
    bore = bore_mm[:, None]
    blend = (edge_mm - (bore - cells_mm).abs()).clamp_min(0)
    return _most(torch.maximum(bore, cells_mm) + blend * blend / (4 * edge_mm))


def _most(values: Tensor) -> Tensor:
    """Return the largest of each row of (n, k)."""
    return values[:, 0] if values.shape[1] == 1 else values.amax(1)


def first_solid(cells: Cavities, rays: Near, bore: BoreAlong, start: Tensor, limit: Tensor) -> Tensor:
    """Return where rays that are in air at ``start`` (n,) first meet a surface, NaN beyond ``limit`` (n,)."""
    return _first_crossing(cells, rays, bore, start, limit, 1)


def first_air(cells: Cavities, rays: Near, bore: BoreAlong, start: Tensor, limit: Tensor) -> Tensor:
    """Return where rays that are in bone at ``start`` first leave it, NaN beyond ``limit``."""
    return _first_crossing(cells, rays, bore, start + STEP_MM / 2, limit, -1)


def _first_crossing(cells: Cavities, rays: Near, bore: BoreAlong, start: Tensor, limit: Tensor, sign: int) -> Tensor:
    """Return where sign·clearance of rays first falls to 0 between ``start`` and ``limit``, NaN where it does not."""
    found = torch.full_like(start, math.nan)
    which = torch.nonzero(start <= limit)[:, 0]
    part, along, t, stop = rays.of(which), bore.of(which), start[which], limit[which]
    last, last_clear = t, torch.zeros_like(t)
    ends: list[tuple[Tensor, ...]] = []
    for _ in range(STEPS):
        if not len(which):
            break
        clear, step = _look(cells, part, along, t, sign)
        ahead = t + step.clamp_min(STEP_MM)
        on = (clear > 0) & (ahead < stop)
        if int(torch.count_nonzero(on)) >= (1 - MOST_AT_REST) * len(which):
            # those that have ended stay where they are
            last, last_clear = torch.where(on, t, last), torch.where(on, clear, last_clear)
            t = torch.where(on, ahead, t)
            continue
        met, kept = torch.nonzero(clear <= 0)[:, 0], torch.nonzero(on)[:, 0]
        ends.append(tuple(values.index_select(0, met) for values in (which, last, last_clear, t, clear)))
        last, last_clear, t, which, stop = (values.index_select(0, kept) for values in (t, clear, ahead, which, stop))
        part, along = part.of(kept), along.of(kept)
    while len(which):
        each = torch.arange(len(which), device=t.device).repeat_interleave(LOOKS)
        further = STEP_MM * torch.arange(LOOKS - 1, device=t.device, dtype=t.dtype)
        places = torch.cat([last[:, None], t[:, None] + further], 1)
        looked = _look(cells, part.of(each), along.of(each), places.view(-1), sign)
        clear, step = (values.view(-1, LOOKS) for values in looked)
        past = (clear <= 0) & (places <= stop[:, None])
        met, first = torch.nonzero(past.any(1))[:, 0], past.to(torch.int8).argmax(1)
        high = first[met, None]
        pairs = (values[met].gather(1, at) for at in ((high - 1).clamp_min(0), high) for values in (places, clear))
        ends.append((which[met], *(values[:, 0] for values in pairs)))
        ahead = places[:, -1] + step[:, -1].clamp_min(STEP_MM)
        kept = torch.nonzero(~past.any(1) & (ahead < stop))[:, 0]
        last, t, which, stop = (values.index_select(0, kept) for values in (places[:, -1], ahead, which, stop))
        part, along = part.of(kept), along.of(kept)
    if ends:
        at, low, at_low, high, at_high = (torch.cat(parts) for parts in zip(*ends, strict=True))
        middle = _between(low, at_low, high, at_high)
        clear = _look(cells, rays.of(at), bore.of(at), middle, sign)[0]
        short = clear > 0
        low, at_low = torch.where(short, middle, low), torch.where(short, clear, at_low)
        high, at_high = torch.where(short, high, middle), torch.where(short, at_high, clear)
        found[at] = _between(low, at_low, high, at_high)
    return found


def _look(cells: Cavities, rays: Near, bore: BoreAlong, t: Tensor, sign: int) -> tuple[Tensor, Tensor]:
    """Return sign·clearance at ``t``, and how far its sign surely does not change."""
    bore_mm, falls = bore.at(t)
    if not rays.cell.shape[1]:
        return sign * bore_mm, sign * bore_mm / falls
    each = clearance(cells.inverse, rays, t)
    clear = sign * joined(bore_mm, each.air_mm, rays.edge)
    if sign > 0:
        step = torch.maximum(bore_mm / falls, _most(each.step_mm))
        # in the rounding of a rim neither bore nor cell, only their joint clearance is positive
        return clear, torch.maximum(step, 0.5 * clear * (step <= 0))
    step = -_most(each.step_mm)
    near_rim = bore_mm > -2 * _most(rays.edge)
    return clear, torch.where(near_rim, torch.minimum(step, 0.5 * clear), step)


def _between(low: Tensor, at_low: Tensor, high: Tensor, at_high: Tensor) -> Tensor:
    """Return where a clearance that is ``at_low`` > 0 and ``at_high`` ≤ 0 is 0, were it linear."""
    return low + (at_low / (at_low - at_high).clamp_min(1e-12)).clamp(0, 1) * (high - low)


def owner_of(cells: Cavities, rays: Near, bore: BoreAlong, t: Tensor) -> tuple[Tensor, Tensor]:
    """Return 1 + index of the cavity whose surface is at ``t`` (n,), 0 for the bore's, and whether it is dust."""
    nobody = torch.zeros(len(t), dtype=torch.int32, device=t.device)
    if not rays.cell.shape[1]:
        return nobody, nobody > 0
    each = clearance(cells.inverse, rays, t)
    nearest, slot = each.air_mm.max(1)
    of_cell = nearest > bore.at(t)[0]
    number = torch.where(of_cell, rays.numbers(slot), 0).to(torch.int32)
    if each.in_dust is None:
        return number, nobody > 0
    return number, of_cell & each.in_dust.gather(1, slot[:, None])[:, 0]


def first_fluid(cells: Cavities, rays: Near, start: Tensor, limit: Tensor) -> Tensor:
    """Return where rays enter fluid between ``start`` and ``limit`` (n,), NaN where they do not."""
    surface = cells.fluid[rays.cell].to(rays.power.dtype)
    found = torch.full_like(start, math.inf)
    for slot in range(rays.cell.shape[1]):
        level = surface[:, slot].expand(len(start))
        which = torch.nonzero(torch.isfinite(level))[:, 0]
        if not len(which):
            continue
        one = rays.of(which).alone(slot)
        sinks = one.dw[:, 0] * one.along[:, 0]
        plane = (level[which] - one.bulge[:, 0] - one.w[:, 0] * one.along[:, 0]) / sinks
        below = sinks > 0
        t = torch.where(below, torch.maximum(plane, start[which]), start[which])
        stop = torch.where(below, limit[which], torch.minimum(plane, limit[which]))
        while len(which):
            step = clearance(cells.inverse, one, t).step_mm[:, 0]
            inside = (step > 0) & (t < stop)
            found[which[inside]] = torch.minimum(found[which[inside]], t[inside])
            on = torch.nonzero(~inside & (t < stop))[:, 0]
            which, t, stop, one = which[on], (t + (-step).clamp_min(STEP_MM))[on], stop[on], one.of(on)
    return torch.where(torch.isfinite(found), found, math.nan)
