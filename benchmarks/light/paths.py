"""Follows photons through a bore with one drilled cell, by brute force: no radiance is cached, nothing is interpolated.

The bore is an endless cylinder about z, the cell a round shaft with a flat floor, drilled from the bore along +x at
z = 0. Both are given by their equations, and the air is their union. A photon that meets bone is counted there, and
goes on in a direction drawn from the cosine law, with ``albedo`` of its weight. Lengths are in mm. Nothing of the
renderer is used.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

Vectors = NDArray[np.float64]
"""(n, 3)."""
Numbers = NDArray[np.float64]
"""(n,)."""
LEAST_WEIGHT = 2e-3
AHEAD_MM = 1e-7
WALL, SIDE, FLOOR = range(3)


@dataclass(frozen=True)
class Bone:
    """A bore of ``radius_mm`` with a shaft ``width_mm`` across, its floor ``depth_mm`` behind the wall at its axis.

    Without a depth there is no shaft.
    """

    radius_mm: float = 1.25
    width_mm: float = 0.6
    depth_mm: float = 0.0

    @property
    def floor_mm(self) -> float:
        """Distance of the floor from the bore's axis."""
        return self.radius_mm + self.depth_mm


@dataclass(frozen=True, eq=False)
class Met:
    """Where photons met bone: ``place`` and the normal into air, (n, 3), and ``kind``: WALL, SIDE or FLOOR."""

    place: Vectors
    normal: Vectors
    kind: NDArray[np.intp]


