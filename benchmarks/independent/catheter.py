"""An OCT pullback from inside a glass capillary, by exact refraction at its two faces and a speckle model of its own.

A beam leaves the catheter's axis, which lies off that of capillary and bore, is bent by Snell's law at the inner and
at the outer face, and goes straight on. Each depth sample is a place along that path, at its optical length. Bone
scatters as circular complex noise, correlated across A-scans as the beam is wide and along depth as the source's
coherence is long; the faces of sheath and glass are coherent lines.
"""

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy import ndimage

from benchmarks.independent.bore import Bore, Floats
from benchmarks.independent.recipe import CatheterRecipe

BEAM_MM = 0.022
COHERENCE_PX = 1.1
SHEATH_WALL_MM = 0.05
DB_PER_COUNT = 0.25
NOISE_COUNT = 42.0
Samples = NDArray[np.uint8 | np.uint16]


@dataclass(frozen=True, eq=False)
class Pullback:
    """A recording and where it was made.

    ``samples`` (slice, depth, A-scan) in the order of the file; ``z_mm`` of each slice and ``angle_rad`` (slice,
    A-scan), the direction of each beam, both in the bore's frame; ``offset_mm`` (slice, 2) of the catheter.
    """

    samples: Samples
    z_mm: Floats
    angle_rad: Floats
    offset_mm: Floats


