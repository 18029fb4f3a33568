"""Where the endoscope's pixels look, and where on the wall that ends.

Every pixel of the annulus is one ray: off the cone, turned with the probe into the bore's frame, and followed to
the first place at which it is behind the wall's relief. float32 throughout: coordinates along the bore count from
the frame, so that rounding stays below 1e-6 mm.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.stitching.arrays import Image
from endoct.synthetic.cone import band_centre_mm, cone_of
from endoct.synthetic.parameters import Endoscope
from endoct.synthetic.wall import Wall

STEP_ACROSS_MM = 0.01
"""How far a ray goes along the wall between two looks: no farther than the wall's maps are fine."""
LONGEST_STEP_MM = 0.25
CLEARANCE_MM = 0.002
LOOKUP_COLUMNS = 1024


@dataclass(frozen=True, eq=False)
class View:
    """The pixels of the annulus, float32 (n,) each but the indices.

    ``pixel``: index into the flattened image; ``x_px``, ``y_px``: columns and rows from the annulus' centre, and
    ``r_px`` from it; ``look_x_px``, ``look_y_px``: where the pixel looks, which a droplet displaces.
    """

    pixel: NDArray[np.intp]
    x_px: Image
    y_px: Image
    r_px: Image
    look_x_px: Image
    look_y_px: Image


@dataclass(frozen=True, eq=False)
class Hits:
    """Where the rays of a view end, float32 (n,) each.

    ``row``, ``column``: on the wall's maps, fractional, rows counted from ``first_row``. ``radius_mm`` from the
    bore's axis. The ray's unit direction there: ``outward``, ``around`` (with θ) and ``inward`` (along z).
    ``path_mm``: from the pinhole over the mirror; ``rho_mm``: from the probe's axis; ``sine`` of the ray's angle at
    the pinhole.
    """

    first_row: int
    row: Image
    column: Image
    radius_mm: Image
    outward: Image
    around: Image
    inward: Image
    path_mm: Image
    rho_mm: Image
    sine: Image


