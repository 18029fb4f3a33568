"""An endoscope with a cone mirror, by exact ray tracing: pinhole, cone, cylinder, and on into the cells.

The pinhole looks along the bore; the cone's apex points to it. A ray at ψ to the axis leaves the cone at 2a − ψ. Bore
and probe need not share an axis. Rays that meet the wall where a cell opens go on until they are behind its floor.
"""

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy import ndimage

from benchmarks.independent.bore import Bore, Floats, Map
from benchmarks.independent.recipe import MirrorRecipe

MARCH_MM = 0.02


@dataclass(frozen=True, eq=False)
class Optics:
    """What the probe sees, the same in every frame: for each pixel of the annulus where its ray goes.

    ``row``, ``column`` of the pixels; ``radius_px``, ``turn_rad`` from the optical axis; ``direction`` (pixel, 2) in
    the plane across the bore; ``reach_mm`` along it from the probe's axis to the wall, ``z_mm`` there from the apex;
    ``slant`` the further z for 1 mm of reach. ``centre`` of the bore in the probe's frame (2,). ``rims_px``: centres of
    the inner and the outer rim, column and row.
    """

    focal_px: float
    inner_px: float
    row: NDArray[np.intp]
    column: NDArray[np.intp]
    radius_px: Floats
    turn_rad: Floats
    direction: Floats
    reach_mm: Floats
    z_mm: Floats
    slant: Floats
    centre: Floats
    centre_px: tuple[float, float]
    rims_px: Floats
    band_mm: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Journey:
    """A recording and where it was made: frames (frame, row, column); z of the apex and roll, in the file's order."""

    frames: NDArray[np.uint8]
    apex_mm: Floats
    roll_rad: Floats
    optics: Optics
    pitch_mm: float


def wall_z_mm(recipe: MirrorRecipe, radius_mm: float, focal_px: float, radius_px: Floats) -> Floats:
    """Return z from the apex, away from the pinhole, at which a centred bore's wall is seen (radii in the image)."""
    return _trace(recipe, focal_px, np.asarray(radius_px, dtype=np.float64), np.asarray(radius_mm))[0]


def _trace(recipe: MirrorRecipe, focal_px: float, radius_px: Floats, reach_mm: Floats) -> tuple[Floats, Floats]:
    half, psi = np.deg2rad(recipe.half_angle_deg), np.arctan(radius_px / focal_px)
    run = recipe.distance_mm * np.tan(half) / (np.tan(half) * np.cos(psi) - np.sin(psi))
    on_cone = run * np.sin(psi), run * np.cos(psi) - recipe.distance_mm
    normal = np.cos(half), -np.sin(half)
    facing = np.sin(psi) * normal[0] + np.cos(psi) * normal[1]
    out = np.sin(psi) - 2 * facing * normal[0], np.cos(psi) - 2 * facing * normal[1]
    slant = out[1] / out[0]
    return np.asarray(on_cone[1] + (reach_mm - on_cone[0]) * slant), np.asarray(slant)


def focal_px(recipe: MirrorRecipe) -> float:
    """Return the focal length with which the mirror's edge lies at ``outer_px``."""
    half = np.deg2rad(recipe.half_angle_deg)
    return float(
        recipe.outer_px * (recipe.distance_mm + recipe.mirror_radius_mm / np.tan(half)) / recipe.mirror_radius_mm
    )


def look(recipe: MirrorRecipe, radius_mm: float, rng: Generator) -> Optics:
    """Return where every pixel of the annulus looks."""
    focal, inner = focal_px(recipe), recipe.inner_share * recipe.outer_px
    axis = (recipe.size_px - 1) / 2 + rng.uniform(-3, 3, 2)
    rims = axis + recipe.rim_shift_px * rng.uniform(-1, 1, (2, 2))
    row, column = np.indices((recipe.size_px, recipe.size_px))
    x, y = (column - axis[0]) * recipe.aspect, row - axis[1]
    from_inner = np.hypot((column - rims[0, 0]) * recipe.aspect, row - rims[0, 1])
    from_outer = np.hypot((column - rims[1, 0]) * recipe.aspect, row - rims[1, 1])
    seen = (from_inner > inner) & (from_outer < recipe.outer_px)
    rows, columns = np.nonzero(seen)
    x, y = x[seen], y[seen]
    radius, turn = np.hypot(x, y), np.arctan2(y, x)
    way = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    side = rng.uniform(0, 2 * np.pi)
    centre = recipe.bore_offset_mm * np.array([np.cos(side), np.sin(side)])
    along = way @ centre
    reach = along + np.sqrt(radius_mm**2 - centre @ centre + along**2)
    z, slant = _trace(recipe, focal, radius, reach)
    band = wall_z_mm(recipe, radius_mm, focal, np.array([inner, recipe.outer_px]))
    return Optics(
        focal, inner, rows, columns, radius, turn, way, reach, z, slant, centre,
        (float(axis[0]), float(axis[1])), rims, (float(band.min()), float(band.max())),
    )  # fmt: skip


