"""What the cone-mirror endoscope's camera records of the wall: one frame."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from endoct.stitching.arrays import Coordinates, Image
from endoct.synthetic.cone import cone_rays, wall_z_mm
from endoct.synthetic.parameters import Endoscope, Sample
from endoct.synthetic.randomness import Stage, generator
from endoct.synthetic.wall import Wall

STEP_MM = 0.015
DEEPEST_MM = 1.9
BONE_RGB = (1.0, 0.88, 0.72)
LINING_RGB = (1.0, 0.70, 0.60)


@dataclass(frozen=True, eq=False)
class Sight:
    """Where the pixels of an annulus look; float64 (n,) each: image ``angle_rad``, ray, and pixel indices."""

    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    r_px: Coordinates
    angle_rad: Coordinates


def render_frame(sample: Sample, wall: Wall, frame_index: int) -> NDArray[np.uint8]:
    """Return frame ``frame_index``, u8 (row, column) or (row, column, RGB)."""
    camera = sample.endoscope
    rng = generator(sample.seed, Stage.ENDOSCOPE, 1 + frame_index)
    sight = _sight(camera, frame_index)
    light = _light(wall, camera, frame_index, sight)
    image = np.zeros((camera.height_px, camera.width_px, light.shape[1]), np.float32)
    image[sight.rows, sight.columns] = light
    image += _surround(sample, frame_index)[:, :, None]
    blurred = cv2.GaussianBlur(image, (0, 0), camera.defocus_px).reshape(image.shape)
    return _exposed(camera, np.asarray(blurred, dtype=np.float32), rng)


def _sight(camera: Endoscope, frame_index: int) -> Sight:
    """Return the pixels between the annulus' boundaries, of which the inner has a centre of its own."""
    cx, cy = camera.centre_px[frame_index]
    y, x = np.mgrid[: camera.height_px, : camera.width_px]
    r = np.hypot(x - cx, y - cy)
    r_inner = np.hypot(x - cx - camera.inner_shift_px[0], y - cy - camera.inner_shift_px[1])
    rows, columns = np.nonzero((r <= camera.outer_px) & (r_inner >= camera.inner_px))
    return Sight(rows, columns, r[rows, columns], np.arctan2(rows - cy, columns - cx))


def band_centre_mm(camera: Endoscope, radius_mm: float) -> float:
    """Return z from the cone's apex to the middle of the band that the annulus shows of the nominal wall."""
    edges = np.array([camera.inner_px, camera.outer_px])
    half_angle = np.deg2rad(camera.half_angle_deg)
    return float(wall_z_mm(edges, camera.focal_px, camera.mirror_distance_mm, half_angle, radius_mm).mean())


def _light(wall: Wall, camera: Endoscope, frame_index: int, sight: Sight) -> Image:
    """Return the light that arrives at each pixel, (n, 1 or 3), 1 is saturation."""
    rays = cone_rays(sight.r_px, camera.focal_px, camera.mirror_distance_mm, np.deg2rad(camera.half_angle_deg))
    theta_ray = sight.angle_rad + camera.roll_rad[frame_index]
    apex_mm = camera.z_mm[frame_index] - band_centre_mm(camera, wall.radius_mm)
    probe = camera.offset_mm[frame_index]
    rho = _march(wall, rays.rho_mm, rays.z_mm + apex_mm, rays.slope, theta_ray, probe)
    z = rays.z_mm + apex_mm + (rho - rays.rho_mm) * rays.slope
    x, y = probe[0] + rho * np.cos(theta_ray), probe[1] + rho * np.sin(theta_ray)
    theta = np.arctan2(y, x)
    deep_mm = np.clip(np.hypot(x, y) - wall.radius_mm, 0, None)

    # the light comes from the probe, about the way the ray looks
    slope_z, slope_theta = (np.clip(wall.at(m, z, theta), -8, 8) for m in (wall.slope_z, wall.slope_theta))
    cosine = np.clip(1 - slope_z * rays.slope, 0, None) / np.sqrt(1 + slope_z**2 + slope_theta**2)
    cosine /= np.sqrt(1 + rays.slope**2)
    distance = (wall.radius_mm / rho) ** 2
    fall_off = camera.stray + (1 - camera.stray) * np.exp(-deep_mm / camera.fall_off_mm)
    reflected = wall.at(wall.albedo, z, theta) * (0.15 + 0.85 * cosine) * distance * fall_off
    reflected += wall.at(wall.rim, z, theta)

    middle, half = (camera.inner_px + camera.outer_px) / 2, (camera.outer_px - camera.inner_px) / 2
    light = camera.exposure * reflected * (1 - camera.vignetting * ((sight.r_px - middle) / half) ** 2)
    light *= 1 + camera.bright_side * np.cos(sight.angle_rad - camera.bright_side_rad)
    light += camera.ring_gain * np.exp(-0.5 * ((sight.r_px - camera.ring_px) / 1.5) ** 2)
    dx, dy = sight.r_px * np.cos(sight.angle_rad), sight.r_px * np.sin(sight.angle_rad)
    for speck in camera.dirt:
        near = np.flatnonzero(np.abs(dx - speck.x_px) < 5 * speck.sigma_px)
        away = (dx[near] - speck.x_px) ** 2 + (dy[near] - speck.y_px) ** 2
        light[near] *= 1 - speck.loss * np.exp(-0.5 * away / speck.sigma_px**2)
    if not camera.colour:
        return np.asarray(light[:, None], dtype=np.float32)
    lined = np.clip(deep_mm / 0.1, 0, 1)[:, None]
    tint = (1 - lined) * np.array(BONE_RGB) + lined * np.array(LINING_RGB)
    return np.asarray(light[:, None] * tint, dtype=np.float32)