@dataclass(frozen=True, eq=False)
class _Rays:
    """Rays in the bore's frame, each seen from its own azimuth ``theta_rad``; float32 (n,) each.

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

    def of(self, chosen: NDArray[np.intp]) -> "_Rays":
        return _Rays(*(getattr(self, field.name)[chosen] for field in fields(self)))

    def to_radius_mm(self, radius_mm: float) -> Image:
        """Return t where the rays meet the cylinder of ``radius_mm`` from inside."""
        a = self.u1 * self.u1 + self.v1 * self.v1
        b = self.u0 * self.u1 + self.v0 * self.v1
        c = self.u0 * self.u0 + self.v0 * self.v0 - radius_mm**2
        return np.asarray((np.sqrt(np.maximum(b * b - a * c, 0)) - b) / a)


@dataclass(frozen=True, eq=False)
class _Relief:
    """The part of the wall's relief that a frame can see; ``apex_row`` is the apex' place on its rows."""

    relief_mm: Image
    first_row: int
    apex_row: float
    rows_per_mm: float
    columns_per_rad: float
    radius_mm: float

    def at(self, rays: _Rays, t_mm: Image) -> tuple[Image, Image, Image, Image]:
        """Return how far behind the wall the rays are at ``t_mm``, and radius, row and column there."""
        u, v = rays.u0 + t_mm * rays.u1, rays.v0 + t_mm * rays.v1
        radius = np.sqrt(u * u + v * v)
        column = (rays.theta_rad + np.arcsin(np.clip(v / radius, -1, 1))) * np.float32(self.columns_per_rad)
        row = (rays.z0 + t_mm * rays.z1) * np.float32(self.rows_per_mm) + np.float32(self.apex_row)
        row = np.clip(row, 0, self.relief_mm.shape[0] - 1)
        return radius - np.float32(self.radius_mm) - lookup(self.relief_mm, row, column), radius, row, column


def lookup(maps: Image, row: Image, column: Image) -> Image:
    """Return maps (row, column) or (row, column, 2–4) at fractional places (n,), bilinear, cyclic in columns."""
    n = row.size
    shape = -(-n // LOOKUP_COLUMNS), LOOKUP_COLUMNS
    places = [np.pad(values, (0, shape[0] * shape[1] - n)).reshape(shape) for values in (column, row)]
    found = cv2.remap(maps, places[0], places[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    return np.asarray(found, dtype=np.float32).reshape(-1, *maps.shape[2:])[:n]


def view(camera: Endoscope, frame_index: int) -> View:
    """Return the pixels between the annulus' boundaries, of which the inner has a centre of its own."""
    cx, cy = camera.centre_px[frame_index]
    shift_x, shift_y = camera.inner_shift_px
    x = (np.arange(camera.width_px) - cx).astype(np.float32)[None, :]
    y = (np.arange(camera.height_px) - cy).astype(np.float32)[:, None]
    inner = (x - np.float32(shift_x)) ** 2 + (y - np.float32(shift_y)) ** 2 >= camera.inner_px**2
    pixel = np.flatnonzero(inner & (x**2 + y**2 <= camera.outer_px**2))
    row, column = np.divmod(pixel, camera.width_px)
    x, y = x[0, column], y[row, 0]
    look_x, look_y = x, y
    for drop in camera.droplets:
        near = np.flatnonzero((np.abs(x - drop.x_px) < drop.radius_px) & (np.abs(y - drop.y_px) < drop.radius_px))
        dx, dy = x[near] - np.float32(drop.x_px), y[near] - np.float32(drop.y_px)
        q = np.minimum((dx**2 + dy**2) / np.float32(drop.radius_px**2), 1)
        # a lens that is flat at its middle and its rim: q(1 − q²) is at most 2/√27
        bend = np.float32(drop.bend_px / drop.radius_px * math.sqrt(27) / 2) * (1 - q)
        look_x, look_y = look_x.copy(), look_y.copy()
        look_x[near] -= bend * dx
        look_y[near] -= bend * dy
    return View(pixel, x, y, np.sqrt(x**2 + y**2), look_x, look_y)


def follow(wall: Wall, camera: Endoscope, frame_index: int, seen: View) -> Hits:
    """Return where the pixels' rays meet the wall."""
    r_px = np.sqrt(seen.look_x_px**2 + seen.look_y_px**2)
    off_cone = cone_of(camera).rays(r_px)
    turn = camera.roll_rad[frame_index]
    cos, sin = seen.look_x_px / r_px, seen.look_y_px / r_px
    theta = np.arctan2(sin, cos) + np.float32(turn)
    cos, sin = _rotated(cos, sin, turn)
    starts = _leaned(camera, (off_cone.rho_mm * cos, off_cone.rho_mm * sin, off_cone.z_mm))
    ways = _leaned(camera, (off_cone.outward * cos, off_cone.outward * sin, off_cone.inward))
    x0, y0 = (start + np.float32(offset) for start, offset in zip(starts, camera.offset_mm[frame_index], strict=False))
    rays = _Rays(
        theta_rad=theta,
        u0=x0 * cos + y0 * sin,
        u1=ways[0] * cos + ways[1] * sin,
        v0=y0 * cos - x0 * sin,
        v1=ways[1] * cos - ways[0] * sin,
        z0=starts[2],
        z1=ways[2],
    )
    relief = _visible(wall, rays, camera.z_mm[frame_index] - band_centre_mm(camera, wall.radius_mm))
    t = _march(relief, rays)
    _, radius, row, column = relief.at(rays, t)
    u, v = rays.u0 + t * rays.u1, rays.v0 + t * rays.v1
    return Hits(
        first_row=relief.first_row,
        row=row,
        column=column,
        radius_mm=radius,
        outward=np.asarray((u * rays.u1 + v * rays.v1) / radius, dtype=np.float32),
        around=np.asarray((u * rays.v1 - v * rays.u1) / radius, dtype=np.float32),
        inward=rays.z1,
        path_mm=np.asarray(off_cone.path_mm, dtype=np.float32) + t,
        rho_mm=np.asarray(off_cone.rho_mm + t * off_cone.outward, dtype=np.float32),
        sine=np.asarray(off_cone.sine, dtype=np.float32),
    )


