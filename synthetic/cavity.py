"""The shape of the cavities that cells are, in torch: how far a place on a ray is inside one, and how far it stays so.

In coordinates across and along its axis, each divided by its semi-axis, a cavity is N < 1 with
N = (s^p + |w|^p)^(1/p) and s = ρ/outline(φ). Along a ray s changes by at most ``grows`` per mm and w linearly, so
that N^p stays under (s + grows·t)^p + |w + rate·t|^p and a step within that bound never leaves the cavity unseen.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import numpy as np
import torch
from torch import Tensor

from endoct.synthetic.parameters import Cell

P = ParamSpec("P")
T = TypeVar("T")
FIRST_HARMONIC = 2
TABLE = 1024  # directions around a cavity's axis at which its outline is kept; between them linear to 2e-5
OWN_SIDE = 0.3  # cosine: a cavity counts only on its own side of the bore, not where it would leave it opposite
DUST_RIPPLE_MM = 0.004


def in_one_thread(work: Callable[P, T]) -> Callable[P, T]:
    """Have torch use this thread alone meanwhile: arrays that fit a cache lose more by sharing than they gain."""

    @wraps(work)
    def alone(*args: P.args, **kwargs: P.kwargs) -> T:
        before = torch.get_num_threads()
        torch.set_num_threads(1)
        try:
            return work(*args, **kwargs)
        finally:
            torch.set_num_threads(before)

    return alone


@dataclass(frozen=True, eq=False)
class Cavities:
    """All cells of a bore, n of them, as float64 tensors, the last of which is a cavity nothing is in.

    ``centre`` (n, 3): of the widest part, mm; ``axes`` (n, 3, 3): rows u, v and w, unit vectors over
    semi-axes; ``offset`` (n, 3): the centre in them; ``outward`` (n, 3): radial direction where the axis
    meets the wall; ``reach``: radius of a ball about the centre that holds the cavity; ``inverse``
    (n·(TABLE + 1) + 1,): 1/outline in all directions; ``steepest``: Lipschitz factor of s that the outline
    causes; ``power``; ``across``, ``along``: semi-axes, mm; ``edge``, ``bulge``; ``dust``, ``fluid``: depth of
    its surface along the axis, ∞ without.
    """

    centre: Tensor
    axes: Tensor
    offset: Tensor
    outward: Tensor
    reach: Tensor
    inverse: Tensor
    steepest: Tensor
    power: Tensor
    across: Tensor
    along: Tensor
    edge: Tensor
    bulge: Tensor
    dust: Tensor
    fluid: Tensor

    def __len__(self) -> int:
        return int(self.centre.shape[0])


@dataclass(frozen=True, eq=False)
class Near:
    """Rays and the cavities near them, k for each of n rays; all (n, k).

    At t a ray is at u + t·du, v + t·dv, w + t·dw over the semi-axes; ``cell`` int64: index of the cavity.
    ``grows`` and ``fastest``: how much s and N can change per mm. The rest as in :class:`Cavities`.
    """

    u: Tensor
    v: Tensor
    w: Tensor
    du: Tensor
    dv: Tensor
    dw: Tensor
    cell: Tensor
    grows: Tensor
    fastest: Tensor
    power: Tensor
    across: Tensor
    along: Tensor
    edge: Tensor
    bulge: Tensor
    dust: Tensor
    dusty: bool

    def of(self, which: Tensor) -> "Near":
        """Return these for some of the rays only, int64 indices."""
        return self._with(lambda values: values.index_select(values.ndim - 2, which))

    def alone(self, slot: int) -> "Near":
        """Return these with one of the k cavities only."""
        return self._with(lambda values: values[..., slot : slot + 1])

    def _with(self, change: Callable[[Tensor], Tensor]) -> "Near":
        changed: dict[str, Any] = {name: change(v) for name, v in vars(self).items() if isinstance(v, Tensor)}
        return replace(self, **changed)


def cavities(cells: Sequence[Cell], radius_mm: float, device: str = "cpu") -> Cavities:
    """Return the cavities of ``cells`` in a bore of that nominal radius."""
    frames = [frame(cell, radius_mm) for cell in cells]
    nothing = (np.full(3, 1e6), np.eye(3), np.eye(3)[0])
    centre, axes, outward = (np.stack(parts) for parts in zip(*frames, nothing, strict=True))
    angle = 2 * math.pi / TABLE * np.arange(TABLE + 1)
    inverse = np.stack([1 / _outline(cell, angle) for cell in cells] + [np.ones(TABLE + 1)])
    step = np.diff(inverse, axis=1, append=inverse[:, 1:2])
    slope = step * TABLE / (2 * math.pi)
    # a chord's slope and the curve's differ by half a step's change
    steepest = 1.01 * np.sqrt((inverse**2 + slope**2).max(axis=1))
    along = np.array([cell.depth_mm - cell.bulge_mm for cell in cells] + [1.0])
    across = np.array([cell.diameter_mm / 2 for cell in cells] + [1.0])
    longest = across / np.sqrt(np.array([cell.aspect for cell in cells] + [1.0])) / inverse.min(axis=1)
    dust = [cell.fill_mm if cell.filling == "dust" else math.inf for cell in cells] + [math.inf]
    fluid = [cell.fill_mm if cell.filling == "fluid" else math.inf for cell in cells] + [math.inf]

    def tensor(values: object) -> Tensor:
        return torch.as_tensor(np.asarray(values, dtype=np.float64), device=device)

    return Cavities(
        centre=tensor(centre),
        axes=tensor(axes),
        offset=tensor(np.einsum("nij,nj->ni", axes, centre)),
        outward=tensor(outward),
        reach=tensor(np.hypot(longest, along)),
        inverse=tensor(np.append(inverse, 1.0)),
        steepest=tensor(steepest),
        power=tensor([cell.squareness for cell in cells] + [2.0]),
        across=tensor(across),
        along=tensor(along),
        edge=tensor([cell.edge_mm for cell in cells] + [0.005]),
        bulge=tensor([cell.bulge_mm for cell in cells] + [0.0]),
        dust=tensor(dust),
        fluid=tensor(fluid),
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


def _outline(cell: Cell, angle: np.ndarray) -> np.ndarray:
    outline = np.ones_like(angle)
    for k, (cos, sin) in enumerate(cell.outline, FIRST_HARMONIC):
        outline += cos * np.cos(k * angle) + sin * np.sin(k * angle)
    return outline


def near(all_: Cavities, cell: Tensor, origin: Tensor, direction: Tensor, dtype: torch.dtype) -> Near:
    """Return the cavities ``cell`` (n, k) of rays as the tracing wants them, in ``dtype``."""
    at, rate = [], []
    for row in range(3):
        x, y, z = (all_.axes[:, row, axis][cell] for axis in range(3))
        at.append((_dot((x, y, z), origin) - all_.offset[:, row][cell]).to(dtype))
        rate.append(_dot((x, y, z), direction).to(dtype))
    power = all_.power[cell].to(dtype)
    grows = all_.steepest[cell].to(dtype) * torch.hypot(rate[0], rate[1])
    dust = all_.dust[cell].to(dtype)
    return Near(
        **dict(zip(("u", "v", "w"), at, strict=True)),
        **dict(zip(("du", "dv", "dw"), rate, strict=True)),
        cell=cell,
        grows=grows,
        fastest=_norm(grows, rate[2].abs(), power),
        power=power,
        across=all_.across[cell].to(dtype),
        along=all_.along[cell].to(dtype),
        edge=all_.edge[cell].to(dtype),
        bulge=all_.bulge[cell].to(dtype),
        dust=dust,
        dusty=bool(torch.isfinite(dust).any()),
    )


def _dot(row: tuple[Tensor, Tensor, Tensor], vector: Tensor) -> Tensor:
    """Return the scalar products (n, k) of ``row``, its parts (n, k), with vectors (n, 3)."""
    return row[0] * vector[:, 0, None] + row[1] * vector[:, 1, None] + row[2] * vector[:, 2, None]


def _powers(s: Tensor, w: Tensor, power: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return log s, log w (w ≥ 0), s^p and w^p."""
    log_s, log_w = torch.log(s.clamp_min(1e-12)), torch.log(w.clamp_min(1e-12))
    return log_s, log_w, torch.exp(power * log_s), torch.exp(power * log_w)


