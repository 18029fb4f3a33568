"""The shape of the cavities that cells are, in torch: how far a place on a ray is inside one, and how far it stays so.

In coordinates across and along its axis, each divided by its semi-axis, a cavity is N < 1 with
N = (s^p + |w|^p)^(1/p) and s = ρ/outline(φ). Along a ray s changes by at most ``grows`` per mm and w linearly, so
that N stays under (s + grows·t)^p + |w + rate·t|^p and a step within that bound never leaves the cavity unseen.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import torch
from torch import Tensor

from endoct.synthetic.parameters import Cell

FIRST_HARMONIC = 2
TABLE = 1024  # directions around a cavity's axis at which its outline is kept; between them linear to 2e-5
OWN_SIDE = 0.3  # cosine: a cavity counts only on its own side of the bore, not where it would leave it opposite
HALVINGS = 3
DUST_RIPPLE_MM = 0.004


@dataclass(frozen=True, eq=False)
class Cavities:
    """All cells of a bore, n of them, as float64 tensors, the last of which is a cavity nothing is in.

    ``centre`` (n, 3): of the widest part, mm; ``axes`` (n, 3, 3): rows u, v and w, unit vectors over
    semi-axes; ``outward`` (n, 3): radial direction where the axis meets the wall; ``reach``: radius of a ball
    about the centre that holds the cavity; ``inverse`` (n·(TABLE + 1), 2): 1/outline and its step to the next
    direction; ``steepest``: Lipschitz factor of s that the outline causes; ``power``; ``across``, ``along``:
    semi-axes, mm; ``edge``, ``bulge``; ``dust``, ``fluid``: depth of its surface along the axis, ∞ without.
    """

    centre: Tensor
    axes: Tensor
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
    """Rays and the cavities near them, k for each of n rays: a ray at t is at ``at`` + t·``rate`` of each.

    ``at``, ``rate`` (3, n, k): u, v, w over the semi-axes; ``cell`` int64 (n, k), index of the cavity.
    """

    at: Tensor
    rate: Tensor
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
        """Return these for some of the rays only."""
        taken = {
            field.name: value[..., which, :] if isinstance(value := getattr(self, field.name), Tensor) else value
            for field in fields(self)
        }
        return Near(**taken)

    def alone(self, slot: int) -> "Near":
        """Return these with one of the k cavities only."""
        taken = {
            field.name: value[..., slot : slot + 1] if isinstance(value := getattr(self, field.name), Tensor) else value
            for field in fields(self)
        }
        return Near(**taken)


def cavities(cells: Sequence[Cell], radius_mm: float, device: str = "cpu") -> Cavities:
    """Return the cavities of ``cells`` in a bore of that nominal radius."""
    frames = [_frame(cell, radius_mm) for cell in cells]
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
        outward=tensor(outward),
        reach=tensor(np.hypot(longest, along)),
        inverse=tensor(np.stack([inverse, step], axis=2).reshape(-1, 2)),
        steepest=tensor(steepest),
        power=tensor([cell.squareness for cell in cells] + [2.0]),
        across=tensor(across),
        along=tensor(along),
        edge=tensor([cell.edge_mm for cell in cells] + [0.005]),
        bulge=tensor([cell.bulge_mm for cell in cells] + [0.0]),
        dust=tensor(dust),
        fluid=tensor(fluid),
    )


def _frame(cell: Cell, radius_mm: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the centre, the rows u, v, w over their semi-axes, and the radial direction."""
    cos, sin = math.cos(cell.theta_rad), math.sin(cell.theta_rad)
    outward, around, inward = np.array([cos, sin, 0]), np.array([-sin, cos, 0]), np.array([0, 0, 1.0])
    leans = math.cos(cell.lean_direction_rad) * inward + math.sin(cell.lean_direction_rad) * around
    w = math.cos(cell.lean_rad) * outward + math.sin(cell.lean_rad) * leans
    u = math.cos(cell.tilt_rad) * inward + math.sin(cell.tilt_rad) * around
    u = u - (u @ w) * w
    u /= np.linalg.norm(u)
    v = np.cross(u, w)
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
    axes, from_centre = all_.axes[cell], origin[:, None, :] - all_.centre[cell]
    at, rate = (
        torch.stack([_dot(axes[:, :, row], vector).to(dtype) for row in range(3)])
        for vector in (from_centre, direction[:, None, :].expand_as(from_centre))
    )
    power = all_.power[cell].to(dtype)
    grows = all_.steepest[cell].to(dtype) * torch.hypot(rate[0], rate[1])
    dust = all_.dust[cell].to(dtype)
    return Near(
        at=at,
        rate=rate,
        cell=cell,
        grows=grows,
        fastest=_norm(grows, rate[2].abs(), power)[0],
        power=power,
        across=all_.across[cell].to(dtype),
        along=all_.along[cell].to(dtype),
        edge=all_.edge[cell].to(dtype),
        bulge=all_.bulge[cell].to(dtype),
        dust=dust,
        dusty=bool(torch.isfinite(dust).any()),
    )


