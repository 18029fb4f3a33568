"""The light that comes straight from the probe: a ring of fibres around the lens, as the cone mirror shows it.

In the plane through the probe's axis and a place on the wall, the mirror is a straight line, and a fibre that is
``u`` off the axis within that plane lights the place from its mirror image, over a path L. Around the bore a cone
does not act as a plane mirror: by the angular momentum of a ray about the axis, which no reflection off the cone
changes, a bundle that leaves the fibre β wide arrives S·β wide, with

    S = ρ·(p/ρ_c + u·(1/ρ_c − 1/ρ)·L/Δρ),

where p is the path to the cone, ρ_c and ρ the distances of cone and place from the axis, and Δρ that of the place from
the mirror image. The irradiance is cos i/(L·S). What a fibre is off that plane changes it by less than a hundredth and
is left out (``benchmarks/light`` traces photons without any of this). For u = 0 it is cos i·sin ψ/(L·ρ), and before a
plane mirror the inverse square of the path.

Fibres shine evenly over solid angle. What passes the mirror's edge is not followed.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from endoct.base.arrays import Image
from endoct.synthetic.endoscope.cone import cone_of, leaned
from endoct.synthetic.sample.parameters import Endoscope

FIBRES = 6
"""Places in the ring from which light is summed up: cosines of angles that are evenly spaced over half of it."""
MIRROR_BEYOND = 1.05
"""Radius of the mirror over that of the part that the annulus shows."""
LEAST = 1e-3
"""What must be positive where light goes over the mirror is at least this, in mm or relative."""
PENUMBRA = 5.0
"""A shadow's edge goes from light to dark for one fibre over about the distance between two fibres."""


@dataclass(frozen=True, eq=False)
class Places:
    """Places on the bone, float32 (n,) each.

    ``z_mm`` from the mirror's apex along the bore, ``theta_rad`` and ``radius_mm`` in the bore's frame; slopes ∂r/∂z
    and ∂r/(r ∂θ) of the surface; ``shade_before``, ``shade_behind``: how steeply, at most, bone rises towards the
    bore's axis before the place (at smaller z) and behind it, mm/mm.
    """

    z_mm: Image
    theta_rad: Image
    radius_mm: Image
    slope_z: Image
    slope_theta: Image
    shade_before: Image
    shade_behind: Image


def direct(camera: Endoscope, frame_index: int, at: Places, bore_mm: float) -> tuple[Image, Image]:
    """Return the irradiance of places, and what it would be if they faced the light, float32 (n,) each.

    1 is the irradiance at normal incidence, by a source in the pinhole, of a wall ``bore_mm`` from the probe's axis in
    the middle of the annulus. Shadows are those that relief casts along the bore: around it light comes within 3° of
    the radius, along which relief hides nothing.
    """
    cone = cone_of(camera)
    a, d = cone.half_angle_rad, cone.distance_mm
    sin_2a, cos_2a, cot_a = math.sin(2 * a), math.cos(2 * a), 1 / math.tan(a)
    mirror_mm = MIRROR_BEYOND * float(cone.rays(np.array([camera.outer_px])).rho_mm[0])
    cos, sin = np.cos(at.theta_rad), np.sin(at.theta_rad)
    off_x, off_y = camera.offset_mm[frame_index]
    x = np.asarray(at.radius_mm * cos - np.float32(off_x), dtype=np.float32)
    y = np.asarray(at.radius_mm * sin - np.float32(off_y), dtype=np.float32)
    x, y, z = leaned(camera, (x, y, at.z_mm), -1)
    rho: Image = np.sqrt(x * x + y * y)
    # the unit vectors away from the probe's axis and along it, along and across the bore's radius and along the bore
    away = _local(leaned(camera, (x / rho, y / rho, np.zeros_like(z)), 1), cos, sin)
    inward = _local(leaned(camera, (np.zeros_like(z), np.zeros_like(z), np.ones_like(z)), 1), cos, sin)
    faces = [one[0] - at.slope_theta * one[1] - at.slope_z * one[2] for one in (away, inward)]
    norm = 1 / np.sqrt(1 + at.slope_z * at.slope_z + at.slope_theta * at.slope_theta)
    lit, arriving = np.zeros_like(rho), np.zeros_like(rho)
    ring = [camera.fibre_ring_mm * math.cos((k + 0.5) * math.pi / FIBRES) for k in range(FIBRES)]
    for u in ring if camera.fibre_ring_mm else [0.0]:
        across = rho + np.float32(d * sin_2a + u * cos_2a)
        along = z + np.float32(d * cos_2a - u * sin_2a)
        forwards = cos_2a * along + sin_2a * across
        tangent = (sin_2a * along - cos_2a * across) / np.maximum(forwards, LEAST)
        meets = 1 - cot_a * tangent
        rho_cone = np.asarray((u + d * tangent) / np.maximum(meets, LEAST), dtype=np.float32)
        seen = (forwards > LEAST) & (meets > LEAST) & (rho_cone > LEAST) & (rho_cone < mirror_mm)
        np.clip(rho_cone, LEAST, mirror_mm, out=rho_cone)
        to_cone = (d + cot_a * rho_cone) * np.sqrt(1 + tangent * tangent)
        path = np.sqrt(across * across + along * along)
        spread = rho * to_cone + u * (rho - rho_cone) * path / across
        steep = (across * away[2] + along * inward[2]) / (across * away[0] + along * inward[0])
        shade = np.where(steep > 0, at.shade_before, at.shade_behind)
        share = np.clip(0.5 + PENUMBRA * (1 - np.abs(steep) * shade), 0, 1)
        share *= seen * rho_cone / (spread * path)
        arriving += share
        share *= np.maximum(across * faces[0] + along * faces[1], 0)
        lit += share / path
    scale = _bright_side(camera, frame_index, x, y, rho)
    scale *= np.float32(1 / (_reference(camera, bore_mm) * (FIBRES if camera.fibre_ring_mm else 1)))
    arriving *= scale
    lit *= norm
    lit *= scale
    return lit, arriving


def _local(vectors: Sequence[Image], cos: Image, sin: Image) -> tuple[Image, Image, Image]:
    """Return vectors of the bore's frame along its radius, around it and along it."""
    x, y, z = vectors
    return x * cos + y * sin, y * cos - x * sin, z


def _reference(camera: Endoscope, bore_mm: float) -> float:
    rays = cone_of(camera).rays(np.array([(camera.inner_px + camera.outer_px) / 2]))
    path_mm = rays.path_mm + (bore_mm - rays.rho_mm) / rays.outward
    return float((rays.sine / (path_mm * bore_mm))[0])


def _bright_side(camera: Endoscope, frame_index: int, x: Image, y: Image, rho: Image) -> Image:
    """Return the light's first harmonic around the probe."""
    turned = camera.roll_rad[frame_index] + camera.bright_side_rad
    return (
        1 + np.float32(camera.bright_side) * (x * np.float32(math.cos(turned)) + y * np.float32(math.sin(turned))) / rho
    )
