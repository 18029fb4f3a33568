"""How far an endoscope went and rolled between frames, from their pixels.

Every frame is resampled on (z, θ) with the closed form of a cone before a pinhole, its light evened out, what all
frames have in common taken away, and strips are held against each other, or against the wall of the truth, at every
shift of z and of θ. Nothing of the unroller or of the renderer is used. ``truth`` is the "endoscope" part of
``truth/recording.json``, ``optics`` that of ``truth/sample.json``.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from endoct.base.arrays import Coordinates

Strip = NDArray[np.float64]
DZ_MM = 0.01
N_THETA = 1024
MOST = 0.35  # of the logarithm: how dark a cell is says nothing, and its floor, farther off, moves less
DARK_COUNTS = 8.0  # added before the logarithm is taken, so that noise in the dark weighs little


def image_radius_px(optics: Mapping[str, Any], radius_mm: float, z_mm: Coordinates) -> Coordinates:
    """Return where in the image, from the annulus' centre, a concentric wall is seen at ``z_mm`` from the apex.

    z = −d·cos 2a + (R + d·sin 2a)·cot(2a − ψ), solved for ψ; then r = f·t·(1 + k1·t²), t = tan ψ, where k1 moves the
    outer rim by ``distortion``.
    """
    a, d = np.deg2rad(optics["half_angle_deg"]), optics["mirror_distance_mm"]
    psi = 2 * a - np.arctan2(radius_mm + d * np.sin(2 * a), z_mm + d * np.cos(2 * a))
    t = np.tan(psi)
    outer = optics["outer_px"] / (1 + optics["distortion"]) / optics["focal_px"]
    return np.asarray(optics["focal_px"] * t * (1 + optics["distortion"] * (t / outer) ** 2))


def strip(
    frame: NDArray[np.uint8], centre_px: Sequence[float], optics: Mapping[str, Any], radius_mm: float, apex_mm: float
) -> Strip:
    """Return one frame on (z, θ): rows ``DZ_MM`` apart about the middle of the visible band, columns 2πj/1024.

    ``apex_mm``: z from the cone's apex to that middle.
    """
    grey = frame.astype(np.float32) if frame.ndim == 2 else frame.astype(np.float32).mean(axis=2)
    half = int(0.45 * optics["visible_length_mm"] / DZ_MM)
    r = image_radius_px(optics, radius_mm, apex_mm + DZ_MM * np.arange(-half, half + 1.0))[:, None]
    theta = 2 * np.pi * np.arange(N_THETA) / N_THETA
    column = (centre_px[0] + r * np.cos(theta)).astype(np.float32)
    row = (centre_px[1] + r * np.sin(theta)).astype(np.float32)
    return np.log(cv2.remap(grey, column, row, cv2.INTER_CUBIC).clip(0) + DARK_COUNTS).astype(np.float64)


def evened(strips: Sequence[Strip]) -> list[Strip]:
    """Return strips without the light's slow changes over z and θ and without what all of them have in common."""
    common = np.median(strips, axis=0)
    even = []
    for one in strips:
        left = one - common
        left = left - left.mean(axis=1, keepdims=True)
        left -= gaussian_filter1d(left, N_THETA / 12, axis=1, mode="wrap")
        even.append(left.clip(-MOST, MOST))
    return even