def travel(bore: Bore, recipe: MirrorRecipe, rng: Generator) -> Journey:
    """Return the recording of a bore."""
    optics = look(recipe, bore.radius_mm, rng)
    visible = optics.band_mm[1] - optics.band_mm[0]
    pitch = (1 - recipe.overlap) * visible
    count = 1 + round((recipe.length_mm - visible) / pitch)
    steps = pitch * (1 + recipe.feed_jitter * rng.normal(size=count - 1))
    sign = 1.0 if recipe.ahead else -1.0
    first = recipe.start_mm - (optics.band_mm[0] if recipe.ahead else -optics.band_mm[1])
    apex = first + np.concatenate([[0.0], np.cumsum(steps)])
    roll = recipe.roll_rad * np.cumsum(rng.normal(size=count)) / np.sqrt(count)
    roll -= roll[0]
    if recipe.fault == "pipe_end":
        return Journey(_pipe_end(recipe, count, rng), apex, roll, optics, pitch)
    light = _light(recipe, optics, rng)
    if recipe.fault == "saturated":
        light *= 1.5
    around = _background(recipe, optics, rng)
    frames = np.stack([
        _frame(bore, recipe, optics, apex[k], recipe.start_rad + roll[k], sign, light, around, rng)
        for k in range(count)
    ])  # fmt: skip
    if recipe.travel == "out":
        frames, apex, roll = frames[::-1], apex[::-1], roll[::-1]
    return Journey(frames, apex, roll, optics, pitch)


def _frame(
    bore: Bore,
    recipe: MirrorRecipe,
    optics: Optics,
    apex_mm: float,
    turn_rad: float,
    sign: float,
    light: Floats,
    around: Floats,
    rng: Generator,
) -> NDArray[np.uint8]:
    brightness = light * wall_brightness(bore, optics, apex_mm, turn_rad, sign)
    if recipe.fault == "far_rim":
        end = recipe.start_mm + 0.93 * recipe.length_mm
        beyond = seen_at(optics, optics.reach_mm, apex_mm, turn_rad, sign)[1] - end
        brightness = np.where(beyond > 0, 0.1 * light, brightness) + 0.8 * np.exp(-((beyond / 0.02) ** 2))
    image = around.copy()
    image[optics.row, optics.column] += brightness
    image = ndimage.gaussian_filter(image, 0.6)
    counts = 205 * recipe.exposure * image
    counts += rng.normal(size=counts.shape) * np.sqrt(recipe.noise**2 + 0.03 * np.maximum(counts, 0))
    return np.asarray(np.clip(np.rint(counts + 2), 0, 255), dtype=np.uint8)


def wall_brightness(bore: Bore, optics: Optics, apex_mm: float, turn_rad: float, sign: float) -> Map:
    """Return the brightness of what each pixel sees, (pixel,), 1 on plain wall: texture lies on what is seen."""
    theta, z = seen_at(optics, optics.reach_mm, apex_mm, turn_rad, sign)
    brightness = bore.at(bore.albedo, theta, z)
    open_ = np.flatnonzero(bore.at(bore.level, theta, z) < 1)
    if not open_.size or not bore.cells:
        return brightness
    depth, number = _into_cells(bore, optics, open_, apex_mm, turn_rad, sign)
    floors = np.array([cell.brightness for cell in bore.cells])[number]
    deepest = np.array([cell.depth_mm for cell in bore.cells])[number]
    share = np.clip(depth / deepest, 0, 1.2)
    on_floor = seen_at(optics, optics.reach_mm[open_] + depth, apex_mm, turn_rad, sign, open_)
    brightness[open_] = bore.at(bore.albedo, *on_floor) * (1 - (1 - floors) * share**0.6).astype(np.float32)
    return brightness


