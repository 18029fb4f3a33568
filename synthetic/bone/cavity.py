"""The shape of the cavities that cells are: how far a place on a ray is inside one, and how far it stays so.

In coordinates across and along its axis, each divided by its semi-axis, a cavity is N < 1 with
N = (s^p + W^p)^(1/p), s = ρ/outline(φ) and W = |w|, or max(w, 0) for a drilled shaft, which is open towards the bore.
Along a ray s changes by at most ``grows`` per mm and w linearly, so that N stays under the norm of s + grows·t and
W(w + rate·t), which is convex in t: a step to where a chord of that bound is 1 never leaves the cavity unseen.
No function here is given more than some 32 000 numbers at once, which fit a cache.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

from endoct.base.arrays import Mask
from endoct.synthetic.bone.cavities import TABLE, Cavities
from endoct.synthetic.elementary import Numbers, exp, log

Indices = NDArray[np.intp]
Scalar = TypeVar("Scalar", bound=np.generic)

OWN_SIDE = 0.3  # cosine: a cavity counts only on its own side of the bore, not where it would leave it opposite
DUST_RIPPLE_MM = 0.004


@dataclass(frozen=True, eq=False)
class Near:
    """Rays and the cavities near them, k for each of n rays; all (n, k), or (1, k) where the same for all rays.

    At t a ray is at u + t·du, v + t·dv, w + t·dw over the semi-axes; ``cell`` intp: index of the cavity.
    ``grows``, ``sinks`` and ``fastest``: how much s, W and N can change per mm. The rest as in ``Cavities``.
    """

    u: Numbers
    v: Numbers
    w: Numbers
    du: Numbers
    dv: Numbers
    dw: Numbers
    cell: Indices
    grows: Numbers
    sinks: Numbers
    fastest: Numbers
    power: Numbers
    closed: Numbers
    across: Numbers
    along: Numbers
    edge: Numbers
    bulge: Numbers
    dust: Numbers
    dusty: bool

    def of(self, which: Indices) -> "Near":
        """Return these for some of the rays only."""
        return self._with(lambda values: values if len(values) == 1 else values.take(which, axis=0))

    def alone(self, slot: int) -> "Near":
        """Return these with one of the k cavities only."""
        return self._with(lambda values: values[..., slot : slot + 1])

    def numbers(self, slot: Indices) -> Indices:
        """Return 1 + index of the cavity in each ray's ``slot``, (n,)."""
        return chosen(np.broadcast_to(self.cell, (len(slot), self.cell.shape[1])), slot) + 1

    def _with(self, change: Callable[[NDArray[Any]], NDArray[Any]]) -> "Near":
        changed: dict[str, Any] = {name: change(v) for name, v in vars(self).items() if isinstance(v, np.ndarray)}
        return replace(self, **changed)


def chosen(values: NDArray[Scalar], slot: Indices) -> NDArray[Scalar]:
    """Return of each row of (n, k) the value in its ``slot``, (n,)."""
    return values[np.arange(len(slot)), slot]


def near(all_: Cavities, cell: Indices, origin: Numbers, direction: Numbers, dtype: DTypeLike) -> Near:
    """Return the cavities ``cell`` (n, k), or (1, k) for all, of rays as the tracing wants them, in ``dtype``."""
    at, rate = [], []
    for row in range(3):
        x, y, z = (all_.axes[:, row, axis][cell] for axis in range(3))
        at.append((_dot((x, y, z), origin) - all_.offset[:, row][cell]).astype(dtype))
        rate.append(_dot((x, y, z), direction).astype(dtype))
    power, closed = all_.power[cell].astype(dtype), all_.closed[cell].astype(dtype)
    grows = all_.steepest[cell].astype(dtype) * np.sqrt(rate[0] * rate[0] + rate[1] * rate[1])
    sinks = np.maximum(rate[2], -closed * rate[2])
    dust = all_.dust[cell].astype(dtype)
    return Near(
        **dict(zip(("u", "v", "w"), at, strict=True)),
        **dict(zip(("du", "dv", "dw"), rate, strict=True)),
        cell=cell,
        grows=grows,
        sinks=sinks,
        fastest=_parts(grows, sinks, power)[0],
        power=power,
        closed=closed,
        across=all_.across[cell].astype(dtype),
        along=all_.along[cell].astype(dtype),
        edge=all_.edge[cell].astype(dtype),
        bulge=all_.bulge[cell].astype(dtype),
        dust=dust,
        dusty=bool(np.isfinite(dust).any()),
    )


def _dot(row: tuple[Numbers, Numbers, Numbers], vector: Numbers) -> Numbers:
    """Return the scalar products (n, k) of ``row``, its parts (n, k), with vectors (n, 3)."""
    return row[0] * vector[:, 0, None] + row[1] * vector[:, 1, None] + row[2] * vector[:, 2, None]


def _parts(s: Numbers, w: Numbers, power: Numbers) -> tuple[Numbers, Numbers, Numbers]:
    """Return N = (s^p + w^p)^(1/p), w ≥ 0, and s^p and w^p over the larger of the two."""
    log_s, log_w = log(np.maximum(s, 1e-6)), log(np.maximum(w, 1e-6))
    larger = np.maximum(log_s, log_w)
    s_p, w_p = exp(power * (log_s - larger)), exp(power * (log_w - larger))
    return exp(larger + log(s_p + w_p) / power), s_p, w_p


