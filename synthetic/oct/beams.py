"""Where the beams of a turning, off-axis catheter meet the capillary and the bore's wall, and how wide they are there.

Everything is in the bore frame: x = r cos θ, y = r sin θ, z along the bore. The capillary's axis departs from the
bore's with ``tilt_rad``; the catheter lies at e from the capillary's axis, and a beam leaves it at α. Both
faces of the glass bend it. A round wall keeps n·r·sin(incidence) constant along a ray (Bouguer). That constant is
e·sin(α − β), β the direction of e. So every angle and length has a closed form.

Along its optical path a beam is Gaussian: narrowest at its focus, wider and weaker away from it. Light passes the spot
twice, and its full width at half maximum is ``lateral_resolution_mm`` at the focus. The beam's own waist is therefore
w₀ = that/√ln 2, and its Rayleigh length π·w₀²/λ.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Mask
from endoct.base.numeric.circle import wrap_rad
from endoct.synthetic.bone.scene import Crossings, Scene, crossings
from endoct.synthetic.sample.parameters import Bore, Oct, Sample
from endoct.synthetic.sample.presets import PRESETS

FLUID_INDEX = 1.33
BONE_INDEX = 1.55
"""Refractive index of cortical bone near 1300 nm."""
FWHM = 2 * math.sqrt(2 * math.log(2))
"""Full width at half maximum of a Gaussian, over its σ."""


@dataclass(frozen=True, eq=False)
class Echoes:
    """What the beams of one turn meet, one value a beam: arrays (n,), float64 unless said otherwise.

    Paths are optical, from the catheter, in mm of air; NaN where a beam meets no such thing within reach.
    ``alpha_rad``: direction in which the beam leaves the catheter. ``inner_path_mm``, ``outer_path_mm``: to the
    capillary's faces; ``inner_incidence_rad``, ``outer_incidence_rad``: signed angle there, on the side of the air.
    ``fluid_path_mm``: to a fluid's surface before the wall. ``wall_path_mm``: to the first solid surface, bone or dust.
    ``exit_path_mm``, ``reentry_path_mm``: to where a beam leaves a thin septum and meets bone again.
    ``surface_path_mm``: to the first surface of any kind beyond the capillary. ``wall_z_mm``, ``wall_theta_rad``,
    ``wall_radius_mm``: where that solid surface is, in the bore frame (θ of the beam and NaN where there is none).
    ``wall_cosine``: of the incidence on it. ``fluid_cosine``: on the fluid. ``cell`` int32: 1 + index of the cell it
    belongs to, 0 on the bore's own wall. ``dust`` bool: it is bone dust. ``shadow_db``: light lost to dirt on the
    capillary, there and back. ``crossing_rad``: θ where a beam crosses the bore's nominal radius; ``slant_rad``: by how
    much its direction is turned there from the radius; ``beyond_mm``: the way from there to the solid surface.
    """

    alpha_rad: Coordinates
    inner_path_mm: Coordinates
    outer_path_mm: Coordinates
    inner_incidence_rad: Coordinates
    outer_incidence_rad: Coordinates
    fluid_path_mm: Coordinates
    wall_path_mm: Coordinates
    exit_path_mm: Coordinates
    reentry_path_mm: Coordinates
    wall_z_mm: Coordinates
    wall_theta_rad: Coordinates
    wall_radius_mm: Coordinates
    wall_cosine: Coordinates
    fluid_cosine: Coordinates
    cell: NDArray[np.int32]
    dust: Mask
    shadow_db: Coordinates
    crossing_rad: Coordinates
    slant_rad: Coordinates
    beyond_mm: Coordinates


@dataclass(frozen=True, eq=False)
class Refracted:
    """Beams that went through a capillary; float64 (n,), angles from the catheter's offset.

    ``inner_mm``, ``glass_mm``: geometric ways to the inner face and through the glass. ``inner_rad``, ``outer_rad``:
    incidence on the inner face, and emergence from the outer, in air. ``exit_rad``: where on the outer face the beam
    emerges. ``onward_rad``: direction in which it goes on.
    """

    inner_mm: Coordinates
    glass_mm: Coordinates
    inner_rad: Coordinates
    outer_rad: Coordinates
    exit_rad: Coordinates
    onward_rad: Coordinates


def stream_position(oct_: Oct, slice_index: int, n_ascans: int) -> NDArray[np.intp]:
    """Return for every A-scan recorded of one slice how many were taken before it, lost ones too; (n_ascans,)."""
    position = np.arange(n_ascans)
    lost = np.zeros(n_ascans, np.intp)
    for gap in oct_.lost_ascans:
        if gap.slice_index == slice_index:
            lost[position >= gap.ascan] += gap.count
    return position + lost


def beam_angle_rad(oct_: Oct, slice_index: int, turn_rad: Coordinates) -> Coordinates:
    """Return the direction in the bore frame of beams at ``turn_rad`` of a slice's turn.

    α = theta_origin + sense·(turn + start_angle + Σ_h [cos_h·cos(h·turn) + sin_h·sin(h·turn)]).
    """
    along = turn_rad + oct_.start_angle_rad[slice_index]
    for h, (cos, sin) in enumerate(oct_.rotation_error_rad[slice_index], 1):
        along = along + cos * np.cos(h * turn_rad) + sin * np.sin(h * turn_rad)
    return oct_.theta_origin_rad + oct_.sense * along


def capillary_axis_mm(bore: Bore, z_mm: Coordinates) -> tuple[Coordinates, Coordinates]:
    """Return x and y of the capillary's axis in the bore frame at ``z_mm``."""
    away = -np.tan(bore.tilt_rad) * (z_mm - bore.length_mm / 2)
    return away * np.cos(bore.tilt_direction_rad), away * np.sin(bore.tilt_direction_rad)


