"""A camera looking along the bore at a cone mirror whose apex points at it, and the rays of its pixels.

The lens is a pinhole with radial distortion: a ray at ψ from the axis is imaged at r = f·t·(1 + k1·t²), t = tan ψ.
The cone has half angle a, its apex at distance d. The ray meets it at radius d·tan a·tan ψ / (tan a − tan ψ);
reflected, it leaves at the angle 2a − ψ from the axis. So the outer rim of the annulus looks ahead.

The rays of the pixels come off the cone, and are turned with the probe into the bore's frame; float32.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image
from endoct.base.errors import EndoctError
from endoct.synthetic.elementary import azimuth
from endoct.synthetic.sample.parameters import Endoscope

STEEPEST = 0.97
"""Largest tan ψ at which the mirror counts as visible, as a part of tan a, at which a ray runs along the cone."""
NEWTON_STEPS = 6
MIRROR_CLEARANCE_MM = 0.10
"""The mirror passes the bore with this much room around it."""
LEAST_INNER_SHARE = 0.08

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


@dataclass(frozen=True)
class FrameView:
    """How a camera looks at a bore of ``radius_mm`` in one frame.

    ``centre_px`` of the annulus; ``roll_rad`` and ``offset_mm`` of the probe; ``middle_mm``: z of the middle of the
    band that the annulus shows, and ``apex_mm`` of the mirror's apex.
    """

    camera: Endoscope
    cone: Cone
    radius_mm: float
    centre_px: Sequence[float]
    roll_rad: float
    offset_mm: Sequence[float]
    middle_mm: float
    apex_mm: float

    @classmethod
    def of(cls, camera: Endoscope, index: int, radius_mm: float) -> "FrameView":
        """Return that of frame ``index``."""
        middle_mm = camera.z_mm[index]
        places = camera.centre_px[index], camera.roll_rad[index], camera.offset_mm[index], middle_mm
        return cls(camera, cone_of(camera), radius_mm, *places, middle_mm - band_centre_mm(camera, radius_mm))


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


def fitting_annulus(
    optics: Mapping[str, float], inner_share: float, outer_px: float, radius_mm: float
) -> tuple[float, float]:
    """Return the annulus' inner radius, ``inner_share`` of the outer or what less it takes, and the focal length.

    The smaller the inner rim, the smaller the mirror that shows the same length; it has to pass through the bore.
    ``optics`` is what :func:`focal_length_px` takes. Raises :class:`EndoctError` where no mirror passes.
    """
    while True:
        inner_px = inner_share * outer_px
        focal_px = focal_length_px(optics, inner_px, outer_px, radius_mm)
        k1 = optics["distortion"] * (focal_px * (1 + optics["distortion"]) / outer_px) ** 2
        cone = Cone(math.radians(optics["half_angle_deg"]), optics["mirror_distance_mm"], focal_px, k1)
        if float(cone.rays(np.array([outer_px])).rho_mm[0]) <= radius_mm - MIRROR_CLEARANCE_MM:
            return inner_px, focal_px
        inner_share -= 0.01
        if inner_share < LEAST_INNER_SHARE:
            raise EndoctError(
                "no mirror that passes through the bore shows so much of it",
                found=f"visible_length_mm {optics['visible_length_mm']:.2f} at mirror_distance_mm "
                f"{optics['mirror_distance_mm']:.2f} in a bore of {2 * radius_mm:.2f} mm",
                remedy="vary visible_length_mm or mirror_distance_mm less",
            )


def _undistorted(image: Reals, k1: float) -> Reals:
    """Solve t·(1 + k1·t²) = ``image`` for t by Newton's method; the distortion is mild."""
    t = image
    for _ in range(NEWTON_STEPS if k1 else 0):
        t = t - (t * (1 + k1 * t**2) - image) / (1 + 3 * k1 * t**2)
    return t


@dataclass(frozen=True, eq=False)
class Rays:
    """Rays in the bore's frame, each relative to its own azimuth ``theta_rad``; float32 (n,) each.

    At a distance t from the cone a ray is at u0 + t·u1 along its azimuth and at v0 + t·v1 across it, towards larger θ.
    There z = z0 + t·z1, from the apex.
    """

    theta_rad: Image
    u0: Image
    u1: Image
    v0: Image
    v1: Image
    z0: Image
    z1: Image

    def of(self, chosen: NDArray[np.intp]) -> "Rays":
        """Return a part of the rays."""
        parts = self.theta_rad, self.u0, self.u1, self.v0, self.v1, self.z0, self.z1
        return Rays(*(values.take(chosen) for values in parts))

    def to_radius_mm(self, radius_mm: float) -> Image:
        """Return t where the rays meet the cylinder of ``radius_mm`` from inside."""
        a = self.u1 * self.u1 + self.v1 * self.v1
        b = self.u0 * self.u1 + self.v0 * self.v1
        c = self.u0 * self.u0 + self.v0 * self.v0 - radius_mm**2
        return np.asarray((np.sqrt(np.maximum(b * b - a * c, 0)) - b) / a)


def rays_of(frame: FrameView, x_px: Image, y_px: Image) -> Rays:
    """Return the rays of places of the image, counted from the annulus' centre."""
    r_px = np.sqrt(x_px * x_px + y_px * y_px)
    off_cone, turn = frame.cone.rays(r_px), frame.roll_rad
    per_px = np.asarray(1 / r_px, dtype=np.float32)
    cos, sin = x_px * per_px, y_px * per_px
    theta = azimuth(cos, sin)
    theta += np.float32(turn)
    # within a turn, as looking maps up beyond their edges takes ten times as long
    theta -= np.float32(2 * np.pi) * np.floor(theta * np.float32(0.5 / np.pi))
    cos, sin = _rotated(cos, sin, turn)
    starts = leaned(frame.camera, (off_cone.rho_mm * cos, off_cone.rho_mm * sin, off_cone.z_mm))
    ways = leaned(frame.camera, (off_cone.outward * cos, off_cone.outward * sin, off_cone.inward))
    x0, y0 = (start + np.float32(offset) for start, offset in zip(starts, frame.offset_mm, strict=False))
    return Rays(
        theta_rad=theta,
        u0=x0 * cos + y0 * sin,
        u1=ways[0] * cos + ways[1] * sin,
        v0=y0 * cos - x0 * sin,
        v1=ways[1] * cos - ways[0] * sin,
        z0=starts[2],
        z1=ways[2],
    )


def _rotated(x: Image, y: Image, by_rad: float) -> tuple[Image, Image]:
    cos, sin = np.float32(math.cos(by_rad)), np.float32(math.sin(by_rad))
    return x * cos - y * sin, x * sin + y * cos


def leaned(camera: Endoscope, vectors: Sequence[Image], way: int = 1) -> tuple[Image, Image, Image]:
    """Return vectors of the probe's frame in the bore's, into which the probe leans without turning about itself.

    With ``way`` −1, vectors of the bore's frame in the probe's.
    """
    towards, tilt = camera.probe_tilt_direction_rad, way * camera.probe_tilt_rad
    along, across = _rotated(vectors[0], vectors[1], -towards)
    z, along = _rotated(vectors[2], along, tilt)
    x, y = _rotated(along, across, towards)
    return x, y, z
