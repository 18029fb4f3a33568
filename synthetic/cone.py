"""A pinhole camera looking along the bore at a cone mirror whose apex points at it.

A pixel at distance r from the image's centre looks along ψ = atan(r/f) and meets the cone, of half angle a
with its apex at distance d, at radius d·tan a·tan ψ / (tan a − tan ψ); reflected, it leaves at the angle
2a − ψ from the axis. So the outer rim of the annulus looks ahead.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from endoct.stitching.arrays import Coordinates


@dataclass(frozen=True)
class ConeRays:
    """Rays off the mirror: at radius ρ from the probe's axis a ray is at z = z_mm + (ρ − rho_mm)·slope.

    ``rho_mm``, ``z_mm`` (from the apex, inward) where it leaves the cone; ``slope`` = cot(2a − ψ).
    """

    rho_mm: Coordinates
    z_mm: Coordinates
    slope: Coordinates


def cone_rays(r_px: Coordinates, focal_px: float, distance_mm: float, half_angle_rad: float) -> ConeRays:
    """Return the reflected rays of pixels at ``r_px`` (any shape) from the image's centre."""
    tan_a, tan_psi = np.tan(half_angle_rad), r_px / focal_px
    z_mm = distance_mm * tan_psi / (tan_a - tan_psi)
    return ConeRays(z_mm * tan_a, z_mm, 1 / np.tan(2 * half_angle_rad - np.arctan(tan_psi)))


def wall_z_mm(
    r_px: Coordinates, focal_px: float, distance_mm: float, half_angle_rad: float, radius_mm: float
) -> Coordinates:
    """Return z from the apex where pixels at ``r_px`` see a concentric wall of ``radius_mm``."""
    rays = cone_rays(r_px, focal_px, distance_mm, half_angle_rad)
    z: Coordinates = rays.z_mm + (radius_mm - rays.rho_mm) * rays.slope
    return z


def focal_length_px(optics: Mapping[str, float], inner_px: float, outer_px: float, radius_mm: float) -> float:
    """Return the focal length with which the annulus spans ``visible_length_mm`` of the nominal wall."""
    length, d, a = optics["visible_length_mm"], optics["mirror_distance_mm"], np.deg2rad(optics["half_angle_deg"])
    focal = (radius_mm + d) * (outer_px - inner_px) / length
    for _ in range(30):  # the span is very nearly inversely proportional to the focal length
        z = wall_z_mm(np.array([inner_px, outer_px]), focal, d, a, radius_mm)
        focal *= float(z[1] - z[0]) / length
    return float(focal)