def refract(offset_mm: float, gamma_rad: Coordinates, inner_mm: float, outer_mm: float, index: float) -> Refracted:
    """Return the way of beams through a capillary with these radii.

    The beams leave a point ``offset_mm`` from its axis, at ``gamma_rad`` from the direction of that offset.
    """
    across = offset_mm * np.sin(gamma_rad)
    within = np.arcsin(across / (index * inner_mm)), np.arcsin(across / (index * outer_mm))
    inner, outer = np.arcsin(across / inner_mm), np.arcsin(across / outer_mm)
    exit_ = gamma_rad - inner + within[0] - within[1]
    return Refracted(
        inner_mm=np.sqrt(inner_mm**2 - across**2) - offset_mm * np.cos(gamma_rad),
        glass_mm=outer_mm * np.cos(within[1]) - inner_mm * np.cos(within[0]),
        inner_rad=inner,
        outer_rad=outer,
        exit_rad=exit_,
        onward_rad=exit_ + outer,
    )


def trace(sample: Sample, scene: Scene, slice_index: int, position: Coordinates) -> Echoes:
    """Return what the beams of one slice meet.

    ``position`` counts A-scans taken since the slice began, see :func:`stream_position`; any real number will do.
    Surfaces count as far as twice the depth of a B-scan, from where they still appear, folded back.
    """
    return trace_slices(sample, scene, [slice_index], [position])[0]


def trace_slices(sample: Sample, scene: Scene, slices: Sequence[int], positions: Sequence[Coordinates]) -> list[Echoes]:
    """Return the same for several slices and the ``positions`` in each, in less time than one by one."""
    leaving = [_leaving(sample, index, position) for index, position in zip(slices, positions, strict=True)]
    met = crossings(
        scene,
        np.concatenate([beams.origin_mm for beams in leaving]),
        np.concatenate([beams.direction for beams in leaving]),
        np.zeros(sum(position.size for position in positions)),
        np.concatenate([beams.reach_mm for beams in leaving]),
    )
    ends = np.cumsum([position.size for position in positions])
    return [
        _echoes(
            sample,
            beams,
            Crossings(**{name: values[end - beams.alpha_rad.size : end] for name, values in vars(met).items()}),
        )
        for beams, end in zip(leaving, ends, strict=True)
    ]


@dataclass(frozen=True, eq=False)
class _Leaving:
    """Beams of one slice as they leave the capillary."""

    alpha_rad: Coordinates
    glass: Refracted
    outer_path_mm: Coordinates
    face_rad: Coordinates
    origin_mm: Coordinates
    direction: Coordinates
    reach_mm: Coordinates


def _leaving(sample: Sample, slice_index: int, position: Coordinates) -> _Leaving:
    oct_, size = sample.oct, PRESETS[sample.preset]
    turn = 2 * np.pi * position / size.n_ascans * oct_.turn_length[slice_index]
    z_mm = oct_.z_mm[slice_index] + oct_.z_advance_mm * turn / (2 * np.pi)
    alpha = beam_angle_rad(oct_, slice_index, turn)
    e, beta = oct_.offset_mm[slice_index], oct_.offset_direction_rad[slice_index]
    outer_mm = oct_.capillary_outer_diameter_mm / 2
    glass = refract(e, alpha - beta, outer_mm - oct_.glass_mm, outer_mm, oct_.glass_index)
    outer_path = glass.inner_mm + oct_.glass_index * glass.glass_mm
    axis_x, axis_y = capillary_axis_mm(sample.bore, z_mm)
    face, onward = beta + glass.exit_rad, beta + glass.onward_rad
    return _Leaving(
        alpha_rad=alpha,
        glass=glass,
        outer_path_mm=outer_path,
        face_rad=face,
        origin_mm=np.stack([axis_x + outer_mm * np.cos(face), axis_y + outer_mm * np.sin(face), z_mm], axis=1),
        direction=np.stack([np.cos(onward), np.sin(onward), np.zeros_like(onward)], axis=1),
        reach_mm=oct_.first_sample_mm + 2 * size.n_depth * oct_.axial_pixel_mm - outer_path,
    )