def _dot(a: Tensor, b: Tensor) -> Tensor:
    """Return the scalar product over the last axis, 3 long, in an order no number of threads changes."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def _norm(s: Tensor, w: Tensor, power: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Return N = (s^p + w^p)^(1/p) and its derivatives by s and by w."""
    high, low = torch.maximum(s, w).clamp_min(1e-12), torch.minimum(s, w)
    log_ratio = torch.log((low / high).clamp_min(1e-12))
    stretch = torch.log1p(torch.exp(power * log_ratio)) / power
    by_high = torch.exp((1 - power) * stretch)
    by_low = torch.exp((power - 1) * (log_ratio - stretch))
    s_is_high = s >= w
    return high * torch.exp(stretch), torch.where(s_is_high, by_high, by_low), torch.where(s_is_high, by_low, by_high)


def local(rays: Near, t: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Return u, v, w over the semi-axes at ``t`` (n,) along the rays, (n, k) each."""
    along = t[:, None]
    u, v, w = (rays.at[row] + along * rays.rate[row] for row in range(3))
    return u, v, w


def outlined(table: Tensor, rays: Near, u: Tensor, v: Tensor) -> Tensor:
    """Return s, 1 on the outline; ``table`` is ``Cavities.inverse`` in the rays' dtype."""
    place = torch.atan2(v, u) * (TABLE / (2 * math.pi))
    place = torch.where(place < 0, place + TABLE, place)
    whole = place.floor()
    pair = table[rays.cell * (TABLE + 1) + whole.long()]
    return torch.hypot(u, v) * (pair[..., 0] + (place - whole) * pair[..., 1])


def _to_dust(rays: Near, u: Tensor, v: Tensor, w: Tensor) -> Tensor:
    """Return the height above the dust, mm along the axis; its surface is a little uneven."""
    x, y = u * rays.across, v * rays.across
    ripple = torch.sin(61 * x + 2 * torch.sin(37 * y)) * torch.sin(53 * y + 2 * torch.sin(29 * x))
    return rays.dust + DUST_RIPPLE_MM * ripple - (w * rays.along + rays.bulge)


def covers(table: Tensor, rays: Near, t: Tensor) -> Tensor:
    """Return whether the places at ``t`` (n,) are inside the cavities, in their filling or above it, bool (n, k)."""
    u, v, w = local(rays, t)
    return _norm(outlined(table, rays, u, v), w.abs(), rays.power)[0] < 1


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
    norm, by_s, by_w = _norm(s, w.abs(), rays.power)
    air = (1 - norm) / torch.hypot(by_s / rays.across, by_w / rays.along)
    step = (1 - norm) / rays.fastest
    step = torch.where(norm < 1, _stays_inside(rays, s, w, step), step)
    if not rays.dusty:
        return Clearance(air, step, None)
    above = _to_dust(rays, u, v, w)
    # the ripple is no steeper than 1 in 2
    sinks = rays.rate[2].abs() * rays.along + 0.5
    return Clearance(torch.minimum(air, above), torch.minimum(step, above / sinks), above < air)


def _stays_inside(rays: Near, s: Tensor, w: Tensor, sure: Tensor) -> Tensor:
    """Return a longer step that is sure too, by halving between ``sure`` and where the bound has surely ended."""
    rate = rays.rate[2]
    end = torch.minimum((1 - s) / rays.grows.clamp_min(1e-9), (1 - w * rate.sign()) / rate.abs().clamp_min(1e-9))
    low, high = sure, torch.maximum(sure, end)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        bound = (s + rays.grows * middle).pow(rays.power) + (w + rate * middle).abs().pow(rays.power)
        inside = bound < 1
        low, high = torch.where(inside, middle, low), torch.where(inside, high, middle)
    return low