def _march(
    wall: Wall,
    rho0_mm: Coordinates,
    z0_mm: Coordinates,
    slope: Coordinates,
    theta_rad: Coordinates,
    probe_mm: tuple[float, float],
) -> Coordinates:
    """Return the distance ρ from the probe's axis at which each ray falls behind the wall."""
    cos, sin = np.cos(theta_rad), np.sin(theta_rad)

    def behind(ray: NDArray[np.intp], rho: Coordinates) -> Coordinates:
        x, y = probe_mm[0] + rho * cos[ray], probe_mm[1] + rho * sin[ray]
        z = z0_mm[ray] + (rho - rho0_mm[ray]) * slope[ray]
        excess: Coordinates = np.hypot(x, y) - wall.radius_mm - wall.at(wall.relief_mm, z, np.arctan2(y, x))
        return excess

    ray = np.arange(theta_rad.size)
    lowest = wall.radius_mm + float(wall.relief_mm.min()) - 0.005
    across = probe_mm[0] * sin - probe_mm[1] * cos
    rho = np.sqrt(lowest**2 - across**2) - (probe_mm[0] * cos + probe_mm[1] * sin)
    before = behind(ray, rho)
    found = np.full(theta_rad.size, wall.radius_mm + DEEPEST_MM)
    while ray.size:
        ahead = rho + STEP_MM
        excess = behind(ray, ahead)
        hit = excess >= 0
        found[ray[hit]] = (rho + STEP_MM * before / (before - excess))[hit]
        on = ~hit & (ahead < wall.radius_mm + DEEPEST_MM)
        ray, rho, before = ray[on], ahead[on], excess[on]
    return found


def _surround(sample: Sample, frame_index: int) -> Image:
    """Return what the camera sees besides the wall: black level, the cone's tip with the camera in it."""
    camera = sample.endoscope
    rng = generator(sample.seed, Stage.ENDOSCOPE, 0)
    cx, cy = camera.centre_px[frame_index]
    y, x = np.mgrid[: camera.height_px, : camera.width_px]
    inner = np.hypot(x - cx - camera.inner_shift_px[0], y - cy - camera.inner_shift_px[1]) / camera.inner_px
    tip = 0.05 + 0.05 * rng.random() * np.cos(5 * inner) ** 2
    glow = 0.015 + rng.uniform(0.01, 0.03) * np.exp(-(((np.hypot(x - cx, y - cy) / camera.outer_px - 1) / 0.05) ** 2))
    lens = rng.uniform(0.2, 0.9) * np.exp(-0.5 * (inner / rng.uniform(0.05, 0.15)) ** 2)
    surround: Image = np.where(inner < 0.97, tip + lens, glow).astype(np.float32)
    return surround


def _exposed(camera: Endoscope, image: Image, rng: Generator) -> NDArray[np.uint8]:
    """Return the image with shot and read noise, a display gamma of 1/1.8, clipped and quantised."""
    noise = rng.standard_normal(image.shape, dtype=np.float32)
    image = np.clip(image, 0, None)
    electrons = image * camera.full_well + noise * np.sqrt(image * camera.full_well + camera.read_noise**2)
    display = np.clip(electrons / camera.full_well, 0, 1) ** (1 / 1.8)
    frame: NDArray[np.uint8] = np.rint(255 * display).astype(np.uint8)
    return frame if camera.colour else frame[:, :, 0]
