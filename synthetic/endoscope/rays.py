"""The rays of the endoscope's pixels: off the cone, and turned with the probe into the bore's frame; float32."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from endoct.stitching.arrays import Image
from endoct.synthetic.elementary import azimuth
from endoct.synthetic.endoscope.cone import cone_of
from endoct.synthetic.sample.parameters import Endoscope


@dataclass(frozen=True, eq=False)
class Rays:
    """Rays in the bore's frame, each relative to its own azimuth ``theta_rad``; float32 (n,) each.

    At a distance t from the cone a ray is at u0 + t·u1 along its azimuth, v0 + t·v1 across it (towards larger θ),
    and at z = z0 + t·z1 from the apex.
    """

    theta_rad: Image
    u0: Image
    u1: Image
    v0: Image
    v1: Image
    z0: Image
    z1: Image

    def of(self, chosen: NDArray[np.intp]) -> "Rays":
        """Return some of the rays."""
        parts = self.theta_rad, self.u0, self.u1, self.v0, self.v1, self.z0, self.z1
        return Rays(*(values.take(chosen) for values in parts))

    def to_radius_mm(self, radius_mm: float) -> Image:
        """Return t where the rays meet the cylinder of ``radius_mm`` from inside."""
        a = self.u1 * self.u1 + self.v1 * self.v1
        b = self.u0 * self.u1 + self.v0 * self.v1
        c = self.u0 * self.u0 + self.v0 * self.v0 - radius_mm**2
        return np.asarray((np.sqrt(np.maximum(b * b - a * c, 0)) - b) / a)


def rays_of(camera: Endoscope, frame_index: int, x_px: Image, y_px: Image) -> Rays:
    """Return the rays of places of the image, counted from the annulus' centre."""
    r_px = np.sqrt(x_px * x_px + y_px * y_px)
    off_cone = cone_of(camera).rays(r_px)
    turn = camera.roll_rad[frame_index]
    per_px = np.asarray(1 / r_px, dtype=np.float32)
    cos, sin = x_px * per_px, y_px * per_px
    theta = azimuth(cos, sin)
    theta += np.float32(turn)
    # within a turn, as looking maps up beyond their edges takes ten times as long
    theta -= np.float32(2 * np.pi) * np.floor(theta * np.float32(0.5 / np.pi))
    cos, sin = _rotated(cos, sin, turn)
    starts = leaned(camera, (off_cone.rho_mm * cos, off_cone.rho_mm * sin, off_cone.z_mm))
    ways = leaned(camera, (off_cone.outward * cos, off_cone.outward * sin, off_cone.inward))
    x0, y0 = (start + np.float32(offset) for start, offset in zip(starts, camera.offset_mm[frame_index], strict=False))
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