def _rotated(x: Image, y: Image, by_rad: float) -> tuple[Image, Image]:
    cos, sin = np.float32(math.cos(by_rad)), np.float32(math.sin(by_rad))
    return x * cos - y * sin, x * sin + y * cos


def _leaned(camera: Endoscope, vectors: Sequence[Image]) -> tuple[Image, Image, Image]:
    """Return vectors of the probe's frame in the bore's, into which the probe leans without turning about itself."""
    towards, tilt = camera.probe_tilt_direction_rad, camera.probe_tilt_rad
    along, across = _rotated(vectors[0], vectors[1], -towards)
    z, along = _rotated(vectors[2], along, tilt)
    x, y = _rotated(along, across, towards)
    return x, y, z


def _visible(wall: Wall, rays: _Rays, apex_mm: float) -> _Relief:
    """Return the relief between the rows that rays can reach before they are behind all of it."""
    least, most = float(wall.relief_mm.min()), float(wall.relief_mm.max())
    ends = [rays.z0 + rays.to_radius_mm(wall.radius_mm + relief) * rays.z1 for relief in (least, most)]
    apex_row, last = apex_mm / wall.dz_mm, wall.relief_mm.shape[0] - 1
    first_row = math.floor(apex_row + float(min(z.min() for z in ends)) / wall.dz_mm) - 2
    first_row = min(max(first_row, 0), last)
    stop = math.ceil(apex_row + float(max(z.max() for z in ends)) / wall.dz_mm) + 3
    return _Relief(
        relief_mm=wall.relief_mm[first_row : max(stop, first_row + 1)],
        first_row=first_row,
        apex_row=apex_row - first_row,
        rows_per_mm=1 / wall.dz_mm,
        columns_per_rad=1 / wall.dtheta_rad,
        radius_mm=wall.radius_mm,
    )


def _march(relief: _Relief, rays: _Rays) -> Image:
    """Return t where each ray falls behind the relief.

    A step goes as far as the ray stays over one place of the maps, so that no septum is stepped over; the place
    itself is then found between the last two looks by the rule of false position.
    """
    before = rays.to_radius_mm(relief.radius_mm + float(relief.relief_mm.min()) - CLEARANCE_MM)
    around = np.abs(rays.v1) + np.abs(rays.v0) / np.float32(relief.radius_mm)
    step = np.minimum(STEP_ACROSS_MM / np.maximum(np.hypot(rays.z1, around), 1e-6), LONGEST_STEP_MM)
    ahead, excess_ahead = before + step, np.empty_like(before)
    excess = relief.at(rays, before)[0]
    on, part = np.arange(before.size), rays
    while on.size:
        found = relief.at(part, ahead[on])[0]
        excess_ahead[on] = found
        on = on[found < 0]
        part = part.of(np.flatnonzero(found < 0))
        before[on], excess[on] = ahead[on], excess_ahead[on]
        ahead[on] += step[on]
    for _ in range(2):
        share = excess / np.minimum(excess - excess_ahead, -1e-12)
        middle = before + (ahead - before) * share
        found = relief.at(rays, middle)[0]
        short = found < 0
        before, excess = np.where(short, middle, before), np.where(short, found, excess)
        ahead, excess_ahead = np.where(short, ahead, middle), np.where(short, excess_ahead, found)
    share = excess / np.minimum(excess - excess_ahead, -1e-12)
    return np.asarray(before + (ahead - before) * share, dtype=np.float32)