def seen_at(
    optics: Optics, reach_mm: Floats, apex_mm: float, turn_rad: float, sign: float, of: NDArray[np.intp] | None = None
) -> tuple[Floats, Floats]:
    """Return (θ, z) in the bore's frame of the places ``reach_mm`` along the rays of pixels ``of`` (default all)."""
    pick: slice | NDArray[np.intp] = slice(None) if of is None else of
    x = reach_mm * optics.direction[pick, 0] - optics.centre[0]
    y = reach_mm * optics.direction[pick, 1] - optics.centre[1]
    z = optics.z_mm[pick] + (reach_mm - optics.reach_mm[pick]) * optics.slant[pick]
    return np.arctan2(y, x) + turn_rad, apex_mm + sign * z


def _into_cells(
    bore: Bore, optics: Optics, open_: NDArray[np.intp], apex_mm: float, turn_rad: float, sign: float
) -> tuple[Floats, NDArray[np.intp]]:
    """Return how deep the rays of pixels ``open_`` end behind the wall, and in which cell."""
    theta, z = seen_at(optics, optics.reach_mm[open_], apex_mm, turn_rad, sign, open_)
    number = np.asarray(bore.nearest(bore.number, theta, z), dtype=np.intp)
    depth = np.zeros(open_.size)
    going = np.arange(open_.size)
    reach = optics.reach_mm[open_]
    while going.size:
        depth[going] += MARCH_MM
        theta, z = seen_at(optics, reach[going] + depth[going], apex_mm, turn_rad, sign, open_[going])
        floor = np.asarray(bore.nearest(bore.relief_mm, theta, z), dtype=np.float64)
        inside = depth[going] < floor
        # within the last step: on the floor where that lies there, else on the steep side of the cell
        ended = depth[going[~inside]]
        depth[going[~inside]] = np.clip(floor[~inside], ended - MARCH_MM, ended)
        going = going[inside]
    return depth, number


def _light(recipe: MirrorRecipe, optics: Optics, rng: Generator) -> Floats:
    """Return the light on each pixel of the annulus: its lamps, its distance, its fall towards the rims."""
    share = (optics.radius_px - optics.inner_px) / (recipe.outer_px - optics.inner_px)
    bright, second = rng.uniform(0, 2 * np.pi, 2)
    lamps = 1 + recipe.light_around * (np.cos(optics.turn_rad - bright) + 0.4 * np.cos(2 * (optics.turn_rad - second)))
    along = 1 + recipe.light_along * rng.choice([-1, 1]) * (share - 0.5)
    distance = (optics.reach_mm.mean() / optics.reach_mm) ** 2
    edge = 1 - 0.35 * np.exp(-share / 0.05) - 0.45 * np.exp(-(1 - share) / 0.05)
    return np.asarray(0.85 * lamps * along * distance * np.clip(edge, 0.1, None))


def _background(recipe: MirrorRecipe, optics: Optics, rng: Generator) -> Floats:
    """Return what the frame shows besides the wall: haze, the dark middle, a specular ring at the inner rim."""
    row, column = np.indices((recipe.size_px, recipe.size_px))
    x, y = (column - optics.centre_px[0]) * recipe.aspect, row - optics.centre_px[1]
    radius, turn = np.hypot(x, y), np.arctan2(y, x)
    image = 0.03 + 0.05 * np.exp(-((radius / (0.6 * recipe.outer_px)) ** 2))
    at = optics.inner_px - 0.06 * recipe.outer_px
    glint = 0.6 + 0.4 * np.cos(turn - rng.uniform(0, 2 * np.pi))
    image += recipe.ring * glint * np.exp(-(((radius - at) / 2.2) ** 2))
    return np.asarray(image)


def _pipe_end(recipe: MirrorRecipe, count: int, rng: Generator) -> NDArray[np.uint8]:
    """Return pictures of a pipe's end, hardly moving: a bright inner ring, a blurred outer one, unlike centres."""
    row, column = np.indices((recipe.size_px, recipe.size_px)) / recipe.size_px
    frames = []
    for _ in range(count):
        x, y = 0.5 + rng.normal(size=2) * 0.002
        near, far = np.hypot(column - x, row - y), np.hypot(column - x - 0.05, row - y + 0.03)
        image = 30 + 150 * np.exp(-(((near - 0.2) / 0.02) ** 2)) + 90 * np.exp(-(((far - 0.4) / 0.07) ** 2))
        frames.append(image + rng.normal(size=image.shape) * 3)
    return np.asarray(np.clip(np.rint(frames), 0, 255), dtype=np.uint8)
