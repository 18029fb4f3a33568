"""Where the beams of a turning, off-axis catheter meet the capillary and the bore's wall.

The catheter lies at e from the axis that capillary and bore share. A beam at angle α in the bore frame leaves
it and meets a circle of radius R about the axis at ρ = −e·cos(α − β) + √(R² − e²·sin²(α − β)), where β is the
direction of e. Everything seen through glass lies deeper by (n − 1) times the way through it. That glass
also bends an oblique beam, by up to about 1.5°, is left to a more physical version.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from endoct.stitching.arrays import Coordinates
from endoct.synthetic.parameters import Oct
from endoct.synthetic.wall import Wall

STEP_MM = 0.01


@dataclass(frozen=True, eq=False)
class Echoes:
    """What the beams of one turn meet; float64 (n,), one value a beam.

    ``alpha_rad``: direction of the beam. ``inner_path_mm``, ``outer_path_mm``, ``wall_path_mm``: optical path
    from the catheter to the capillary's faces and to the wall (NaN where it meets none within reach).
    ``face_incidence_rad``: angle between beam and the capillary's outer face. ``wall_z_mm`` (one for all),
    ``wall_theta_rad``, ``wall_radius_mm``: where the wall was hit; ``wall_cosine``: of the incidence there.
    """

    alpha_rad: Coordinates
    inner_path_mm: Coordinates
    outer_path_mm: Coordinates
    face_incidence_rad: Coordinates
    wall_path_mm: Coordinates
    wall_z_mm: float
    wall_theta_rad: Coordinates
    wall_radius_mm: Coordinates
    wall_cosine: Coordinates


def beam_angle_rad(oct_: Oct, slice_index: int, turn_rad: Coordinates) -> Coordinates:
    """Return the direction in the bore frame of beams recorded at ``turn_rad`` = 2πk/n of slice's turn.

    α = theta_origin + sense·(turn + start_angle + Σ_h [cos_h·cos(h·turn) + sin_h·sin(h·turn)]).
    """
    along = turn_rad + oct_.start_angle_rad[slice_index]
    for h, (cos, sin) in enumerate(oct_.rotation_error_rad[slice_index], 1):
        along = along + cos * np.cos(h * turn_rad) + sin * np.sin(h * turn_rad)
    return oct_.theta_origin_rad + oct_.sense * along


def distance_to_circle_mm(radius_mm: float, offset_mm: float, from_offset_rad: Coordinates) -> Coordinates:
    """Return ρ to a circle about the axis; ``from_offset_rad`` is α − β."""
    across = offset_mm * np.sin(from_offset_rad)
    rho: Coordinates = np.sqrt(radius_mm**2 - across**2) - offset_mm * np.cos(from_offset_rad)
    return rho


def trace(oct_: Oct, wall: Wall, slice_index: int, turn_rad: Coordinates, reach_mm: float) -> Echoes:
    """Return what the beams at ``turn_rad`` of one slice meet; the wall within ``reach_mm`` of optical path."""
    alpha = beam_angle_rad(oct_, slice_index, turn_rad)
    e, beta = oct_.offset_mm[slice_index], oct_.offset_direction_rad[slice_index]
    outer_radius = oct_.capillary_outer_diameter_mm / 2
    inner = distance_to_circle_mm(outer_radius - oct_.glass_mm, e, alpha - beta)
    outer = distance_to_circle_mm(outer_radius, e, alpha - beta)
    delay = (oct_.glass_index - 1) * (outer - inner)

    z_mm = oct_.z_mm[slice_index]
    start = distance_to_circle_mm(wall.radius_mm + float(wall.relief_mm.min()) - 0.01, e, alpha - beta)
    rho = _march(wall, z_mm, alpha, e, beta, start, reach_mm - delay)
    x, y = e * np.cos(beta) + rho * np.cos(alpha), e * np.sin(beta) + rho * np.sin(alpha)
    theta, radius = np.mod(np.arctan2(y, x), 2 * np.pi), np.hypot(x, y)
    hit = np.isfinite(rho)
    theta[~hit], radius[~hit] = alpha[~hit], np.nan
    z = np.full_like(theta, z_mm)
    slope_theta = np.clip(wall.at(wall.slope_theta, z, theta), -20, 20)
    slope_z = np.clip(wall.at(wall.slope_z, z, theta), -20, 20)
    # normal of r = R + relief, pointing outward: (1, −slope_theta) in (radial, azimuthal), −slope_z along z
    cosine = np.cos(alpha - theta) - slope_theta * np.sin(alpha - theta)
    cosine = np.clip(cosine, 0, None) / np.sqrt(1 + slope_theta**2 + slope_z**2)
    return Echoes(
        alpha_rad=alpha,
        inner_path_mm=inner,
        outer_path_mm=outer + delay,
        face_incidence_rad=np.arcsin(np.clip(e * np.sin(alpha - beta) / outer_radius, -1, 1)),
        wall_path_mm=rho + delay,
        wall_z_mm=z_mm,
        wall_theta_rad=theta,
        wall_radius_mm=radius,
        wall_cosine=cosine,
    )


def _march(
    wall: Wall,
    z_mm: float,
    alpha_rad: Coordinates,
    offset_mm: float,
    direction_rad: float,
    start_mm: Coordinates,
    reach_mm: Coordinates,
) -> Coordinates:
    """Return how far each beam goes until it is behind the wall, NaN where that is beyond ``reach_mm``."""
    x0, y0 = offset_mm * np.cos(direction_rad), offset_mm * np.sin(direction_rad)
    cos, sin = np.cos(alpha_rad), np.sin(alpha_rad)

    def behind(beam: NDArray[np.intp], rho: Coordinates) -> Coordinates:
        x, y = x0 + rho * cos[beam], y0 + rho * sin[beam]
        relief = wall.at(wall.relief_mm, np.full(beam.size, z_mm), np.arctan2(y, x))
        excess: Coordinates = np.hypot(x, y) - wall.radius_mm - relief
        return excess

    found = np.full(alpha_rad.size, np.nan)
    beam = np.arange(alpha_rad.size)
    rho, before = start_mm.copy(), behind(beam, start_mm)
    while beam.size:
        ahead = rho + STEP_MM
        excess = behind(beam, ahead)
        hit = excess >= 0
        found[beam[hit]] = (rho + STEP_MM * before / (before - excess))[hit]
        on = ~hit & (ahead < reach_mm[beam])
        beam, rho, before = beam[on], ahead[on], excess[on]
    return found
