"""What the cone-mirror endoscope's camera records of the wall: one frame."""

from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.stitching.arrays import Image, Mask
from endoct.synthetic.cone import band_centre_mm
from endoct.synthetic.light import light, obscured
from endoct.synthetic.parameters import Endoscope, Sample
from endoct.synthetic.randomness import Stage, generator
from endoct.synthetic.sensor import compressed, displayed, noisy
from endoct.synthetic.sight import follow, view
from endoct.synthetic.wall import Wall

__all__ = ["Seen", "band_centre_mm", "noise_free", "render_frame", "sight"]

Pixel = TypeVar("Pixel", bound=np.generic)

LEAST_BLUR_PX = 0.1
SURROUND_STEPS = 8
"""Steps of a pixel in which the light around the annulus is tabulated."""


@dataclass(frozen=True, eq=False)
class Seen:
    """What every pixel of a frame sees of the wall, maps (row, column) of the image.

    ``z_mm`` from the mouth, ``theta_rad`` in [0, 2π) and ``depth_mm`` below the nominal radius, float32 in the
    bore frame, NaN outside the annulus; ``cell``: int32, 1 + the cell's index in the sample, 0 for the bore's own
    wall and outside; ``obscured``: dirt, a droplet or a crumb hides the wall there; ``valid``: the pixel sees the
    wall.
    """

    z_mm: Image
    theta_rad: Image
    depth_mm: Image
    cell: NDArray[np.int32]
    obscured: Mask
    valid: Mask


def render_frame(sample: Sample, wall: Wall, frame_index: int) -> NDArray[np.uint8]:
    """Return frame ``frame_index``, u8 (row, column) or (row, column, RGB)."""
    camera = sample.endoscope
    rng = generator(sample.seed, Stage.ENDOSCOPE, 1 + frame_index)
    return compressed(camera, displayed(noisy(camera, _signal(sample, wall, frame_index), rng)))


def noise_free(sample: Sample, wall: Wall, frame_index: int) -> NDArray[np.uint8]:
    """Return the twin of a frame without noise and compression, u8 as :func:`render_frame`."""
    return displayed(_signal(sample, wall, frame_index))


def sight(sample: Sample, wall: Wall, frame_index: int) -> Seen:
    """Return what every pixel of a frame sees of the wall."""
    camera = sample.endoscope
    seen = view(camera, frame_index)
    hits = follow(wall, camera, frame_index, seen)
    n_z, n_theta = wall.relief_mm.shape
    z_mm = (hits.row + hits.first_row) * wall.dz_mm
    row = np.clip(np.rint(hits.row).astype(np.intp) + hits.first_row, 0, n_z - 1)
    column = np.mod(np.rint(hits.column).astype(np.intp), n_theta)

    def on_image(values: NDArray[Pixel], elsewhere: float) -> NDArray[Pixel]:
        image = np.full(camera.height_px * camera.width_px, elsewhere, values.dtype)
        image[seen.pixel] = values
        return image.reshape(camera.height_px, camera.width_px)

    return Seen(
        z_mm=on_image(z_mm.astype(np.float32), np.nan),
        theta_rad=on_image(np.mod(hits.column * wall.dtheta_rad, 2 * np.pi).astype(np.float32), np.nan),
        depth_mm=on_image((hits.radius_mm - wall.radius_mm).astype(np.float32), np.nan),
        cell=on_image(wall.cell_id[row, column], 0),
        obscured=on_image(obscured(camera, wall, seen, hits), False),
        valid=on_image(np.ones(seen.pixel.size, bool), False),
    )


def _signal(sample: Sample, wall: Wall, frame_index: int) -> Image:
    """Return the light on the sensor, float32 (row, column) or (row, column, RGB), 1 is saturation."""
    camera = sample.endoscope
    seen = view(camera, frame_index)
    arrived = light(sample, wall, seen, follow(wall, camera, frame_index, seen))
    around, r_px = _surround(sample, frame_index)
    image = np.repeat(around.reshape(-1, 1), arrived.shape[1], axis=1)
    image[seen.pixel] += arrived
    image = image.reshape(*around.shape, -1)
    cx, cy = camera.centre_px[frame_index]
    reach = camera.outer_px + 4 * (camera.defocus_px + camera.defocus_slope_px) + 1
    box = (
        slice(max(0, int(cy - reach)), int(cy + reach) + 2),
        slice(max(0, int(cx - reach)), int(cx + reach) + 2),
    )
    image[box] = _defocused(camera, image[box], r_px[box])
    return image if camera.colour else image[..., 0]


def _defocused(camera: Endoscope, image: Image, r_px: Image) -> Image:
    """Return an image blurred by ``defocus_px`` at the rim in focus, and by more towards the other."""
    sharp = _blurred(image, camera.defocus_px)
    if camera.defocus_slope_px < LEAST_BLUR_PX:
        return sharp
    soft = _blurred(image, camera.defocus_px + camera.defocus_slope_px)
    share = np.clip((r_px - camera.inner_px) / (camera.outer_px - camera.inner_px), 0, 1)
    if camera.focus_at_outer:
        share = 1 - share
    soft -= sharp
    soft *= share[:, :, None]
    soft += sharp
    return soft


def _blurred(image: Image, sigma_px: float) -> Image:
    if sigma_px < LEAST_BLUR_PX:
        return image.copy()
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px), dtype=np.float32).reshape(image.shape)


def _surround(sample: Sample, frame_index: int) -> tuple[Image, Image]:
    """Return what the camera sees besides the wall, and every pixel's distance from the annulus' centre.

    That is the black level, a glow about the outer rim, and the cone's tip with the camera in it.
    """
    camera = sample.endoscope
    rng = generator(sample.seed, Stage.ENDOSCOPE, 0)
    tip_gain, glow_gain, lens_gain, lens_size = (
        0.05 * rng.random(), rng.uniform(0.01, 0.03), rng.uniform(0.2, 0.9), rng.uniform(0.05, 0.15)
    )  # fmt: skip

    def distance_px(shift: tuple[float, float]) -> Image:
        cx, cy = camera.centre_px[frame_index]
        x = (np.arange(camera.width_px) - cx - shift[0]).astype(np.float32)[None, :]
        y = (np.arange(camera.height_px) - cy - shift[1]).astype(np.float32)[:, None]
        return np.asarray(np.sqrt(x**2 + y**2))

    def tabulated(r_px: Image, values: Image) -> Image:
        return np.asarray(values[np.minimum((r_px * SURROUND_STEPS).astype(np.int32), values.size - 1)])

    r_px = distance_px((0.0, 0.0))
    radii = np.arange(2 * SURROUND_STEPS * int(camera.outer_px + 1)) / SURROUND_STEPS
    glow = 0.015 + glow_gain * np.exp(-(((radii / camera.outer_px - 1) / 0.05) ** 2))
    inner = radii / camera.inner_px
    tip = 0.05 + tip_gain * np.cos(5 * inner) ** 2 + lens_gain * np.exp(-0.5 * (inner / lens_size) ** 2)
    surround = tabulated(r_px, glow.astype(np.float32))
    r_inner = distance_px(camera.inner_shift_px)
    within = r_inner < 0.97 * camera.inner_px
    surround[within] = tabulated(r_inner[within], tip.astype(np.float32))
    return surround, r_px
