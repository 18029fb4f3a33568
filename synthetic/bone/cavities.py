"""The cavities of a bore's cells: their places and shapes as arrays, and how far a place on a ray lies inside one.

Coordinates across and along its axis are each divided by its semi-axis. In these a cavity is N < 1 with
N = (s^p + W^p)^(1/p) and s = ρ/outline(φ). W is |w|, or max(w, 0) for a drilled shaft, which is open towards the bore.

Along a ray s changes by at most ``grows`` per mm, and w linearly. So N stays under the norm of s + grows·t and
W(w + rate·t), which is convex in t. A step to where a chord of that bound is 1 never leaves the cavity unseen.
No function of rays is given more than some 32 000 numbers at once, which fit a cache.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

from endoct.base.arrays import Mask
from endoct.synthetic.elementary import Numbers, exp, log
from endoct.synthetic.sample.parameters import Cell

FIRST_HARMONIC = 2
TABLE = 2048
"""An outline is kept in this many directions around its cavity's axis, and is linear between them, to 1e-5.

They are evenly spaced along a square about the axis, as a place on that takes no arctangent.
"""
Indices = NDArray[np.intp]
Scalar = TypeVar("Scalar", bound=np.generic)
OWN_SIDE = 0.3  # A cosine: a cavity counts only on its own side of the bore, not where it would leave it opposite.
DUST_RIPPLE_MM = 0.004


@dataclass(frozen=True, eq=False)
class Cavities:
    """All cells of a bore and last an empty cavity, n in all; float64 but for the table.

    ``centre`` (n, 3): of the widest part, mm; ``axes`` (n, 3, 3): rows u, v and w, unit vectors over
    semi-axes; ``offset`` (n, 3): the centre in them; ``outward`` (n, 3): radial direction where the axis
    meets the wall; ``reach``: radius of a ball about the centre that holds the cavity from where it leaves the
    bore; ``inverse`` float32 (n·(TABLE + 1) + 1,): 1/outline in all directions; ``steepest``: Lipschitz factor of s
    that the outline causes; ``power``; ``closed``: 0 for a shaft, open towards the bore, and 1 otherwise;
    ``across``, ``along``: semi-axes, mm; ``edge``, ``bulge``; ``dust``, ``fluid``: depth of its surface along the
    axis, ∞ without.
    """

    centre: Numbers
    axes: Numbers
    offset: Numbers
    outward: Numbers
    reach: Numbers
    inverse: Numbers
    steepest: Numbers
    power: Numbers
    closed: Numbers
    across: Numbers
    along: Numbers
    edge: Numbers
    bulge: Numbers
    dust: Numbers
    fluid: Numbers

    def __len__(self) -> int:
        return int(self.centre.shape[0])


def cavities(cells: Sequence[Cell], radius_mm: float) -> Cavities:
    """Return the cavities of ``cells`` in a bore of that nominal radius."""
    frames = [frame(cell, radius_mm) for cell in cells]
    nothing = (np.full(3, 1e6), np.eye(3), np.eye(3)[0])
    centre, axes, outward = (np.stack(parts) for parts in zip(*frames, nothing, strict=True))
    place = 4 / TABLE * np.arange(TABLE + 1) - 1
    y = np.where(place > 1, 2 - place, place)
    angle = np.arctan2(y, np.where(place > 1, -1, 1) * (1 - np.abs(y)))
    inverse = np.stack([1 / _outline(cell, angle) for cell in cells] + [np.ones(TABLE + 1)])
    slope = np.diff(inverse, axis=1) / np.diff(np.unwrap(angle))
    slope = np.append(slope, slope[:, :1], axis=1)
    # a chord's slope and the curve's differ by half a step's change
    steepest = 1.01 * np.sqrt((inverse**2 + slope**2).max(axis=1))
    along = np.array([cell.depth_mm - cell.bulge_mm for cell in cells] + [1.0])
    across = np.array([cell.diameter_mm / 2 for cell in cells] + [1.0])
    longest = across / np.sqrt(np.array([cell.aspect for cell in cells] + [1.0])) / inverse.min(axis=1)
    closed = np.array([float(cell.bulge_mm > 0) for cell in cells] + [1.0])
    below = np.array([sag(cell, radius_mm, half) for cell, half in zip(cells, longest[:-1], strict=True)] + [0.0])
    dust = [cell.fill_mm if cell.filling == "dust" else math.inf for cell in cells] + [math.inf]
    fluid = [cell.fill_mm if cell.filling == "fluid" else math.inf for cell in cells] + [math.inf]

    def array(values: object) -> Numbers:
        return np.asarray(values, dtype=np.float64)

    return Cavities(
        centre=array(centre),
        axes=array(axes),
        offset=array(np.einsum("nij,nj->ni", axes, centre)),
        outward=array(outward),
        reach=array(np.hypot(longest, np.maximum(along, (1 - closed) * below))),
        inverse=np.append(inverse, 1.0).astype(np.float32),
        steepest=array(steepest),
        power=array([cell.squareness for cell in cells] + [2.0]),
        closed=array(closed),
        across=array(across),
        along=array(along),
        edge=array([cell.edge_mm for cell in cells] + [0.005]),
        bulge=array([cell.bulge_mm for cell in cells] + [0.0]),
        dust=array(dust),
        fluid=array(fluid),
    )


def frame(cell: Cell, radius_mm: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the cavity's centre (3,), its rows u, v, w over the semi-axes (3, 3), and the radial direction (3,)."""
    cos, sin = math.cos(cell.theta_rad), math.sin(cell.theta_rad)
    outward, around, inward = np.array([cos, sin, 0.0]), np.array([-sin, cos, 0.0]), np.array([0.0, 0.0, 1.0])
    leans = math.cos(cell.lean_direction_rad) * inward + math.sin(cell.lean_direction_rad) * around
    w = math.cos(cell.lean_rad) * outward + math.sin(cell.lean_rad) * leans
    u = math.cos(cell.tilt_rad) * inward + math.sin(cell.tilt_rad) * around
    u = u - (u @ w) * w
    u /= math.sqrt(u @ u)
    v = np.array([u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0]])
    half = cell.diameter_mm / 2
    semi = half / math.sqrt(cell.aspect), half * math.sqrt(cell.aspect), cell.depth_mm - cell.bulge_mm
    centre = radius_mm * outward + cell.z_mm * inward + cell.bulge_mm * w
    return centre, np.stack([u / semi[0], v / semi[1], w / semi[2]]), outward


