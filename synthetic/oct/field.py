"""The complex field that comes back to the spectrometer: bone, faces, sheath and specks.

Bone is white, circular Gaussian scatterers, one for each axial pixel and column, summed over the width of the beam:
fully developed speckle. Everything thin is a reflector at its exact path. Arrays are (column, sample).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.random import Generator
from numpy.typing import NDArray
from scipy import fft

from endoct.stitching.arrays import Coordinates, Image
from endoct.synthetic.oct.appearance import Appearance
from endoct.synthetic.oct.beams import BONE_INDEX, Echoes
from endoct.synthetic.oct.spectrometer import Spectrometer, roll_off
from endoct.synthetic.oct.turn import Turn, around
from endoct.synthetic.sample.parameters import Oct
from endoct.synthetic.sample.randomness import bell

Field = NDArray[np.complex64]
FWHM = 2 * math.sqrt(2 * math.log(2))  # of a Gaussian, in sigmas
COLUMNS = 128  # worked on at a time
STRIDE = 32  # samples of a spectrum that follow from one phasor
FLARE_RAD = 0.01  # incidence within which a face flares
DUST_DB = 2.0  # dust scatters more than bone, and its surface is rougher (chosen)
DUST_ROUGHNESS_MM = 0.008
DIVERGENCE_DB_MM = 6.0  # lost for each mm that the wall is beyond the nominal one, where the focus is (chosen)
FLUID_DB = -2.4  # Fresnel: 2 % of a fluid's surface against 3.5 % of glass
NEGLIGIBLE_DB = -20.0  # what bone returns below this is left out
# the phase of reflectors wanders as fast as columns can follow, as a stand-in for the carrier: so the mean over
# A-scans holds next to nothing of them
PHASE_RAD, PHASE_TURNS = 12.0, 0.01
TABLE_PER_PX = 32
# the detector's line has a weaker companion; real ones are some ten rows wide
LINES = ((0.0, 0.0), (6.0, -9.0))


@dataclass(frozen=True, eq=False)
class Scattered:
    """What one turn returns. ``bone`` complex64 (column, n): scatterers in each axial pixel, of relative amplitude.

    ``delay_px`` and ``amplitude``, (reflector, column): path beyond the reference's in axial pixels, float64, and
    relative amplitude, complex128. The first ``n_optical`` of them are real, the rest the detector's own line.
    """

    bone: Field
    delay_px: Coordinates
    amplitude: NDArray[np.complex128]
    n_optical: int

    def field(self, first_m: float, finer: int, n_m: int, with_line: bool) -> Iterator[tuple[slice, Field]]:
        """Yield columns and their field at samples ``first_m`` + i/``finer``, i < ``n_m``; ``first_m`` whole."""
        n_columns, n = self.bone.shape
        m = np.mod(np.arange(n_m) + int(first_m) * finer, n * finer)
        of = slice(None if with_line else self.n_optical)
        for first in range(0, n_columns, COLUMNS):
            columns = slice(first, min(n_columns, first + COLUMNS))
            field = fft.ifft(self.bone[columns], n * finer, norm="forward")
            if n_m != n or first_m != 0:
                field = field[:, m]
            cycles = self.delay_px[of, columns] / n
            field += _reflected(cycles, self.amplitude[of, columns], first_m - (n - 1) / 2, 1 / finer, n_m)
            yield columns, field


def _reflected(
    cycles: Coordinates, amplitude: NDArray[np.complex128], first: float, step: float, n_steps: int
) -> Field:
    """Return Σ a·exp(2πi·cycles·(first + i·step)) over reflectors, for i < n_steps: (column, n_steps).

    With i = ``STRIDE``·j + k that is a product of two small matrices a column.
    """
    seen = np.any(amplitude != 0, axis=1)
    cycles, amplitude = np.ascontiguousarray(cycles[seen].T), np.ascontiguousarray(amplitude[seen].T)
    phasor = amplitude * np.exp(2j * np.pi * first * cycles)
    coarse = _powers(np.exp(2j * np.pi * step * STRIDE * cycles), -(-n_steps // STRIDE))
    coarse *= phasor.astype(np.complex64)
    fine = _powers(np.exp(2j * np.pi * step * cycles), STRIDE)
    field = coarse.transpose(1, 0, 2) @ fine.transpose(1, 2, 0)
    return np.asarray(field.reshape(cycles.shape[0], -1)[:, :n_steps], dtype=np.complex64)


def _powers(one: NDArray[np.complex128], n: int) -> Field:
    """Return the powers 0 … n − 1 of phasors (column, reflector), complex64 (n, column, reflector), by doubling."""
    powers = np.empty((n, *one.shape), np.complex64)
    powers[0] = 1
    known = 1
    while known < n:
        more = min(known, n - known)
        np.multiply(powers[:more], one.astype(np.complex64), out=powers[known : known + more])
        known += more
        one = one * one
    return powers


def scattered(
    oct_: Oct, one: Spectrometer, echoes: Echoes, appearance: Appearance, radius_mm: float, turn: Turn, rng: Generator
) -> Scattered:
    """Return what the beams of ``turn`` return; ``radius_mm`` is the bore's, on which the beam is focused."""
    n = one.window.size
    light_db = -echoes.shadow_db
    bone = _bone(oct_, one, echoes, appearance, radius_mm, turn, rng)
    paths, levels = _reflectors(oct_, echoes, appearance, light_db, turn, rng)
    delay = (np.array(paths) - oct_.first_sample_mm) / oct_.axial_pixel_mm
    seen = np.isfinite(delay)
    delay[~seen] = 0
    amplitude = np.where(seen, 10 ** (np.array(levels) / 20), 0) * roll_off(oct_, delay, n)
    phase = np.array([PHASE_RAD * around(rng, turn, PHASE_TURNS) for _ in paths])

    # the line's phase runs through a few turns, so that the mean over A-scans does not hold it
    drift = rng.uniform(1, 3) * np.linspace(0, 2 * np.pi, turn.n) + 3.0 * around(rng, turn, 0.05)
    line = np.array([np.full(turn.n, oct_.detector_line_px + beside) for beside, _ in LINES])
    level = np.array([oct_.detector_line_db + db + np.zeros(turn.n) for _, db in LINES])
    returned: NDArray[np.complex128] = np.concatenate(
        [amplitude * np.exp(1j * phase), 10 ** (level / 20) * np.exp(1j * drift)]
    )
    return Scattered(bone, np.concatenate([delay, line]), one.unit * returned, len(paths))