def meet(bone: Bone, start: Vectors, way: Vectors) -> Met:
    """Return where rays that start in air first meet bone."""
    bore = _through_cylinder(start[:, 0], start[:, 1], way[:, 0], way[:, 1], bone.radius_mm)
    shaft = _through_cylinder(start[:, 1], start[:, 2], way[:, 1], way[:, 2], bone.width_mm / 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack([-start[:, 0] / way[:, 0], (bone.floor_mm - start[:, 0]) / way[:, 0]])
    slab = np.where(way[:, 0] >= 0, ends, ends[::-1])
    shaft_in, shaft_out = np.maximum(shaft[0], slab[0]), np.minimum(shaft[1], slab[1])
    floor_first = (slab[1] < shaft[1]) & (way[:, 0] > 0)
    if bone.depth_mm <= 0:
        shaft_out = np.full_like(shaft_out, -np.inf)
    t, kind = np.full(len(start), AHEAD_MM), np.full(len(start), WALL)
    for _ in range(3):  # out of one into the other, and back at most once: both are convex
        in_bore, in_shaft = (bore[0] <= t) & (t < bore[1]), (shaft_in <= t) & (t < shaft_out)
        t, kind = np.where(in_bore, bore[1], t), np.where(in_bore, WALL, kind)
        in_shaft = (shaft_in <= t) & (t < shaft_out)
        t = np.where(in_shaft, shaft_out, t)
        kind = np.where(in_shaft, np.where(floor_first, FLOOR, SIDE), kind)
    place = start + t[:, None] * way
    normal = np.zeros_like(place)
    wall, side = kind == WALL, kind == SIDE
    normal[wall, :2] = -place[wall, :2] / bone.radius_mm
    normal[side, 1:] = -place[side, 1:] / (bone.width_mm / 2)
    normal[kind == FLOOR, 0] = -1
    return Met(place, normal, kind)


def _through_cylinder(x: Numbers, y: Numbers, dx: Numbers, dy: Numbers, radius: float) -> tuple[Numbers, Numbers]:
    """Return where rays enter and leave an endless cylinder; never, as ∞ and −∞."""
    a, b, c = dx * dx + dy * dy, x * dx + y * dy, x * x + y * y - radius**2
    inside = b * b - a * c
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(np.maximum(inside, 0))
        enters, leaves = (-b - root) / a, (-b + root) / a
    parallel = a < 1e-15
    enters = np.where(parallel, np.where(c < 0, -np.inf, np.inf), np.where(inside > 0, enters, np.inf))
    leaves = np.where(parallel, np.where(c < 0, np.inf, -np.inf), np.where(inside > 0, leaves, -np.inf))
    return enters, leaves


@dataclass(frozen=True)
class Ring:
    """Fibres in a ring about the lens of a camera that looks at a cone mirror: they shine evenly over solid angle.

    The camera lies at z = ``apex_mm`` − ``distance_mm``, the cone's apex, towards it, at ``apex_mm``. The mirror is
    ``mirror_mm`` in radius; what passes it does not count.
    """

    apex_mm: float
    distance_mm: float
    half_angle_rad: float
    ring_mm: float
    mirror_mm: float

    @property
    def _least_cosine(self) -> float:
        """That of the steepest way from a fibre to the mirror."""
        base_mm = self.distance_mm + self.mirror_mm / math.tan(self.half_angle_rad)
        return math.cos(math.atan((self.mirror_mm + self.ring_mm) / base_mm))

    def solid_angle_density(self, n: int) -> float:
        """Return how many of ``n`` photons set out into a unit of solid angle."""
        return n / (2 * math.pi * (1 - self._least_cosine))

    def photons(self, n: int, rng: Generator) -> tuple[Vectors, Vectors]:
        """Return where up to ``n`` photons leave the mirror, and their directions."""
        angle = rng.uniform(0, 2 * np.pi, n)
        start = np.stack([self.ring_mm * np.cos(angle), self.ring_mm * np.sin(angle), 0 * angle], axis=1)
        start[:, 2] = self.apex_mm - self.distance_mm
        cosine, turn = rng.uniform(self._least_cosine, 1, n), rng.uniform(0, 2 * np.pi, n)
        sine = np.sqrt(1 - cosine**2)
        way = np.stack([sine * np.cos(turn), sine * np.sin(turn), cosine], axis=1)
        # the cone: x² + y² = (z − apex)² tan² a, z > apex
        slope = math.tan(self.half_angle_rad) ** 2
        apex = np.array([0, 0, self.apex_mm])
        p, d = start - apex, way
        a = d[:, 0] ** 2 + d[:, 1] ** 2 - slope * d[:, 2] ** 2
        b = p[:, 0] * d[:, 0] + p[:, 1] * d[:, 1] - slope * p[:, 2] * d[:, 2]
        c = p[:, 0] ** 2 + p[:, 1] ** 2 - slope * p[:, 2] ** 2
        root = np.sqrt(np.maximum(b * b - a * c, 0))
        both = np.stack([(-b - root) / a, (-b + root) / a])
        z = p[None, :, 2] + both * d[None, :, 2]
        t = np.where((both > 0) & (z > 0) & (b * b > a * c), both, np.inf).min(axis=0)
        hit = np.isfinite(t)
        p, d = p[hit] + t[hit, None] * d[hit], d[hit]
        rho = np.hypot(p[:, 0], p[:, 1])
        on = (rho <= self.mirror_mm) & (rho > 0)
        p, d, rho = p[on], d[on], rho[on]
        cos, sin = math.cos(self.half_angle_rad), math.sin(self.half_angle_rad)
        normal = np.stack([cos * p[:, 0] / rho, cos * p[:, 1] / rho, np.full(rho.size, -sin)], axis=1)
        d = d - 2 * np.sum(d * normal, axis=1)[:, None] * normal
        return p + apex, d


@dataclass(frozen=True)
class Outwards:
    """A ring of fibres about the bore's axis at z = 0 that shine away from it, by the cosine law, without any mirror.

    Light that the plain wall would get more than ``reach_mm`` from there does not count.
    """

    ring_mm: float
    reach_mm: float

    def photons(self, n: int, rng: Generator) -> tuple[Vectors, Vectors]:
        """Return where up to ``n`` photons start, and their directions."""
        angle = rng.uniform(0, 2 * np.pi, n)
        outwards = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
        start, way = self.ring_mm * outwards, _scattered(outwards, rng)
        within = np.abs(meet(Bone(), start, way).place[:, 2]) < self.reach_mm
        return start[within], way[within]


def followed(
    bone: Bone, source: Ring | Outwards, n: int, rng: Generator, albedo: float
) -> Iterator[tuple[Met, Numbers, int]]:
    """Yield where ``n`` photons meet bone, their weights, and how often they had met it before."""
    start, way = source.photons(n, rng)
    weight, bounces = np.ones(len(start)), 0
    while weight.size and weight[0] > LEAST_WEIGHT:
        met = meet(bone, start, way)
        yield met, weight, bounces
        start, way = met.place + AHEAD_MM * met.normal, _scattered(met.normal, rng)
        weight, bounces = albedo * weight, bounces + 1


def _scattered(normal: Vectors, rng: Generator) -> Vectors:
    """Return directions by the cosine law: the normal and a point on the unit sphere, added."""
    cosine, turn = rng.uniform(-1, 1, len(normal)), rng.uniform(0, 2 * np.pi, len(normal))
    sine = np.sqrt(1 - cosine**2)
    way = normal + np.stack([sine * np.cos(turn), sine * np.sin(turn), cosine], axis=1)
    length = np.sqrt(np.sum(way * way, axis=1))
    return np.asarray(way / np.maximum(length, 1e-12)[:, None])