def sag(cell: Cell, radius_mm: float, half_mm: float) -> float:
    """Return how far along its axis, from the nominal wall towards the bore, a cell's side can still meet the wall.

    ``half_mm``: its largest half width. The wall curves away from the plane across the axis, and that plane leans.
    """
    aside = min(half_mm / math.cos(cell.lean_rad), 0.99 * radius_mm)
    sagitta = radius_mm - math.sqrt(radius_mm**2 - aside**2)
    return (sagitta + half_mm * math.sin(cell.lean_rad)) / math.cos(cell.lean_rad) + 0.05


def _outline(cell: Cell, angle: np.ndarray) -> np.ndarray:
    outline = np.ones_like(angle)
    for k, (cos, sin) in enumerate(cell.outline, FIRST_HARMONIC):
        outline += cos * np.cos(k * angle) + sin * np.sin(k * angle)
    return outline


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
    """Return the value in ``slot`` (n,) of each row of (n, k)."""
    return values[np.arange(len(slot)), slot]


def near(all_: Cavities, cell: Indices, origin: Numbers, direction: Numbers, dtype: DTypeLike) -> Near:
    """Return rays with the cavities ``cell`` near them, (n, k), or (1, k) where all have the same; in ``dtype``."""
    at, rate = [], []
    for row in range(3):
        x, y, z = (all_.axes[:, row, axis][cell] for axis in range(3))
        at.append((_dot((x, y, z), origin) - all_.offset[:, row][cell]).astype(dtype))
        rate.append(_dot((x, y, z), direction).astype(dtype))
    names = "power", "closed", "across", "along", "edge", "bulge", "dust"
    own = {name: getattr(all_, name)[cell].astype(dtype) for name in names}
    grows = all_.steepest[cell].astype(dtype) * np.sqrt(rate[0] * rate[0] + rate[1] * rate[1])
    sinks = np.maximum(rate[2], -own["closed"] * rate[2])
    return Near(
        **dict(zip(("u", "v", "w"), at, strict=True)),
        **dict(zip(("du", "dv", "dw"), rate, strict=True)),
        cell=cell,
        grows=grows,
        sinks=sinks,
        fastest=_parts(grows, sinks, own["power"])[0],
        dusty=bool(np.isfinite(own["dust"]).any()),
        **own,
    )


def _dot(row: tuple[Numbers, Numbers, Numbers], vector: Numbers) -> Numbers:
    """Return the scalar products (n, k) of ``row``, its parts (n, k), with vectors (n, 3)."""
    return row[0] * vector[:, 0, None] + row[1] * vector[:, 1, None] + row[2] * vector[:, 2, None]


def _parts(s: Numbers, w: Numbers, power: Numbers) -> tuple[Numbers, Numbers, Numbers]:
    """Return N = (s^p + w^p)^(1/p), w ≥ 0, and s^p and w^p divided by the larger of the two."""
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
