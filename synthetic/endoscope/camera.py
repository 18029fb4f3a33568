"""What the cone-mirror endoscope's camera records of the wall: one frame, as it is stored, also as a PNG file.

Light on the sensor becomes the stored image by noise, saturation, gamma, 8 bits and JPEG.
"""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from endoct.base.arrays import Image, Mask
from endoct.base.errors import EndoctError
from endoct.synthetic.bone.wall import WallMaps
from endoct.synthetic.endoscope.cone import FrameView
from endoct.synthetic.endoscope.lighting import Lighting, light, lit_frame, obscured
from endoct.synthetic.endoscope.sight import bands, follow, view, visible
from endoct.synthetic.sample.parameters import Endoscope, Sample
from endoct.synthetic.sample.randomness import Stage, bell, generator

LEVELS = 2**16
# The filter "up" with run lengths stores frames in a sixth less room than OpenCV's own choice, in a fifth less time.
_ENCODING = [
    cv2.IMWRITE_PNG_COMPRESSION, 1,
    cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE,
    cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_UP,
]  # fmt: skip
StoredFrame = bytes | NDArray[np.uint8]
"""A frame as it is stored: the bytes of a PNG file, or for a video the frame itself."""
LEAST_BLUR_PX = 0.1
BLEND_ROWS = 16
SURROUND_STEPS = 8
"""Steps of a pixel in which the light around the annulus is tabulated."""


def noisy(camera: Endoscope, signal: Image, rng: Generator) -> Image:
    """Return ``signal`` (1 is saturation) with shot and read noise.

    Its variance is signal/full_well + (read_noise/full_well)²; so many electrons are as good as normal.
    """
    sigma = signal * np.float32(1 / camera.full_well)
    sigma += np.float32((camera.read_noise / camera.full_well) ** 2)
    np.sqrt(sigma, out=sigma)
    sigma *= bell(rng, signal.size).reshape(signal.shape)
    sigma += signal
    return sigma


def displayed(signal: Image, gamma: float = 1.8) -> NDArray[np.uint8]:
    """Return ``signal`` clipped at saturation, to the power of 1/``gamma``, in 8 bits."""
    counts = signal * np.float32(LEVELS - 1)
    np.clip(counts, 0, LEVELS - 1, out=counts)
    return np.asarray(cv2.LUT(counts.astype(np.uint16), _display(gamma)), dtype=np.uint8).reshape(signal.shape)


@cache
def _display(gamma: float) -> NDArray[np.uint8]:
    return np.rint(255 * (np.arange(LEVELS) / (LEVELS - 1)) ** (1 / gamma)).astype(np.uint8)