def _reflectors(
    oct_: Oct, echoes: Echoes, appearance: Appearance, light_db: Coordinates, turn: Turn, rng: Generator
) -> tuple[list[Coordinates], list[Coordinates]]:
    """Return optical path and level in dB, before roll-off, of everything thin."""

    def glossy(incidence_rad: Coordinates) -> Coordinates:
        return np.maximum(-8.7 * (incidence_rad / oct_.glint_rad) ** 2, oct_.matt_db)

    flares = rng.random() < oct_.flare_share
    flaring, side = int(rng.integers(2)), rng.choice([-1, 1])
    paths, levels = [], []
    for face, (path, incidence, level) in enumerate(
        (
            (echoes.inner_path_mm, echoes.inner_incidence_rad, oct_.inner_face_db),
            (echoes.outer_path_mm, echoes.outer_incidence_rad, oct_.outer_face_db),
        )
    ):
        level_db = level + glossy(incidence) + 2.0 * around(rng, turn, 0.05)
        if flares and face == flaring:
            # square on the near or on the far side of an off-axis catheter
            there = side * (path - np.median(path)) > 0
            level_db = level_db + there * oct_.flare_db * np.exp(-((incidence / FLARE_RAD) ** 2))
        paths.append(path)
        levels.append(level_db)
    for sheath in oct_.sheath:
        paths.append(sheath.radius_mm + sheath.wobble_mm * np.sin(echoes.alpha_rad + sheath.phase_rad))
        levels.append(sheath.level_db + 1.5 * around(rng, turn, 0.08))
    paths.append(np.zeros(turn.n))
    levels.append(oct_.catheter_face_db + 1.0 * around(rng, turn, 0.08))

    paths.append(echoes.wall_path_mm)
    glint_db = appearance.at(appearance.glint_db, echoes.wall_z_mm, echoes.wall_theta_rad)
    levels.append(np.where(glint_db > NEGLIGIBLE_DB, glint_db + light_db, -np.inf))
    if np.any(np.isfinite(echoes.fluid_path_mm)):
        paths.append(echoes.fluid_path_mm)
        levels.append(oct_.outer_face_db + FLUID_DB + glossy(np.arccos(echoes.fluid_cosine)) + light_db)
    return paths, levels