def _root(total: Tensor, power: Tensor) -> Tensor:
    """Return the logarithm of total^(1/p)."""
    return torch.log(total.clamp_min(1e-30)) / power


def _norm(s: Tensor, w: Tensor, power: Tensor) -> Tensor:
    """Return N = (s^p + w^p)^(1/p)."""
    _, _, s_p, w_p = _powers(s, w, power)
    return torch.exp(_root(s_p + w_p, power))


def local(rays: Near, t: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Return u, v, w over the semi-axes at ``t`` (n,) along the rays, (n, k) each."""
    along = t[:, None]
    u, v, w = (at + along * rate for at, rate in ((rays.u, rays.du), (rays.v, rays.dv), (rays.w, rays.dw)))
    return u, v, w


def outlined(table: Tensor, rays: Near, u: Tensor, v: Tensor) -> Tensor:
    """Return s, 1 on the outline; ``table`` is ``Cavities.inverse`` in the rays' dtype."""
    place = torch.atan2(v, u) * (TABLE / (2 * math.pi))
    place = torch.where(place < 0, place + TABLE, place)
    whole = place.floor()
    first = rays.cell * (TABLE + 1) + whole.long()
    here = torch.take(table, first)
    return torch.hypot(u, v) * (here + (place - whole) * (torch.take(table, first + 1) - here))


def _to_dust(rays: Near, u: Tensor, v: Tensor, w: Tensor) -> Tensor:
    """Return the height above the dust, mm along the axis; its surface is a little uneven."""
    x, y = u * rays.across, v * rays.across
    ripple = torch.sin(61 * x + 2 * torch.sin(37 * y)) * torch.sin(53 * y + 2 * torch.sin(29 * x))
    return rays.dust + DUST_RIPPLE_MM * ripple - (w * rays.along + rays.bulge)


def covers(table: Tensor, rays: Near, t: Tensor) -> Tensor:
    """Return whether the places at ``t`` (n,) are inside the cavities, in their filling or above it, bool (n, k)."""
    u, v, w = local(rays, t)
    return _norm(outlined(table, rays, u, v), w.abs(), rays.power) < 1


@dataclass(frozen=True, eq=False)
class Clearance:
    """How far places on rays are inside cavities, (n, k) each.

    ``air_mm``: distance to the cavity's surface, exact only near it, > 0 inside; ``step_mm``: how far the ray
    surely stays inside (> 0), or surely outside (−); ``in_dust``: the dust bounds it, not the bone.
    """

    air_mm: Tensor
    step_mm: Tensor
    in_dust: Tensor | None


def clearance(table: Tensor, rays: Near, t: Tensor) -> Clearance:
    """Return the clearance of every ray at ``t`` (n,), mm."""
    u, v, w = local(rays, t)
    s = outlined(table, rays, u, v)
    log_s, log_w, s_p, w_p = _powers(s, w.abs(), rays.power)
    log_norm = _root(s_p + w_p, rays.power)
    left = 1 - torch.exp(log_norm)
    # N's derivatives by s and by w, so that left over its gradient is a distance
    by_s = torch.exp((rays.power - 1) * (log_s - log_norm)) / rays.across
    by_w = torch.exp((rays.power - 1) * (log_w - log_norm)) / rays.along
    air = left / torch.sqrt(by_s * by_s + by_w * by_w)
    step = torch.maximum(left / rays.fastest, _stays_inside(rays, s, w, s_p, w_p))
    step = torch.where(left > 0, step, left / rays.fastest)
    if not rays.dusty:
        return Clearance(air, step, None)
    above = _to_dust(rays, u, v, w)
    # the ripple is no steeper than 1 in 2
    sinks = rays.dw.abs() * rays.along + 0.5
    return Clearance(torch.minimum(air, above), torch.minimum(step, above / sinks), above < air)


def _stays_inside(rays: Near, s: Tensor, w: Tensor, s_p: Tensor, w_p: Tensor) -> Tensor:
    """Return how far s^p and |w|^p surely take less than half each of what is left of 1."""
    half = 0.5 * (1 - s_p - w_p).clamp_min(0)
    rate = rays.dw
    most_s, most_w = torch.exp(_root(s_p + half, rays.power)), torch.exp(_root(w_p + half, rays.power))
    return torch.minimum(
        (most_s - s) / rays.grows.clamp_min(1e-9), (most_w - torch.copysign(w, w * rate)) / rate.abs().clamp_min(1e-9)
    )
