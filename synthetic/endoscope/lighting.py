"""How much light comes back from what the endoscope's pixels see, and at which gain a recording is taken.

Bone sends on what arrives there (:mod:`endoct.synthetic.endoscope.irradiance`) evenly, as a matt surface does. A glossy
surface also shines where it faces the ray, as source and lens lie together. What all frames of a recording share is
worked out once.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from endoct.base.arrays import Image, Mask
from endoct.synthetic.bone.wall import WallMaps
from endoct.synthetic.elementary import exp
from endoct.synthetic.endoscope.cone import FrameView
from endoct.synthetic.endoscope.facets import Facets, facets_of
from endoct.synthetic.endoscope.irradiance import EVERY_COLUMN, Bounced, LitPlaces, bounced, direct, shade_of
from endoct.synthetic.endoscope.sight import Hits, View, Visible, follow, lookup, lookup_all, view, visible
from endoct.synthetic.sample.parameters import Debris, Endoscope, Sample

BONE_RGB = (1.0, 0.88, 0.72)
LINING_RGB = (1.0, 0.70, 0.60)
STEEPEST_SLOPE = 8.0
LINED_MM = 0.1
"""Depth below the nominal wall from which a cell's inside has the colour of its lining."""
RING_SIGMA_PX = 1.5
CONTACT_SHADE = 0.5
CONTACT_REACH = 1.3
"""The shade around a crumb reaches this many of its radii."""
OBSCURED = 0.2
METERED_FRAMES = 3
METERED_EVERY = 3
"""Rows of the image to one in which the light is measured."""


@dataclass(frozen=True, eq=False)
class Lighting:
    """``shade`` and ``facets`` of the wall, the camera's ``gain``: saturation over light; are cells ``lined``?"""

    shade: Image
    facets: Facets
    gain: float
    lined: bool


@dataclass(frozen=True, eq=False)
class LitSurface:
    """What the light of one frame falls on.

    ``maps`` (row, column, 4): albedo, rim light, slopes along z and θ of the rows that are seen, crumbs included;
    ``shade`` (row, column / 2, 2) of the same rows; ``wet`` (row, column), None where all is dry; ``bounced``: the
    light that comes by way of other bone; ``first_row`` of the ``wall``: where the maps begin; ``apex_mm``: z of the
    mirror's apex; ``lined``: whether cells have a lining.
    """

    maps: Image
    shade: Image
    wet: Image | None
    bounced: Bounced
    first_row: int
    wall: WallMaps
    apex_mm: float
    lined: bool


def light(frame: FrameView, lit: LitSurface, pixels: View, hits: Hits) -> Image:
    """Return the light that arrives at each pixel of a view, float32 (1 or 3, n).

    1 is bone at normal incidence, lit directly, in the middle of the annulus of a probe on the bore's axis.
    """
    camera = frame.camera
    albedo, rim, slope_z, slope_theta = lookup_all(lit.maps, hits.row, hits.column)
    shades = lookup_all(lit.shade, hits.row, hits.column * np.float32(1 / EVERY_COLUMN))
    wet = None if lit.wet is None else lookup(lit.wet, hits.row, hits.column)
    deep_mm = np.maximum(hits.radius_mm - np.float32(frame.radius_mm), 0)
    z_mm = (hits.row + lit.first_row) * np.float32(lit.wall.dz_mm)
    theta_rad = hits.column * np.float32(lit.wall.dtheta_rad)
    at = LitPlaces(z_mm - np.float32(lit.apex_mm), theta_rad, hits.radius_mm, slope_z, slope_theta, *shades)
    diffuse, arriving = direct(frame, at)
    diffuse += lit.bounced.at(z_mm, theta_rad, hits.radius_mm)
    diffuse *= albedo
    leaning = slope_theta * hits.around
    leaning += slope_z * hits.inward
    steepness = slope_z * slope_z
    steepness += slope_theta * slope_theta
    gloss: float | Image = camera.gloss
    if wet is not None:
        diffuse *= 1 - camera.fluid_loss * wet
        gloss = gloss + camera.fluid_gloss * wet
        # a fluid's surface is smooth: what lies below it does not tilt it
        leaning *= 1 - wet
        steepness *= 1 - wet
    diffuse += rim

    facing = np.maximum(hits.outward - leaning, 1e-3)
    facing *= facing
    facing /= 1 + steepness
    lobe = 1 - 1 / np.minimum(facing, 1)
    lobe *= np.float32(0.5 / camera.gloss_rad**2)
    glossy = gloss * arriving * exp(lobe)

    outwards = pixels.r_px * np.float32(1 / camera.outer_px)
    through = 1 - np.float32(camera.vignetting) * outwards * outwards
    from_ring = (pixels.r_px - np.float32(camera.ring_px)) * np.float32(1 / RING_SIGMA_PX)
    added = np.float32(camera.ring_gain) * exp(np.float32(-0.5) * from_ring * from_ring)
    added += _droplet_shine(camera, pixels)
    kept = transmission(camera, pixels)
    white = (through * glossy + added) * kept
    diffuse *= through * kept
    if not camera.colour:
        return np.asarray((diffuse + white)[None], dtype=np.float32)
    lined = np.minimum(deep_mm / LINED_MM, 1) if lit.lined else None
    arrived = np.empty((3, diffuse.size), np.float32)
    for plane, bone, lining in zip(arrived, BONE_RGB, LINING_RGB, strict=True):
        np.multiply(diffuse, bone if lined is None else bone + lined * (lining - bone), out=plane)
        plane += white
    return arrived


