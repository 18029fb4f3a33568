"""Where the endoscope's pixels look, and where on the wall that ends.

Every pixel of the annulus is one ray off the cone. It is turned with the probe into the bore's frame, and followed to
the first place at which it is behind the wall's relief. Everything is float32. Coordinates along the bore
count from the frame, so that rounding stays below 1e-6 mm. Frames are worked on in bands of rows, whose arrays fit a
cache.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Image
from endoct.synthetic.bone.wall import WallMaps
from endoct.synthetic.endoscope.cone import FrameView, Rays, rays_of
from endoct.synthetic.sample.parameters import Endoscope

STEP_ACROSS_MM = 0.01
"""A ray goes this far along the wall between two looks, about the resolution of the wall's maps."""
LONGEST_STEP_MM = 0.25
CLEARANCE_MM = 0.002
LOOKUP_COLUMNS = 2**14
"""Places that are looked up at once; an image may not be wider than 2¹⁵."""
BAND_PX = 80_000
RIM_PLACES = 64
"""Places around a rim at which its rays are followed to find how much of the wall a frame can see."""


@dataclass(frozen=True, eq=False)
class View:
    """Pixels of the annulus in a band of rows, row by row, float32 (n,) each but the indices.

    ``pixel``: index into the flattened image, ``place``: into the flattened band, whose columns lie at ``across_px``
    and whose rows at ``down_px`` from the annulus' centre; ``x_px``, ``y_px``: columns and rows from that centre,
    ``r_px`` from it; ``look_x_px``, ``look_y_px``: where the pixel looks, which a droplet displaces.
    """

    pixel: NDArray[np.intp]
    place: NDArray[np.intp]
    across_px: Image
    down_px: Image
    x_px: Image
    y_px: Image
    r_px: Image
    look_x_px: Image
    look_y_px: Image

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the band."""
        return self.down_px.size, self.across_px.size

    def near(self, x_px: float, y_px: float, reach_px: float) -> NDArray[np.intp]:
        """Return which of the pixels are in the square of ``reach_px`` about a place."""
        first, stop = np.searchsorted(self.y_px, np.array([y_px - reach_px, y_px + reach_px], np.float32))
        near = np.flatnonzero(np.abs(self.x_px[first:stop] - np.float32(x_px)) < reach_px)
        return np.asarray(near + first, dtype=np.intp)


@dataclass(frozen=True, eq=False)
class Hits:
    """Where the rays of a view end, float32 (n,) each.

    ``row``, ``column``: on the wall's maps, fractional, rows counted from ``first_row``. ``radius_mm`` from the
    bore's axis. The ray's unit direction there: ``outward``, ``around`` (with θ) and ``inward`` (along z).
    """

    first_row: int
    row: Image
    column: Image
    radius_mm: Image
    outward: Image
    around: Image
    inward: Image


@dataclass(frozen=True, eq=False)
class Visible:
    """The rows of a wall that a frame can see, from ``first_row``; ``apex_row`` is the apex' place among them.

    ``relief_mm`` is that of the wall, between ``least_mm`` and beyond.
    """

    relief_mm: Image
    least_mm: float
    first_row: int
    apex_row: float
    rows_per_mm: float
    columns_per_rad: float
    radius_mm: float

    def behind(self, rays: Rays, t_mm: Image) -> Image:
        """Return how far behind the wall the rays are at ``t_mm``."""
        behind, row, column = self.place(rays, t_mm)
        behind -= np.float32(self.radius_mm)
        behind -= lookup(self.relief_mm, row, column)
        return behind

    def place(self, rays: Rays, t_mm: Image) -> tuple[Image, Image, Image]:
        """Return the radius of the rays' places at ``t_mm``, and their row and column."""
        v = t_mm * rays.v1
        v += rays.v0
        radius = t_mm * rays.u1
        radius += rays.u0
        radius *= radius
        radius += v * v
        np.sqrt(radius, out=radius)
        v /= radius
        column = _arcsine(v)
        column += rays.theta_rad
        column *= np.float32(self.columns_per_rad)
        row = t_mm * rays.z1
        row += rays.z0
        row *= np.float32(self.rows_per_mm)
        row += np.float32(self.apex_row)
        np.maximum(row, 0, out=row)
        np.minimum(row, self.relief_mm.shape[0] - 1, out=row)
        return radius, row, column