def _depth(rays: Near, w: Numbers) -> Numbers:
    """Return W: |w|, but 0 on the side of the bore in a shaft."""
    return np.maximum(w, -rays.closed * w)


def local(rays: Near, t: Numbers) -> tuple[Numbers, Numbers, Numbers]:
    """Return u, v, w over the semi-axes at ``t`` (n,) along the rays, (n, k) each."""
    along = t[:, None]
    u, v, w = (at + along * rate for at, rate in ((rays.u, rays.du), (rays.v, rays.dv), (rays.w, rays.dw)))
    return u, v, w


def outlined(table: Numbers, rays: Near, u: Numbers, v: Numbers) -> Numbers:
    """Return s, 1 on the outline; ``table`` is ``Cavities.inverse``."""
    share = v / np.maximum(np.abs(u) + np.abs(v), 1e-30)
    place = (2 - np.copysign(1 - share, u)) * (TABLE / 4)
    whole = np.floor(place)
    first = rays.cell * (TABLE + 1) + whole.astype(np.intp)
    here = table.take(first)
    s: Numbers = np.sqrt(u * u + v * v) * (here + (place - whole) * (table.take(first + 1) - here))
    return s


def _to_dust(rays: Near, u: Numbers, v: Numbers, w: Numbers) -> Numbers:
    """Return the height above the dust, mm along the axis; its surface is a little uneven."""
    x, y = u * rays.across, v * rays.across
    ripple = np.sin(61 * x + 2 * np.sin(37 * y)) * np.sin(53 * y + 2 * np.sin(29 * x))
    above: Numbers = rays.dust + DUST_RIPPLE_MM * ripple - (w * rays.along + rays.bulge)
    return above


def covers(table: Numbers, rays: Near, t: Numbers) -> Mask:
    """Return whether the places at ``t`` (n,) are inside the cavities, in their filling or above it, bool (n, k)."""
    u, v, w = local(rays, t)
    return _parts(outlined(table, rays, u, v), _depth(rays, w), rays.power)[0] < 1


@dataclass(frozen=True, eq=False)
class Clearance:
    """How far places on rays are inside cavities, (n, k) each.

    ``air_mm``: distance to the cavity's surface, exact only near it, > 0 inside; ``step_mm``: how far the ray
    surely stays inside (> 0), or surely outside (−); ``in_dust``: the dust bounds it, not the bone.
    """

    air_mm: Numbers
    step_mm: Numbers
    in_dust: Mask | None


def air_mm(table: Numbers, rays: Near, t: Numbers) -> Numbers:
    """Return the distance to the cavities' surface at ``t`` (n,), > 0 inside, whatever fills them; (n, k), mm."""
    u, v, w = local(rays, t)
    return _air(rays, outlined(table, rays, u, v), w)[0]


def _air(rays: Near, s: Numbers, w: Numbers) -> tuple[Numbers, Numbers]:
    """Return that distance, exact near the surface, and 1 − N."""
    depth = _depth(rays, w)
    norm, s_p, w_p = _parts(s, depth, rays.power)
    left = 1 - norm
    # N's derivatives by s and by w, but for a factor, so that left over its gradient is a distance
    by_s, by_w = s_p / (np.maximum(s, 1e-6) * rays.across), w_p / (np.maximum(depth, 1e-6) * rays.along)
    return left * (s_p + w_p) / (norm * np.sqrt(by_s * by_s + by_w * by_w)), left


def clearance(table: Numbers, rays: Near, t: Numbers) -> Clearance:
    """Return the clearance of every ray at ``t`` (n,), mm."""
    u, v, w = local(rays, t)
    s = outlined(table, rays, u, v)
    air, left = _air(rays, s, w)
    inside = np.maximum(left, 0)
    step = np.maximum(inside / rays.fastest, _stays_inside(rays, s, w, inside)) + np.minimum(left, 0) / rays.fastest
    if not rays.dusty:
        return Clearance(air, step, None)
    above = _to_dust(rays, u, v, w)
    # the ripple is no steeper than 1 in 2
    sinks = np.abs(rays.dw) * rays.along + 0.5
    return Clearance(np.minimum(air, above), np.minimum(step, above / sinks), above < air)


def _stays_inside(rays: Near, s: Numbers, w: Numbers, left: Numbers) -> Numbers:
    """Return how far rays surely stay inside, ``left`` being 1 − N there and 0 outside.

    One of the bound's two parts is 1 first; there its norm is at most 1 + x/p, x the other part's power.
    """
    # a ray that goes up a shaft has all the room that w can give
    room = np.abs(1 - np.copysign(w, w * rays.dw))
    farthest = np.minimum(np.abs(1 - s) / np.maximum(rays.grows, 1e-9), room / np.maximum(rays.sinks, 1e-9))
    other = np.minimum(s + farthest * rays.grows, _depth(rays, w + farthest * rays.dw))
    beyond = exp(rays.power * log(np.maximum(other, 1e-6))) / rays.power
    stays: Numbers = farthest * left / np.maximum(left + beyond, 1e-9)
    return stays