def transmission(camera: Endoscope, pixels: View) -> Image:
    """Return which part of the light the dirt on the optics lets through, float32 (n,).

    A speck is a product of its courses across and down, so that these are enough to be worked out.
    """
    kept = np.ones(pixels.shape, np.float32)
    for speck in camera.dirt:
        reach = 5 * speck.sigma_px
        if not pixels.down_px[0] - reach <= speck.y_px <= pixels.down_px[-1] + reach:
            continue
        columns, rows = (
            slice(*np.searchsorted(axis, np.array([at - reach, at + reach], np.float32)))
            for axis, at in ((pixels.across_px, speck.x_px), (pixels.down_px, speck.y_px))
        )
        across, down = (
            np.exp((axis - np.float32(at)) ** 2 * np.float32(-0.5 / speck.sigma_px**2))
            for axis, at in ((pixels.across_px[columns], speck.x_px), (pixels.down_px[rows], speck.y_px))
        )
        kept[rows, columns] *= 1 - np.float32(speck.loss) * down[:, None] * across
    return kept.ravel().take(pixels.place)


def _droplet_shine(camera: Endoscope, pixels: View) -> Image:
    """Return the highlight of every droplet, towards the probe's axis from its middle."""
    shine = np.zeros_like(pixels.r_px)
    for drop in camera.droplets:
        away = 1 - 0.45 * drop.radius_px / max(1.0, float(np.hypot(drop.x_px, drop.y_px)))
        near = pixels.near(drop.x_px, drop.y_px, 2 * drop.radius_px)
        square = (pixels.x_px[near] - away * drop.x_px) ** 2 + (pixels.y_px[near] - away * drop.y_px) ** 2
        shine[near] += np.float32(drop.shine) * np.exp(-0.5 * square / np.float32(0.2 * drop.radius_px) ** 2)
    return shine


def _put(crumb: Debris, maps: Image, wall: WallMaps, first_row: int) -> None:
    """Draw a crumb into the wall's ``maps``: a rounded grain with a dark line of contact."""
    size, dz_mm, dtheta_mm = crumb.size_mm, wall.dz_mm, wall.dtheta_rad * wall.radius_mm
    middle = crumb.z_mm / dz_mm - first_row
    low, high = max(0, int(middle - 2 * size / dz_mm)), min(maps.shape[0], int(middle + 2 * size / dz_mm) + 2)
    if low >= high:
        return
    z = (dz_mm * (np.arange(low, high) - middle))[:, None]
    reach = int(2 * size / dtheta_mm) + 1
    column = crumb.theta_rad / wall.dtheta_rad
    columns = int(column) + np.arange(-reach, reach + 1)
    along = (dtheta_mm * (columns - column))[None, :]
    q = np.hypot(z, along) / size
    columns = np.mod(columns, maps.shape[1])
    part = maps[low:high, columns]
    grain = np.clip((1.05 - q) / 0.2, 0, 1)
    part[..., 0] *= 1 - CONTACT_SHADE * np.exp(-0.5 * ((q - 1.1) / 0.2) ** 2)
    part[..., 0] += grain * (crumb.gain - part[..., 0])
    for k, lean in ((2, z), (3, along)):
        part[..., k] += grain * (lean / size - part[..., k])
    maps[low:high, columns] = part