def shift_between(first: Strip, second: Strip, reach_mm: float) -> tuple[float, float, float]:
    """Return Δz in mm, Δroll in rad and a correlation.

    What is at (z, θ) in ``second`` is at (z + Δz, θ + Δroll) in ``first``. Where ``first`` is longer, z counts from its
    first row.
    """
    spectra = np.fft.rfft(first, axis=1), np.fft.rfft(second, axis=1)
    energy = [np.square(one).sum(axis=1) for one in (first, second)]
    rows = len(second)
    spare = len(first) - rows
    most = 0 if spare else min(round(reach_mm / DZ_MM), rows - 20)
    lags = range(-most, spare + most + 1)
    table = np.full((len(lags), N_THETA), -np.inf)
    for i, lag in enumerate(lags):
        a = slice(max(0, lag), min(len(first), rows + lag))
        b = slice(max(0, -lag), min(rows, len(first) - lag))
        product = np.fft.irfft((spectra[0][a] * spectra[1][b].conj()).sum(axis=0), N_THETA)
        table[i] = product / max(1e-12, float(np.sqrt(energy[0][a].sum() * energy[1][b].sum())))
    i, j = divmod(int(table.argmax()), N_THETA)
    dz = lags[i] + _vertex(table[max(0, i - 1) : i + 2, j])
    dtheta = j + _vertex(table[i, [(j - 1) % N_THETA, j, (j + 1) % N_THETA]])
    roll = np.angle(np.exp(2j * np.pi * dtheta / N_THETA))
    return float(dz * DZ_MM), float(roll), float(table[i, j])


def _vertex(three: Coordinates) -> float:
    """Return where, from the middle one, the parabola through three equally spaced values has its vertex."""
    if three.size < 3 or not np.isfinite(three).all():
        return 0.0
    low, mid, high = three
    bend = low - 2 * mid + high
    return float(0.5 * (low - high) / bend) if bend < 0 else 0.0


def wall_strip(brightness: NDArray[np.float32], dz_mm: float, z_mm: Coordinates) -> Strip:
    """Return how bright the wall should be at ``z_mm`` (rows), slow changes over θ taken away.

    ``brightness`` (z, θ): the logarithm of the light, up to a factor, of rows ``dz_mm`` apart from the mouth on.
    """
    column = np.rint(np.arange(N_THETA) * brightness.shape[1] / N_THETA).astype(int) % brightness.shape[1]
    row = np.clip(z_mm / dz_mm, 0, len(brightness) - 1.001)
    low = row.astype(int)
    part = (row - low)[:, None]
    there = (1 - part) * brightness[low][:, column] + part * brightness[low + 1][:, column]
    there -= there.mean(axis=1, keepdims=True)
    return np.asarray(there - gaussian_filter1d(there, N_THETA / 12, axis=1, mode="wrap"))


def rim(frame: NDArray[np.uint8], centre_px: Sequence[float], outer_px: float) -> tuple[float, float, float]:
    """Return by how many pixels the outer rim lies off a circle of ``outer_px`` about ``centre_px``: x, y and radius.

    In every direction the rim is where the light has fallen halfway; a circle is fitted to the middle of the places.
    """
    grey = frame.astype(np.float32) if frame.ndim == 2 else frame.astype(np.float32).mean(axis=2)
    r = outer_px + np.arange(-8, 8.01, 0.25)[:, None]
    theta = 2 * np.pi * np.arange(N_THETA) / N_THETA
    column = (centre_px[0] + r * np.cos(theta)).astype(np.float32)
    row = (centre_px[1] + r * np.sin(theta)).astype(np.float32)
    profile = cv2.remap(grey, column, row, cv2.INTER_LINEAR).astype(np.float64)
    inside, outside = profile[:8].mean(axis=0), profile[-8:].mean(axis=0)
    fallen = profile < (inside + outside) / 2
    at = fallen.argmax(axis=0)
    use = (inside - outside > 40) & (at > 0)
    beam = np.arange(N_THETA)
    before, after = profile[at - 1, beam], profile[at, beam]
    part = ((inside + outside) / 2 - before) / np.where(use, after - before, 1)
    off = (r[0, 0] + 0.25 * (at - 1 + part) - outer_px)[use]
    basis = np.stack([np.cos(theta), np.sin(theta), np.ones(N_THETA)], axis=1)[use]
    near = np.abs(off - np.median(off)) < 1.0
    x, y, radius = np.linalg.lstsq(basis[near], off[near], rcond=None)[0]
    return float(x), float(y), float(radius)