def _arcsine(x: Image) -> Image:
    """Return the arcsine, to 1e-6 up to 0.3: probes are hardly off the axis, and this is fast."""
    square = x * x
    series = square * np.float32(15 / 336)
    series += np.float32(3 / 40)
    series *= square
    series += np.float32(1 / 6)
    series *= square
    series += 1
    series *= x
    return series


def lookup(maps: Image, row: Image, column: Image) -> Image:
    """Return maps (row, column) or (row, column, 2–4) at fractional places (n,), bilinear, cyclic in columns."""
    values = np.empty((row.size, *maps.shape[2:]), np.float32)
    for first in range(0, row.size, LOOKUP_COLUMNS):
        part = slice(first, first + LOOKUP_COLUMNS)
        values[part] = cv2.remap(
            maps, column[None, part], row[None, part], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP
        )[0]
    return values


def lookup_all(maps: Image, row: Image, column: Image) -> list[Image]:
    """Return what :func:`lookup` finds in each of the maps (row, column, 2–4)."""
    found = cv2.split(lookup(maps, row, column)[None])
    return [np.asarray(one, dtype=np.float32).ravel() for one in found]


def bands(camera: Endoscope) -> Iterator[slice]:
    """Yield the rows of an image, band by band."""
    rows = max(1, BAND_PX // camera.width_px)
    for first in range(0, camera.height_px, rows):
        yield slice(first, min(first + rows, camera.height_px))


def view(frame: FrameView, rows: slice = slice(None)) -> View:
    """Return the pixels between the annulus' boundaries, of which the inner has a centre of its own, in some rows."""
    camera, (cx, cy) = frame.camera, frame.centre_px
    shift_x, shift_y = camera.inner_shift_px
    across = (np.arange(camera.width_px) - cx).astype(np.float32)
    image_rows = np.arange(camera.height_px)[rows]
    down = (image_rows - cy).astype(np.float32)
    square = down[:, None] ** 2 + across**2
    inside = (down[:, None] - np.float32(shift_y)) ** 2 + (across - np.float32(shift_x)) ** 2 >= camera.inner_px**2
    inside &= square <= camera.outer_px**2
    place = np.flatnonzero(inside)
    row, column = np.divmod(place, camera.width_px)
    x, y = across[column], down[row]
    r = np.sqrt(square.ravel()[place])
    pixels = View(image_rows[row] * camera.width_px + column, place, across, down, x, y, r, x.copy(), y.copy())
    for drop in camera.droplets:
        near = pixels.near(drop.x_px, drop.y_px, drop.radius_px)
        dx, dy = x[near] - np.float32(drop.x_px), y[near] - np.float32(drop.y_px)
        q = np.minimum((dx * dx + dy * dy) / np.float32(drop.radius_px**2), 1)
        # a lens that is flat at its middle and its rim: q(1 − q²) is at most 2/√27
        bend = np.float32(drop.bend_px / drop.radius_px * math.sqrt(27) / 2) * (1 - q)
        pixels.look_x_px[near] -= bend * dx
        pixels.look_y_px[near] -= bend * dy
    return pixels


def visible(wall: WallMaps, frame: FrameView) -> Visible:
    """Return the rows of the wall that a frame's rays can reach before they are behind all of it.

    That follows from the rays at the annulus' rims: between these, they end between.
    """
    camera, (least, most) = frame.camera, wall.relief_range_mm
    bend_px = max((drop.bend_px for drop in camera.droplets), default=0.0)
    inner_px = max(0.5 * camera.inner_px, camera.inner_px - math.hypot(*camera.inner_shift_px) - bend_px)
    around = np.arange(RIM_PLACES) * (2 * np.pi / RIM_PLACES)
    rims = np.array([[inner_px], [camera.outer_px + bend_px]])
    x, y = ((rims * turned).astype(np.float32).ravel() for turned in (np.cos(around), np.sin(around)))
    rays = rays_of(frame, x, y)
    ends = [rays.z0 + rays.to_radius_mm(wall.radius_mm + relief) * rays.z1 for relief in (least - CLEARANCE_MM, most)]
    apex_row, last = frame.apex_mm / wall.dz_mm, wall.relief_mm.shape[0] - 1
    first_row = math.floor(apex_row + float(min(z.min() for z in ends)) / wall.dz_mm) - 3
    first_row = min(max(first_row, 0), last)
    stop = math.ceil(apex_row + float(max(z.max() for z in ends)) / wall.dz_mm) + 4
    relief_mm = wall.relief_mm[first_row : max(stop, first_row + 1)]
    return Visible(
        relief_mm=relief_mm,
        least_mm=float(relief_mm.min()),
        first_row=first_row,
        apex_row=apex_row - first_row,
        rows_per_mm=1 / wall.dz_mm,
        columns_per_rad=1 / wall.dtheta_rad,
        radius_mm=wall.radius_mm,
    )


def follow(wall: Visible, frame: FrameView, pixels: View) -> Hits:
    """Return where the pixels' rays meet the wall."""
    rays = rays_of(frame, pixels.look_x_px, pixels.look_y_px)
    t = _march(wall, rays)
    radius, row, column = wall.place(rays, t)
    u, v = rays.u0 + t * rays.u1, rays.v0 + t * rays.v1
    return Hits(
        first_row=wall.first_row,
        row=row,
        column=column,
        radius_mm=radius,
        outward=np.asarray((u * rays.u1 + v * rays.v1) / radius, dtype=np.float32),
        around=np.asarray((u * rays.v1 - v * rays.u1) / radius, dtype=np.float32),
        inward=rays.z1,
    )


def _march(wall: Visible, rays: Rays) -> Image:
    """Return the t at which each ray passes behind the relief.

    A step goes as far as the ray stays over one place of the maps, so that no septum is stepped over. The place itself
    then follows from the last two looks by the rule of false position.
    """
    before = rays.to_radius_mm(wall.radius_mm + wall.least_mm - CLEARANCE_MM)
    around = np.abs(rays.v1) + np.abs(rays.v0) / np.float32(wall.radius_mm)
    across = np.sqrt(rays.z1 * rays.z1 + around * around)
    step = np.minimum(STEP_ACROSS_MM / np.maximum(across, 1e-6), LONGEST_STEP_MM)
    ahead = before + step
    excess = wall.behind(rays, before)
    excess_ahead = wall.behind(rays, ahead)
    on = np.flatnonzero(excess_ahead < 0)
    part, there, level_there, stride = rays.of(on), ahead[on], excess_ahead[on], step[on]
    while on.size:
        further = there + stride
        level = wall.behind(part, further)
        short = level < 0
        met, kept = np.flatnonzero(~short), np.flatnonzero(short)
        at = on.take(met)
        before[at], excess[at], ahead[at], excess_ahead[at] = (
            a.take(met) for a in (there, level_there, further, level)
        )
        on, there, level_there, stride = on.take(kept), further.take(kept), level.take(kept), stride.take(kept)
        part = part.of(kept)
    for _ in range(2):
        middle = _crossing(before, excess, ahead, excess_ahead)
        between = wall.behind(rays, middle)
        share = (between < 0).astype(np.float32)
        _moved(before, middle, share)
        _moved(excess, between, share)
        np.subtract(1, share, out=share)
        _moved(ahead, middle, share)
        _moved(excess_ahead, between, share)
    return _crossing(before, excess, ahead, excess_ahead)


def _moved(values: Image, to: Image, share: Image) -> None:
    """Move values by a share of 0 or 1. A mask does the same, but is six times slower where it changes often."""
    way = to - values
    way *= share
    values += way


def _crossing(before: Image, excess: Image, ahead: Image, excess_ahead: Image) -> Image:
    """Return where a straight line between two looks is level with the wall."""
    share: Image = excess / np.minimum(excess - excess_ahead, np.float32(-1e-12))
    share *= ahead - before
    share += before
    return share