def obscured(camera: Endoscope, wall: WallMaps, pixels: View, hits: Hits) -> Mask:
    """Say for each pixel of a view whether dirt, a droplet or a crumb keeps it from showing the wall, bool (n,)."""
    hidden: Mask = transmission(camera, pixels) < 1 - OBSCURED
    for drop in camera.droplets:
        near = pixels.near(drop.x_px, drop.y_px, drop.radius_px)
        away = (pixels.x_px[near] - drop.x_px) ** 2 + (pixels.y_px[near] - drop.y_px) ** 2
        hidden[near] |= away < drop.radius_px**2
    theta = hits.column * wall.dtheta_rad
    z_mm = (hits.row + hits.first_row) * wall.dz_mm
    for crumb in camera.debris:
        size_mm = CONTACT_REACH * crumb.size_mm
        near = np.flatnonzero(np.abs(z_mm - crumb.z_mm) < size_mm)
        around = wall.radius_mm * (np.mod(theta[near] - crumb.theta_rad + np.pi, 2 * np.pi) - np.pi)
        hidden[near] |= (z_mm[near] - crumb.z_mm) ** 2 + around**2 < size_mm**2
    return hidden


def lighting_of(sample: Sample, wall: WallMaps) -> Lighting:
    """Return the lighting of a recording, with the gain that a person would set on its first frames.

    That is the one at which ``saturated`` of the annulus saturates, times ``exposure``.
    """
    camera = sample.endoscope
    unset = Lighting(shade_of(wall), facets_of(wall), 1.0, sample.bore.bone not in ("phantom", "tube"))
    frames = (FrameView.of(camera, k, wall.radius_mm) for k in range(min(METERED_FRAMES, len(camera.z_mm))))
    level = float(np.quantile(np.concatenate([_metered(frame, wall, unset) for frame in frames]), 1 - camera.saturated))
    return replace(unset, gain=camera.exposure / level)


def lit_frame(frame: FrameView, wall: WallMaps, lighting: Lighting) -> tuple[Visible, LitSurface]:
    """Return the rows of the wall that a frame can see, and what its light falls on there."""
    reached = visible(wall, frame)
    rows = slice(reached.first_row, reached.first_row + reached.relief_mm.shape[0])
    slopes = [np.clip(slope[rows], -STEEPEST_SLOPE, STEEPEST_SLOPE) for slope in (wall.slope_z, wall.slope_theta)]
    maps = np.asarray(cv2.merge([wall.albedo[rows], wall.rim[rows], *slopes]), dtype=np.float32)
    for crumb in frame.camera.debris:
        _put(crumb, maps, wall, reached.first_row)
    wet = wall.wet[rows]
    return reached, LitSurface(
        maps=maps,
        shade=lighting.shade[rows],
        wet=wet if wet.any() else None,
        bounced=bounced(frame, wall, lighting.facets, lighting.shade),
        first_row=reached.first_row,
        wall=wall,
        apex_mm=(reached.first_row + reached.apex_row) * wall.dz_mm,
        lined=lighting.lined,
    )


def _metered(frame: FrameView, wall: WallMaps, lighting: Lighting) -> Image:
    """Return the light of the brightest colour in some of a frame's pixels."""
    reached, lit = lit_frame(frame, wall, lighting)
    pixels = view(frame, slice(None, None, METERED_EVERY))
    found = light(frame, lit, pixels, follow(reached, frame, pixels))
    return np.asarray(found.max(axis=0), dtype=np.float32)