def pull_back(bore: Bore, recipe: CatheterRecipe, rng: Generator) -> Pullback:
    """Return the pullback of a bore, with the recipe's fault, if any."""
    n = recipe.slices
    z = recipe.start_mm + recipe.pitch_mm * np.arange(n + 20)
    turn = 2 * np.pi * np.arange(recipe.a_scans) / recipe.a_scans
    starts = np.zeros(n)
    if recipe.fault == "lost_slices":
        z = np.delete(z, np.arange(n // 2, n // 2 + int(recipe.fault_size)))
    z = z[:n]
    if recipe.travel == "out":
        z = z[::-1]
    if recipe.fault == "start_jump":
        starts[n // 2 :] = recipe.fault_size
    if recipe.fault == "turn_step":
        turn = turn + recipe.fault_size * (turn > rng.uniform(1.5, 4.5))
    sense = -1.0 if recipe.mirrored else 1.0
    angle = recipe.start_rad + sense * (turn + starts[:, None])
    steady = recipe.offset_mm * np.array([np.cos(recipe.offset_rad), np.sin(recipe.offset_rad)])
    slow = ndimage.gaussian_filter1d(rng.normal(size=(n, 2)), n / 6, axis=0, mode="nearest")
    offset = steady + recipe.wander_mm * slow / max(np.abs(slow).max(), 1e-9)
    room = recipe.capillary_outer_mm / 2 - recipe.glass_mm - recipe.sheath_mm / 2
    offset *= np.minimum(1, 0.97 * room / np.maximum(np.hypot(*offset.T), 1e-9))[:, None]
    slices = [_slice(bore, recipe, z[k], angle[k], offset[k], rng) for k in range(n)]
    samples = np.stack(slices)
    order = np.arange(n)
    if recipe.fault == "swapped_slices":
        size = int(recipe.fault_size)
        first, second = n // 4, n // 2 + 2
        a, b = np.arange(first, first + size), np.arange(second, second + size)
        order[a], order[b] = b, a
    if recipe.fault == "upside_down":
        samples = samples[:, ::-1]
    return Pullback(samples[order], z[order], angle[order], offset[order])


def beam_paths(recipe: CatheterRecipe, angle_rad: Floats, offset_mm: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return how beams run: (optical length to the inner face, to the outer face, place on the outer, direction).

    The lengths are (A-scan,), place and direction (A-scan, 2); by Snell's law at both faces, exact in the plane.
    """
    start = np.broadcast_to(offset_mm, (angle_rad.size, 2))
    way = np.stack([np.cos(angle_rad), np.sin(angle_rad)], axis=1)
    outer = recipe.capillary_outer_mm / 2
    inner = outer - recipe.glass_mm
    first = _to_circle(start, way, inner)
    at_inner = start + first[:, None] * way
    within = _refract(way, at_inner / inner, 1 / recipe.glass_index)
    second = _to_circle(at_inner, within, outer)
    at_outer = at_inner + second[:, None] * within
    beyond = _refract(within, at_outer / outer, recipe.glass_index)
    return first, first + recipe.glass_index * second, at_outer, beyond


def _to_circle(start: Floats, way: Floats, radius: float) -> Floats:
    along = (start * way).sum(axis=1)
    return np.asarray(-along + np.sqrt(along**2 + radius**2 - (start**2).sum(axis=1)))


def _refract(way: Floats, outward: Floats, ratio: float) -> Floats:
    """Return the direction behind a face, ``ratio`` being the index before it over that behind it."""
    cosine = (way * outward).sum(axis=1)
    behind = np.sqrt(1 - ratio**2 * (1 - cosine**2))
    return np.asarray(ratio * way + (behind - ratio * cosine)[:, None] * outward)


def _slice(
    bore: Bore, recipe: CatheterRecipe, z_mm: float, angle_rad: Floats, offset_mm: Floats, rng: Generator
) -> Samples:
    n, depths, pixel = recipe.a_scans, recipe.depths, recipe.axial_pixel_mm
    path = recipe.first_sample_mm + pixel * np.arange(depths)
    to_inner, to_outer, place, way = beam_paths(recipe, angle_rad, offset_mm)
    if recipe.fault == "no_catheter":  # the bare end of a fibre held in the bore, no sheath and no glass
        to_outer = np.zeros(n)
        place = np.broadcast_to(offset_mm, (n, 2))
        way = np.stack([np.cos(angle_rad), np.sin(angle_rad)], axis=1)
    beyond = (path[:, None] - to_outer).astype(np.float32)
    x = place[:, 0].astype(np.float32) + beyond * way[:, 0].astype(np.float32)
    y = place[:, 1].astype(np.float32) + beyond * way[:, 1].astype(np.float32)
    # the wall of this slice alone, at a finer pitch than A-scans have
    around = np.linspace(0, 2 * np.pi, 4096, endpoint=False)
    wall = bore.radius_mm + bore.at(bore.relief_mm, around, np.asarray(z_mm))
    scatter = bore.at(bore.scatter, around, np.asarray(z_mm))
    column = (np.arctan2(y, x) * np.float32(4096 / (2 * np.pi))).astype(np.int32) & 4095
    radius = np.sqrt(x * x + y * y)
    below = radius - wall[column]
    bone = (below > 0) & (beyond > 0)
    through = np.cumsum(bone, axis=0, dtype=np.float32) * np.float32(pixel)
    layers = 1 + 0.3 * np.sin(radius * np.float32(2 * np.pi / 0.11) + 3 * scatter[column])
    skin = 1 + 2.5 * np.exp(-((through / 0.012) ** 2))
    power = bone * layers * skin * scatter[column] * np.exp(-2 * np.float32(recipe.attenuation_per_mm) * through)
    field = np.sqrt(10 ** (recipe.signal_db / 10) * power * _roll_off(path)[:, None]) * _speckle((depths, n), bore, rng)
    if recipe.fault != "no_catheter":
        field += _sheath(recipe, path, angle_rad, rng)
        field += _face(path, to_inner, 24, _squareness(recipe, angle_rad, offset_mm), pixel, rng)
        field += _face(path, to_outer, 27, _squareness(recipe, angle_rad, offset_mm), pixel, rng)
    field = _coherence(field)
    rows = 0.8 + 0.35 * path[:, None] / path[-1]
    field += rows * (rng.normal(size=(depths, n)) + 1j * rng.normal(size=(depths, n))) / np.sqrt(2)
    for line in recipe.lines:
        field[line - 1 : line + 2] += np.array([3.0, 9.0, 4.0])[:, None]
    amplitude = np.abs(field)
    if recipe.linear:
        return np.asarray(np.clip(np.rint(120 * amplitude), 0, 65535), dtype=np.uint16)
    counts = 20 / DB_PER_COUNT * np.log10(amplitude + 1e-6) + NOISE_COUNT
    return np.asarray(np.clip(np.rint(counts), 0, 255), dtype=np.uint8)


def _roll_off(path: Floats) -> Floats:
    return np.asarray(10 ** (-0.6 * (path / 2.5) ** 2))


def _speckle(shape: tuple[int, int], bore: Bore, rng: Generator) -> NDArray[np.complex64]:
    """Return circular complex noise, as wide across A-scans as the beam is on the wall; unit mean power."""
    width = BEAM_MM * shape[1] / (2 * np.pi * bore.radius_mm)
    parts = rng.standard_normal((2, *shape), dtype=np.float32)
    parts = ndimage.gaussian_filter1d(parts, width, axis=2, mode="wrap", truncate=3)
    parts *= np.sqrt(0.5 / max(float((parts**2).mean()), 1e-12))
    return np.asarray(parts[0] + 1j * parts[1], dtype=np.complex64)


def _coherence(field: NDArray[np.complex64]) -> NDArray[np.complex64]:
    taps = np.exp(-0.5 * (np.arange(-4, 5) / COHERENCE_PX) ** 2)
    taps /= np.sqrt((taps**2).sum())
    real = ndimage.convolve1d(field.real, taps, axis=0, mode="nearest")
    imaginary = ndimage.convolve1d(field.imag, taps, axis=0, mode="nearest")
    return np.asarray(real + 1j * imaginary, dtype=np.complex64)


def _squareness(recipe: CatheterRecipe, angle_rad: Floats, offset_mm: Floats) -> Floats:
    """Return how much of a face's mirror reflection returns: all of it where the beam meets it squarely."""
    across = offset_mm[0] * np.sin(angle_rad) - offset_mm[1] * np.cos(angle_rad)
    incidence = np.abs(across) / (recipe.capillary_outer_mm / 2)
    return np.asarray(0.35 + 0.65 * np.exp(-((incidence / 0.07) ** 2)))


def _face(
    path: Floats, at_mm: Floats, level_db: float, strength: Floats, pixel: float, rng: Generator
) -> NDArray[np.complex64]:
    """Return a coherent line at an optical length, its phase turning with its place."""
    nearest = np.clip(np.rint((at_mm - path[0]) / pixel), 0, path.size - 2).astype(np.intp)
    share = (at_mm - path[0]) / pixel - nearest
    dust = ndimage.gaussian_filter1d(rng.normal(size=at_mm.size), at_mm.size / 90, mode="wrap")
    amplitude = 10 ** (level_db / 20) * strength * np.exp(0.25 * dust / max(dust.std(), 1e-9))
    wave = amplitude * np.exp(1j * (4 * np.pi * at_mm / 0.0013))
    line = np.zeros((path.size, at_mm.size), np.complex64)
    columns = np.arange(at_mm.size)
    inside = (at_mm > path[0]) & (at_mm < path[-1] - 2 * pixel)
    line[nearest[inside], columns[inside]] = (wave * (1 - np.abs(share)))[inside]
    beside = nearest + np.where(share < 0, -1, 1)
    line[beside[inside], columns[inside]] += (wave * np.abs(share))[inside]
    return line


def _sheath(recipe: CatheterRecipe, path: Floats, angle_rad: Floats, rng: Generator) -> NDArray[np.complex64]:
    """Return the sheath about the catheter: two lines and a little haze between them, hardly off its axis."""
    outside = recipe.sheath_mm / 2 + 0.008 * np.cos(angle_rad - 1.3)
    inside = outside - SHEATH_WALL_MM
    everywhere = np.ones(angle_rad.size)
    haze = (path[:, None] > inside) & (path[:, None] < outside)
    noise = rng.standard_normal((2, *haze.shape), dtype=np.float32)
    lines = _face(path, inside, 20, everywhere, recipe.axial_pixel_mm, rng)
    lines = lines + _face(path, outside, 23, everywhere, recipe.axial_pixel_mm, rng)
    return np.asarray(lines + 1.6 * haze * (noise[0] + 1j * noise[1]), dtype=np.complex64)