def _bone(
    oct_: Oct,
    one: Spectrometer,
    echoes: Echoes,
    appearance: Appearance,
    radius_mm: float,
    turn: Turn,
    rng: Generator,
) -> Field:
    """Return the scatterers that every column's beam gathers, (column, n)."""
    n, pixel = one.window.size, oct_.axial_pixel_mm
    level_db = oct_.wall_db + appearance.at(appearance.wall_db, echoes.wall_z_mm, echoes.wall_theta_rad)
    level_db -= DIVERGENCE_DB_MM * np.clip(np.nan_to_num(echoes.wall_radius_mm) - radius_mm, 0, None)
    level_db += DUST_DB * echoes.dust - echoes.shadow_db
    # a steep wall returns little
    level = 10 ** (level_db / 10) * (0.06 + 0.94 * np.nan_to_num(echoes.wall_cosine) ** 1.5)
    rough_mm = np.where(echoes.dust, DUST_ROUGHNESS_MM, 0) * turn(bell(rng, turn.n_ring))
    entry = (echoes.wall_path_mm + rough_mm - oct_.first_sample_mm) / pixel
    bone = np.zeros((turn.n, n), np.complex64)
    if not np.any(np.isfinite(entry)):
        return bone
    first = int(np.clip(np.nanmin(entry) - 1, 0, n - 1))
    last = _negligible_from(oct_, float(level.max()), first, n)

    # all columns show one profile, shifted: they are windows of it, tabulated for every 1/32 pixel of shift, and
    # everything twice in a row, for the real and the imaginary part
    bins = np.arange(first, last)
    below = np.arange(-TABLE_PER_PX, (last - first + 2) * TABLE_PER_PX) / TABLE_PER_PX
    table = np.sqrt(_profile(oct_, below, np.clip(below + 0.5, 0, 1))).astype(np.float32).reshape(-1, TABLE_PER_PX).T
    above, beyond_table = np.zeros((TABLE_PER_PX, bins.size), np.float32), np.repeat(table[:, -1:], bins.size, axis=1)
    table = np.repeat(np.concatenate([above, table, beyond_table], axis=1), 2, axis=1)
    place = TABLE_PER_PX * (first + 1) - np.rint(np.nan_to_num(entry, nan=2.0 * n) * TABLE_PER_PX).astype(np.intp)
    start = np.clip(place // TABLE_PER_PX + bins.size, 0, table.shape[1] // 2 - bins.size)
    windows = sliding_window_view(table, 2 * bins.size, axis=1)
    gain = np.sqrt(0.5 * one.bone_unit2 * level).astype(np.float32)[:, None]
    rolled = np.repeat(roll_off(oct_, bins.astype(np.float64), n), 2).astype(np.float32)
    speckle = bell(rng, turn.n_ring * 2 * bins.size).reshape(turn.n_ring, -1)
    amplitude, on_ring = np.empty((turn.n, 2 * bins.size), np.float32), turn.place
    for a_block in range(0, turn.n, COLUMNS):
        columns = slice(a_block, min(turn.n, a_block + COLUMNS))
        part = windows[place[columns] % TABLE_PER_PX, 2 * start[columns]]
        for column in np.flatnonzero(np.isfinite(echoes.exit_path_mm[columns])):
            part[column] = np.repeat(_beyond_septum(oct_, echoes, a_block + int(column), entry, bins), 2)
        part *= gain[columns]
        part *= rolled
        np.multiply(part, speckle.take(on_ring[columns], axis=0), out=amplitude[columns])
    taps = lateral_taps(oct_, radius_mm, turn.n_ring)
    bone[:, first:last] = _summed(amplitude, taps).view(np.complex64)
    return bone


def _beyond_septum(
    oct_: Oct, echoes: Echoes, column: int, entry_px: Coordinates, bins: NDArray[np.intp]
) -> Coordinates:
    """Return the amplitude from axial pixels ``bins`` of a beam that leaves bone and may meet it again."""
    ends = [echoes.exit_path_mm[column], echoes.reentry_path_mm[column]]
    out, back = (np.nan_to_num(np.array(ends), nan=np.inf) - oct_.first_sample_mm) / oct_.axial_pixel_mm
    inside, beyond = bins - entry_px[column], np.minimum(bins, back) - out
    gap = np.clip(bins + 0.5 - out, 0, 1) - np.clip(bins + 0.5 - back, 0, 1)
    share = np.clip(inside + 0.5, 0, 1)
    left: Coordinates = np.sqrt(_profile(oct_, inside - np.maximum(beyond, 0), share - np.minimum(gap, share)))
    return left


def _profile(oct_: Oct, below_px: Coordinates, share: Coordinates) -> Coordinates:
    """Return the intensity from axial pixels with ``below_px`` of bone above them, a ``share`` of them bone."""
    depth_mm = np.maximum(below_px, 0) * oct_.axial_pixel_mm / BONE_INDEX
    tail = 10 ** (oct_.tail_db / 10)
    profile: Coordinates = (1 - tail) * np.exp(-depth_mm / oct_.attenuation_mm) + tail * np.exp(
        -depth_mm / oct_.tail_mm
    )
    return share * profile


def _negligible_from(oct_: Oct, most: float, first: int, n: int) -> int:
    """Return the axial pixel from which bone that begins at ``first`` cannot be seen, not even folded back."""
    bins = np.arange(first, n, dtype=np.float64)
    left = _profile(oct_, bins - first, np.ones_like(bins))
    seen = np.flatnonzero(most * left * roll_off(oct_, bins, n) ** 2 > 10 ** (NEGLIGIBLE_DB / 10))
    return first + (int(seen[-1]) + 1 if seen.size else 1)


def lateral_taps(oct_: Oct, radius_mm: float, n_ring: int) -> Image:
    """Return the beam's field across the columns of a turn, of unit power; √2 wider than its intensity."""
    sigma = math.sqrt(2) * oct_.lateral_resolution_mm / FWHM / (2 * np.pi * radius_mm / n_ring)
    reach = math.ceil(3.5 * sigma)
    taps = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    return np.asarray(taps / np.sqrt(np.sum(taps**2)), dtype=np.float32)


def _summed(image: Image, taps: Image) -> Image:
    """Return ``image`` convolved with ``taps`` along columns; the columns at both ends are a margin."""
    out = cv2.sepFilter2D(image, cv2.CV_32F, np.ones(1, np.float32), taps, borderType=cv2.BORDER_REFLECT)
    return np.asarray(out, dtype=np.float32)
