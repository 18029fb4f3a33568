"""A camera looking along the bore at a cone mirror whose apex points at it.

The lens is a pinhole with radial distortion: a ray at ψ from the axis is imaged at r = f·t·(1 + k1·t²), t = tan ψ.
It meets the cone, of half angle a with its apex at distance d, at radius d·tan a·tan ψ / (tan a − tan ψ);
reflected, it leaves at the angle 2a − ψ from the axis. So the outer rim of the annulus looks ahead.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.stitching.arrays import Coordinates
from endoct.stitching.errors import EndoctError
from endoct.synthetic.sample.parameters import Endoscope

STEEPEST = 0.97
"""Largest tan ψ at which the mirror counts as visible, as a part of tan a, at which a ray runs along the cone."""
NEWTON_STEPS = 6

Reals = NDArray[np.floating[Any]]


@dataclass(frozen=True, eq=False)
class ConeRays:
    """Rays off the mirror, of the shape and dtype of the image radii given.

    ``rho_mm`` from the probe's axis and ``z_mm`` from the apex, inward, where a ray leaves the cone; ``outward``
    and ``inward``, its unit direction across and along the axis; ``path_mm`` from the pinhole to the cone;
    ``sine`` of ψ.
    """

    rho_mm: Reals
    z_mm: Reals
    outward: Reals
    inward: Reals
    path_mm: Reals
    sine: Reals


@dataclass(frozen=True)
class Cone:
    """The lens and the mirror before it: ``k1`` of the lens, with the radius in units of ``focal_px``."""

    half_angle_rad: float
    distance_mm: float
    focal_px: float
    k1: float = 0.0

    def rays(self, r_px: Reals) -> ConeRays:
        """Return the reflected rays of pixels at ``r_px`` (any shape, float32 or float64) from the image's centre."""
        tan_psi = _undistorted(r_px / self.focal_px, self.k1)
        a = self.half_angle_rad
        tan_a, sin_2a, cos_2a = math.tan(a), math.sin(2 * a), math.cos(2 * a)
        cosine = 1 / np.sqrt(1 + tan_psi**2)
        sine = tan_psi * cosine
        z_mm = self.distance_mm * tan_psi / (tan_a - tan_psi)
        return ConeRays(
            rho_mm=z_mm * tan_a,
            z_mm=z_mm,
            outward=sin_2a * cosine - cos_2a * sine,
            inward=cos_2a * cosine + sin_2a * sine,
            path_mm=(self.distance_mm + z_mm) / cosine,
            sine=sine,
        )

    def wall_z_mm(self, r_px: Coordinates, radius_mm: float) -> Coordinates:
        """Return z from the apex where pixels at ``r_px`` see a concentric wall of ``radius_mm``."""
        rays = self.rays(r_px)
        return np.asarray(rays.z_mm + (radius_mm - rays.rho_mm) * rays.inward / rays.outward, dtype=np.float64)


def cone_of(camera: Endoscope) -> Cone:
    """Return the lens and the mirror of an endoscope."""
    return Cone(math.radians(camera.half_angle_deg), camera.mirror_distance_mm, camera.focal_px, camera.distortion_k1)


def band_centre_mm(camera: Endoscope, radius_mm: float) -> float:
    """Return z from the cone's apex to the middle of the band that the annulus shows of the nominal wall.

    That of a probe on the bore's axis and along it.
    """
    return float(cone_of(camera).wall_z_mm(np.array([camera.inner_px, camera.outer_px]), radius_mm).mean())


def focal_length_px(optics: Mapping[str, float], inner_px: float, outer_px: float, radius_mm: float) -> float:
    """Return the focal length with which the annulus spans ``visible_length_mm`` of the nominal wall.

    ``optics``: also ``mirror_distance_mm``, ``half_angle_deg`` and ``distortion``. Raises :class:`EndoctError` where
    no focal length does.
    """
    length, a = optics["visible_length_mm"], math.radians(optics["half_angle_deg"])
    ideal_outer = outer_px / (1 + optics["distortion"])
    rims = np.array([inner_px, outer_px])

    def excess_mm(focal: float) -> float:
        k1 = optics["distortion"] * (focal / ideal_outer) ** 2
        z = Cone(a, optics["mirror_distance_mm"], focal, k1).wall_z_mm(rims, radius_mm)
        return float(z[1] - z[0]) - length

    shortest = ideal_outer / (STEEPEST * math.tan(a))
    if excess_mm(shortest) < 0:
        raise EndoctError(
            "the annulus of such a mirror cannot show so much of the bore",
            found=f"visible_length_mm {length:g} at mirror_distance_mm {optics['mirror_distance_mm']:.2f} and "
            f"half_angle_deg {optics['half_angle_deg']:.1f}",
            expected=f"up to {length + excess_mm(shortest):.2f} mm",
            remedy="vary visible_length_mm less, or mirror_distance_mm upwards",
        )
    from scipy.optimize import brentq  # takes a while to load, and only who draws a specimen needs it

    return float(brentq(excess_mm, shortest, 1e5 * outer_px, xtol=1e-9 * outer_px, rtol=1e-14))


def _undistorted(image: Reals, k1: float) -> Reals:
    """Return t of t·(1 + k1·t²) = ``image``, by Newton's method; the distortion is a mild one."""
    t = image
    for _ in range(NEWTON_STEPS if k1 else 0):
        t = t - (t * (1 + k1 * t**2) - image) / (1 + 3 * k1 * t**2)
    return t
