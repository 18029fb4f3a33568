"""What a spectrometer makes of the echoes of one turn: a B-scan of logarithmic u8 samples.

The complex field is the sum of bone (circular Gaussian, so that its intensity is fully developed speckle),
faces and sheath (coherent reflections with a slowly turning phase) and the detector's noise; its squared
magnitude in dB, with σ 5.57 dB where there is speckle alone. Arrays are (depth, beam).
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from endoct.stitching.arrays import Coordinates, Image
from endoct.stitching.circle import wrap_rad
from endoct.synthetic.beams import Echoes, trace
from endoct.synthetic.parameters import Oct, Sample
from endoct.synthetic.presets import PRESETS
from endoct.synthetic.randomness import Stage, generator, smooth_field
from endoct.synthetic.wall import Wall

Field = NDArray[np.complex64]
FWHM = 2 * math.sqrt(2 * math.log(2))  # of a Gaussian, in sigmas
BLOCK = 2048


@dataclass(frozen=True, eq=False)
class Appearance:
    """How the wall returns light, on the wall's grid coarsened by ``coarser`` in z and θ.

    ``wall_db``: its scattering against the mean, dB. ``glint``: amplitude of specular spots, 0 elsewhere.
    """

    wall_db: Image
    glint: Image
    coarser: int

    def along(self, image: Image, wall: Wall, echoes: Echoes) -> Coordinates:
        """Return one of the maps where the beams hit the wall, float64 (n,)."""
        row = min(round(echoes.wall_z_mm / wall.dz_mm / self.coarser), image.shape[0] - 1)
        period = image.shape[1]
        column = echoes.wall_theta_rad / (2 * np.pi) * period
        found: Coordinates = np.interp(column, np.arange(period), image[row], period=period)
        return found


def build_appearance(sample: Sample, wall: Wall, coarser: int = 4) -> Appearance:
    """Return the wall's patches, its specular spots and the shadows of dirt on the capillary."""
    oct_, rng = sample.oct, generator(sample.seed, Stage.OCT, 0)
    n_z, n_theta = (-(-n // coarser) for n in wall.relief_mm.shape)
    z_mm = wall.dz_mm * coarser * np.arange(n_z)[:, None]
    theta_rad = 2 * np.pi / n_theta * np.arange(n_theta)[None, :]
    dz_mm, dtheta_mm = wall.dz_mm * coarser, 2 * np.pi / n_theta * wall.radius_mm
    wall_db = oct_.patchiness_db * smooth_field(rng, (n_z, n_theta), 0.35 / dz_mm, 0.35 / dtheta_mm)
    wall_db += 0.5 * oct_.patchiness_db * smooth_field(rng, (n_z, n_theta), 0.06 / dz_mm, 0.06 / dtheta_mm)
    for dirt in oct_.shadows:
        along = (z_mm - dirt.z_mm) / dirt.sigma_z_mm
        around = wrap_rad(theta_rad - dirt.theta_rad) / dirt.sigma_theta_rad
        # flat inside and soft outside, as a speck is
        wall_db -= dirt.loss_db * np.exp(-((0.5 * (along**2 + around**2)) ** 2))
    glint = np.zeros((n_z, n_theta), np.float32)
    spots = rng.integers(0, n_z, oct_.n_glints), rng.integers(0, n_theta, oct_.n_glints)
    glint[spots] = 10 ** ((oct_.wall_db + rng.uniform(4, 16, oct_.n_glints)) / 20)
    return Appearance(wall_db.astype(np.float32), np.asarray(cv2.dilate(glint, np.ones((2, 3))), np.float32), coarser)


def render_bscan(sample: Sample, wall: Wall, appearance: Appearance, slice_index: int) -> NDArray[np.uint8]:
    """Return slice ``slice_index``, u8 (depth, A-scan)."""
    oct_, preset = sample.oct, PRESETS[sample.preset]
    rng = generator(sample.seed, Stage.OCT, 1 + slice_index)
    every, n_ascans, n_depth = preset.ascans_per_column, preset.n_ascans, preset.n_depth
    n_columns = n_ascans // every
    # the centre of a column of `every` A-scans
    turn = 2 * math.pi / n_ascans * ((np.arange(n_columns, dtype=np.float64) + 0.5) * every - 0.5)
    reach = oct_.first_sample_mm + n_depth * oct_.axial_pixel_mm + 0.05
    echoes = trace(oct_, wall, slice_index, turn, reach)
    field = noise_free_field(oct_, echoes, wall, appearance, n_depth, rng)
    samples = np.empty((n_depth, n_ascans), np.uint8)
    columns_a_block = max(1, BLOCK // every)
    for first in range(0, n_columns, columns_a_block):
        last = min(n_columns, first + columns_a_block)
        block = oversampled(field, first, last, every)
        block += _noise(rng, n_depth, block.shape[1])
        samples[:, first * every : last * every] = _counts(oct_, block)
    return samples


def noise_free_field(
    oct_: Oct, echoes: Echoes, wall: Wall, appearance: Appearance, n_depth: int, rng: Generator
) -> Field:
    """Return the complex field without the detector's noise, (n_depth, beam); noise has a mean square of 1."""
    n = echoes.alpha_rad.size
    lateral_px = oct_.lateral_resolution_mm / FWHM / (2 * np.pi * wall.radius_mm / n)
    bone = _bone(oct_, echoes, wall, appearance, n_depth, lateral_px)
    field = bone * speckle(rng, (n_depth, n), oct_.axial_resolution_mm / FWHM / oct_.axial_pixel_mm, lateral_px)

    oblique_db = np.maximum(-8.7 * (echoes.face_incidence_rad / oct_.glint_rad) ** 2, oct_.matt_db)
    for path, level_db in (
        (echoes.inner_path_mm, oct_.inner_face_db + oblique_db),
        (echoes.outer_path_mm, oct_.outer_face_db + oblique_db),
    ):
        _add_reflection(field, oct_, path, level_db + 2.0 * _around(rng, n, 0.05), rng)
    for line in oct_.sheath:
        path = line.radius_mm + line.wobble_mm * np.sin(echoes.alpha_rad + line.phase_rad)
        _add_reflection(field, oct_, path, line.level_db + 1.5 * _around(rng, n, 0.08), rng)

    glint_db = 20 * np.log10(np.maximum(appearance.along(appearance.glint, wall, echoes), 1e-3))
    _add_reflection(field, oct_, np.nan_to_num(echoes.wall_path_mm, nan=np.inf), glint_db, rng)

    row = np.arange(n_depth)[:, None]
    fraction = row / n_depth
    field *= 10 ** (-oct_.roll_off_db * fraction**2 / 20)
    line = np.exp(-0.5 * ((row - oct_.detector_line_px) / 1.1) ** 2) * 10 ** (oct_.detector_line_db / 20)
    line = line + 0.35 * np.exp(-0.5 * ((row - oct_.detector_line_px - 6) / 1.5) ** 2) * line.max()
    field += (line * np.exp(1j * rng.uniform(0, 2 * np.pi)) * (1 + 0.15 * _around(rng, n, 0.02))).astype(np.complex64)
    return field


def _bone(oct_: Oct, echoes: Echoes, wall: Wall, appearance: Appearance, n_depth: int, lateral_px: float) -> Image:
    """Return the amplitude expected of bone, float32 (n_depth, beam), blurred by the beam's width."""
    path_mm = oct_.first_sample_mm + oct_.axial_pixel_mm * np.arange(n_depth, dtype=np.float32)[:, None]
    below = path_mm - echoes.wall_path_mm[None, :].astype(np.float32)
    inside = below >= 0
    below = np.where(inside, below, 0)
    tail = 10 ** (oct_.tail_db / 10)
    profile = (1 - tail) * np.exp(-below / oct_.attenuation_mm) + tail * np.exp(-below / oct_.tail_mm)

    level_db = oct_.wall_db + appearance.along(appearance.wall_db, wall, echoes)
    # the beam diverges beyond the nominal wall, and little comes back from a steep one
    level_db -= 3.0 * np.clip((np.nan_to_num(echoes.wall_radius_mm) - wall.radius_mm) / 0.5, 0, None)
    level = 10 ** (level_db / 10) * (0.06 + 0.94 * echoes.wall_cosine**1.5)
    intensity = np.where(inside, profile * level[None, :].astype(np.float32), 0).astype(np.float32)
    return np.sqrt(_blurred(intensity, 0.0, lateral_px))


def _blurred(image: Image, sigma_rows: float, sigma_columns: float) -> Image:
    """Blur, cyclic along columns (a turn)."""
    pad = int(np.ceil(4 * sigma_columns))
    wide = np.concatenate([image[:, -pad:], image, image[:, :pad]], axis=1)
    one = np.ones(1)
    rows = _taps(sigma_rows) if sigma_rows > 0 else one
    out = cv2.sepFilter2D(wide, cv2.CV_32F, _taps(sigma_columns), rows, borderType=cv2.BORDER_REFLECT)
    return np.ascontiguousarray(out[:, pad : pad + image.shape[1]], dtype=np.float32)


def _taps(sigma: float) -> Coordinates:
    reach = int(np.ceil(3.5 * sigma))
    taps = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    normalised: Coordinates = taps / taps.sum()
    return normalised


def speckle(rng: Generator, shape: tuple[int, int], axial_px: float, lateral_px: float) -> Field:
    """Return a circular Gaussian field of mean square 1, correlated over the resolution."""
    # the field's point spread is √2 wider than that of the intensity
    axial_px, lateral_px = math.sqrt(2) * axial_px, math.sqrt(2) * lateral_px
    gain = 1 / np.sqrt(2 * np.sum(_taps(axial_px) ** 2) * np.sum(_taps(lateral_px) ** 2))
    real, imaginary = (
        _blurred(rng.standard_normal(shape, dtype=np.float32), axial_px, lateral_px) * np.float32(gain)
        for _ in range(2)
    )
    return np.asarray(real + 1j * imaginary, dtype=np.complex64)


def _around(rng: Generator, n: int, sigma_turns: float) -> Coordinates:
    """Return a smooth random course around a turn, rms 1."""
    return np.asarray(smooth_field(rng, (1, n), 0.0, sigma_turns * n)[0], dtype=np.float64)


def _add_reflection(field: Field, oct_: Oct, path_mm: Coordinates, level_db: Coordinates, rng: Generator) -> None:
    """Add a thin reflector at ``path_mm`` to the field, in place."""
    sigma_px = math.sqrt(2) * oct_.axial_resolution_mm / FWHM / oct_.axial_pixel_mm
    phase = 4.0 * _around(rng, path_mm.size, 0.01)
    peak = np.minimum((path_mm - oct_.first_sample_mm) / oct_.axial_pixel_mm, 2.0 * field.shape[0])
    amplitude = 10 ** (level_db / 20) * np.exp(1j * phase)
    nearest = np.round(peak).astype(np.intp)
    beam = np.arange(path_mm.size)
    for k in range(-int(np.ceil(5 * sigma_px)), int(np.ceil(5 * sigma_px)) + 1):
        row = nearest + k
        inside = (row >= 0) & (row < field.shape[0])
        point_spread = np.exp(-0.5 * ((row - peak) / sigma_px) ** 2)
        field[row[inside], beam[inside]] += (amplitude * point_spread)[inside].astype(np.complex64)


def oversampled(field: Field, first: int, last: int, times: int) -> Field:
    """Return columns ``first`` to ``last`` of a turn, each interpolated to ``times`` A-scans."""
    if times == 1:
        return field[:, first:last].copy()
    margin = 3
    columns = np.arange(first - margin, last + margin) % field.shape[1]
    parts = np.ascontiguousarray(field[:, columns]).view(np.float32).reshape(field.shape[0], columns.size, 2)
    wide = cv2.resize(parts, (columns.size * times, field.shape[0]), interpolation=cv2.INTER_CUBIC)
    inner = np.ascontiguousarray(wide[:, margin * times : -margin * times])
    return inner.view(np.complex64)[:, :, 0]


def _noise(rng: Generator, n_depth: int, n: int) -> Field:
    """Return detector noise of mean square 1; the spectral window ties neighbouring depths, not A-scans."""
    white = rng.standard_normal((n_depth + 2, 2 * n), dtype=np.float32).view(np.complex64)
    noise = white[1:-1] + 0.5 * (white[:-2] + white[2:])
    noise *= np.float32(1 / np.sqrt(2 * 1.5))
    return noise


def _counts(oct_: Oct, field: Field) -> NDArray[np.uint8]:
    intensity = field.real**2 + field.imag**2
    level_db = 10 * np.log10(np.maximum(intensity, 1e-12))
    # the mean of a logarithmic exponential is 2.51 dB under the logarithm of its mean
    counts = oct_.floor_count + (level_db + 2.51) / oct_.db_per_count
    return np.asarray(np.clip(np.rint(counts), 0, 255), dtype=np.uint8)