def compressed(camera: Endoscope, frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return ``frame``, grey or RGB, as it comes out of JPEG compression."""
    quality = [cv2.IMWRITE_JPEG_QUALITY, round(camera.jpeg_quality)]
    done, data = cv2.imencode(".jpg", cv2.cvtColor(frame, cv2.COLOR_RGB2BGR) if frame.ndim == 3 else frame, quality)
    decoded = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if done else None
    if decoded is None:
        raise EndoctError("a frame could not be compressed as JPEG")
    return np.asarray(cv2.cvtColor(decoded, cv2.COLOR_BGR2RGB) if decoded.ndim == 3 else decoded, dtype=np.uint8)


def png(frame: NDArray[np.uint8]) -> bytes:
    """Return a frame, u8 (row, column) or (row, column, RGB), as the bytes of a PNG file."""
    stored = cv2.cvtColor(frame, cv2.COLOR_RGB2BGR) if frame.ndim == 3 else frame
    done, data = cv2.imencode(".png", stored, _ENCODING)
    if not done:
        raise EndoctError("a frame could not be encoded as PNG", found=f"{frame.dtype} {frame.shape}")
    return np.asarray(data, dtype=np.uint8).tobytes()


@dataclass(frozen=True, eq=False)
class PixelMaps:
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


def render_frame(sample: Sample, wall: WallMaps, lighting: Lighting, frame_index: int) -> NDArray[np.uint8]:
    """Return frame ``frame_index``, u8 (row, column) or (row, column, RGB)."""
    camera = sample.endoscope
    rng = generator(sample.seed, Stage.ENDOSCOPE, 1 + frame_index)
    signal = _signal(sample, wall, lighting, frame_index)
    frame = np.empty(signal.shape, np.uint8)
    for rows in bands(camera):
        frame[rows] = displayed(noisy(camera, signal[rows], rng), camera.gamma)
    return compressed(camera, frame)


def stored_frame(sample: Sample, wall: WallMaps, lighting: Lighting, frame_index: int) -> StoredFrame:
    """Return :func:`render_frame` as it is stored."""
    frame = render_frame(sample, wall, lighting, frame_index)
    return frame if sample.endoscope.storage == "video" else png(frame)


def noise_free(sample: Sample, wall: WallMaps, lighting: Lighting, frame_index: int) -> NDArray[np.uint8]:
    """Return a frame without noise and compression, u8 as :func:`render_frame`."""
    return displayed(_signal(sample, wall, lighting, frame_index), sample.endoscope.gamma)


def pixel_maps(sample: Sample, wall: WallMaps, frame_index: int) -> PixelMaps:
    """Return what every pixel of a frame sees of the wall."""
    camera = sample.endoscope
    shape = camera.height_px, camera.width_px
    z_mm, theta_rad, depth_mm = (np.full(shape, np.nan, np.float32) for _ in range(3))
    cell, hidden, valid = np.zeros(shape, np.int32), np.zeros(shape, np.bool_), np.zeros(shape, np.bool_)
    n_z, n_theta = wall.relief_mm.shape
    frame = FrameView.of(camera, frame_index, wall.radius_mm)
    reached = visible(wall, frame)
    for rows in bands(camera):
        pixels = view(frame, rows)
        if not pixels.pixel.size:
            continue
        hits = follow(reached, frame, pixels)
        z_mm.flat[pixels.pixel] = (hits.row + hits.first_row) * wall.dz_mm
        theta_rad.flat[pixels.pixel] = np.mod(hits.column * wall.dtheta_rad, 2 * np.pi)
        depth_mm.flat[pixels.pixel] = hits.radius_mm - wall.radius_mm
        row = np.clip(np.rint(hits.row).astype(np.intp) + hits.first_row, 0, n_z - 1)
        cell.flat[pixels.pixel] = wall.cell_id[row, np.mod(np.rint(hits.column).astype(np.intp), n_theta)]
        hidden.flat[pixels.pixel] = obscured(camera, wall, pixels, hits)
        valid.flat[pixels.pixel] = True
    return PixelMaps(z_mm, theta_rad, depth_mm, cell, hidden, valid)


def _signal(sample: Sample, wall: WallMaps, lighting: Lighting, frame_index: int) -> Image:
    """Return the light on the sensor, float32 (row, column) or (row, column, RGB), 1 is saturation."""
    camera = sample.endoscope
    frame = FrameView.of(camera, frame_index, wall.radius_mm)
    reached, lit = lit_frame(frame, wall, lighting)
    around = _Surround(frame, sample.seed)
    colours = 3 if camera.colour else 1
    image = np.empty((camera.height_px, camera.width_px, colours), np.float32)
    for rows in bands(camera):
        pixels = view(frame, rows)
        planes = np.repeat(around.light(rows)[None], colours, axis=0)
        if pixels.pixel.size:
            arrived = light(frame, lit, pixels, follow(reached, frame, pixels))
            arrived *= np.float32(lighting.gain)
            for plane, colour in zip(planes, arrived, strict=True):
                plane.ravel()[pixels.place] += colour
        image[rows] = cv2.merge(list(planes)).reshape(image[rows].shape)
    _defocus(frame, image)
    return image if camera.colour else image[..., 0]


def _defocus(frame: FrameView, image: Image) -> None:
    """Blur an image in place by ``defocus_px`` at the rim in focus, and by more towards the other."""
    camera, (cx, cy) = frame.camera, frame.centre_px
    reach = camera.outer_px + 4 * (camera.defocus_px + camera.defocus_slope_px) + 1
    left, top = max(0, int(cx - reach)), max(0, int(cy - reach))
    box = image[top : int(cy + reach) + 2, left : int(cx + reach) + 2]
    sharp = _blurred(box, camera.defocus_px)
    if camera.defocus_slope_px < LEAST_BLUR_PX:
        box[:] = sharp
        return
    soft = _blurred(box, camera.defocus_px + camera.defocus_slope_px)
    in_focus, out_of_focus = camera.inner_px, camera.outer_px
    if camera.focus_at_outer:
        in_focus, out_of_focus = out_of_focus, in_focus
    for first in range(0, box.shape[0], BLEND_ROWS):
        rows = slice(first, min(first + BLEND_ROWS, box.shape[0]))
        share = _distance_px(frame, range(top + first, top + rows.stop), range(left, left + box.shape[1]))
        share -= in_focus
        share *= 1 / (out_of_focus - in_focus)
        np.clip(share, 0, 1, out=share)
        part = soft[rows]
        part -= sharp[rows]
        part *= cv2.merge([share] * part.shape[2]).reshape(part.shape)
        np.add(part, sharp[rows], out=box[rows])


def _blurred(image: Image, sigma_px: float) -> Image:
    if sigma_px < LEAST_BLUR_PX:
        return image.copy()
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px), dtype=np.float32).reshape(image.shape)


def _distance_px(frame: FrameView, rows: range, columns: range, shift: tuple[float, float] = (0.0, 0.0)) -> Image:
    """Return the distance of pixels from the annulus' centre, or from a place next to it."""
    cx, cy = frame.centre_px
    x = (np.arange(columns.start, columns.stop) - cx - shift[0]).astype(np.float32)[None, :]
    y = (np.arange(rows.start, rows.stop) - cy - shift[1]).astype(np.float32)[:, None]
    square = x * x + y * y
    return np.asarray(np.sqrt(square, out=square))


class _Surround:
    """What the camera sees besides the wall: the black level, a glow about the outer rim, and the cone's tip with
    the camera in it.
    """

    def __init__(self, frame: FrameView, seed: int) -> None:
        self._frame = frame
        camera, rng = frame.camera, generator(seed, Stage.ENDOSCOPE, 0)
        tip_gain, glow_gain, lens_gain, lens_size = (
            0.05 * rng.random(), rng.uniform(0.01, 0.03), rng.uniform(0.2, 0.9), rng.uniform(0.05, 0.15)
        )  # fmt: skip
        radii = np.arange(2 * SURROUND_STEPS * int(camera.outer_px + 1)) / SURROUND_STEPS
        glow = 0.015 + glow_gain * np.exp(-(((radii / camera.outer_px - 1) / 0.05) ** 2))
        inner = radii / camera.inner_px
        tip = 0.05 + tip_gain * np.cos(5 * inner) ** 2 + lens_gain * np.exp(-0.5 * (inner / lens_size) ** 2)
        self._glow, self._tip = glow.astype(np.float32), tip.astype(np.float32)

    def light(self, rows: slice) -> Image:
        """Return the surround in some rows of the image, float32."""
        camera = self._frame.camera
        places = range(rows.start, rows.stop), range(camera.width_px)
        surround = _tabulated(self._glow, _distance_px(self._frame, *places))
        r_inner = _distance_px(self._frame, *places, camera.inner_shift_px)
        within = r_inner < 0.97 * camera.inner_px
        surround[within] = _tabulated(self._tip, r_inner[within])
        return surround


def _tabulated(values: Image, r_px: Image) -> Image:
    return values.take((r_px * SURROUND_STEPS).astype(np.intp), mode="clip")