def _echoes(sample: Sample, beams: _Leaving, met: Crossings) -> Echoes:
    ends = beams.origin_mm + met.entry_mm[:, None] * beams.direction
    hit = np.isfinite(met.entry_mm)
    onward = np.arctan2(beams.direction[:, 1], beams.direction[:, 0])
    wet_mm = np.where(np.isfinite(met.fluid_mm) & hit, met.entry_mm - met.fluid_mm, 0)
    wall_path = beams.outer_path_mm + met.entry_mm + (FLUID_INDEX - 1) * wet_mm
    exit_path = wall_path + BONE_INDEX * (met.exit_mm - met.entry_mm)
    z_mm = beams.origin_mm[:, 2]
    across = beams.origin_mm[:, :2]
    outward = np.sum(across * beams.direction[:, :2], axis=1)
    inside = (sample.bore.diameter_mm / 2) ** 2 - np.sum(across**2, axis=1)
    crossing_mm = np.sqrt(outward**2 + inside) - outward
    crossing = across + crossing_mm[:, None] * beams.direction[:, :2]
    crossing_rad = np.arctan2(crossing[:, 1], crossing[:, 0])
    return Echoes(
        alpha_rad=beams.alpha_rad,
        inner_path_mm=beams.glass.inner_mm,
        outer_path_mm=beams.outer_path_mm,
        inner_incidence_rad=beams.glass.inner_rad,
        outer_incidence_rad=beams.glass.outer_rad,
        fluid_path_mm=beams.outer_path_mm + met.fluid_mm,
        wall_path_mm=wall_path,
        exit_path_mm=exit_path,
        reentry_path_mm=exit_path + met.reentry_mm - met.exit_mm,
        wall_z_mm=z_mm,
        wall_theta_rad=np.mod(np.where(hit, np.arctan2(ends[:, 1], ends[:, 0]), onward), 2 * np.pi),
        wall_radius_mm=np.hypot(ends[:, 0], ends[:, 1]),
        wall_cosine=np.clip(-np.sum(beams.direction * met.normal, axis=1), 0, 1),
        fluid_cosine=np.clip(np.sum(met.fluid_normal * beams.direction, axis=1), 0, 1),
        cell=met.cell,
        dust=met.dust,
        shadow_db=_shadow_db(sample.oct, z_mm, beams.face_rad),
        crossing_rad=np.mod(crossing_rad, 2 * np.pi),
        slant_rad=wrap_rad(np.arctan2(beams.direction[:, 1], beams.direction[:, 0]) - crossing_rad),
        beyond_mm=met.entry_mm - crossing_mm,
    )


def _shadow_db(oct_: Oct, z_mm: Coordinates, face_rad: Coordinates) -> Coordinates:
    """Return the light that dirt takes where beams leave the capillary; flat inside and soft outside, as a speck is."""
    loss = np.zeros_like(z_mm)
    for dirt in oct_.shadows:
        along = (z_mm - dirt.z_mm) / dirt.sigma_z_mm
        around = wrap_rad(face_rad - dirt.theta_rad) / dirt.sigma_theta_rad
        loss += dirt.loss_db * np.exp(-((0.5 * (along**2 + around**2)) ** 2))
    return loss


def rayleigh_mm(oct_: Oct) -> float:
    """Return the way from the focus on which the beam widens by √2."""
    return math.pi * oct_.lateral_resolution_mm**2 / math.log(2) / oct_.wavelength_mm


def spot_sigma_mm(oct_: Oct, path_mm: Coordinates) -> Coordinates:
    """Return the standard deviation of the field that scatterers are weighted with: √2 of that of its square."""
    wider = (1 + ((path_mm - oct_.focus_mm) / rayleigh_mm(oct_)) ** 2) ** 0.5
    sigma: Coordinates = math.sqrt(2) * oct_.lateral_resolution_mm / FWHM * wider
    return sigma


def coupling(oct_: Oct, path_mm: Coordinates) -> Coordinates:
    """Return the share of the intensity that finds its way back from a diffuse wall at ``path_mm``, 1 from the focus.

    All of the light falls on the wall wherever that is. What comes back into the fibre falls off as the beam's own
    intensity on its axis, but with an apparent Rayleigh length. By van Leeuwen et al. (2003) that is twice the beam's.
    """
    apart = (path_mm - oct_.focus_mm) / (oct_.diffuse_rayleigh * rayleigh_mm(oct_))
    share: Coordinates = 1 / (1 + apart**2)
    return share
