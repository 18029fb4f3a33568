"""The complex field that comes back to the spectrometer: from bone, and from everything thin.

Bone returns the speckle of :mod:`endoct.synthetic.oct.scatterers`. Thin are the capillary's faces and their ghosts,
the lines of the sheath, glints, and a fluid's surface. Each lies at its exact path, and returns light of a level in dB.
The sheath's polymer is bands of speckle behind these lines, which fade in and out around the turn. Arrays are (column,
sample).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy import fft, sparse

from endoct.base.arrays import Coordinates
from endoct.synthetic.oct.beams import spot_sigma_mm
from endoct.synthetic.oct.scatterers import speckle
from endoct.synthetic.oct.spectrometer import centred, roll_off
from endoct.synthetic.oct.sweep import REACH, Sweep, around
from endoct.synthetic.sample.randomness import Stage, bell, generator

Field = NDArray[np.complex64]
COLUMNS = 128
"""Number of columns worked on at a time."""
STRIDE = 32
"""Number of samples of a spectrum that follow from one phasor."""
PHASE_RAD, PHASE_TURNS = 12.0, 0.01
"""The phase of reflectors wanders by this over this part of a turn, as fast as columns can follow.

It stands in for the carrier: so the mean over A-scans holds next to nothing of them.
"""
LINES = ((0.0, 0.0), (6.0, -9.0))
"""Rows and dB from the detector's line: it has a weaker companion. Real ones are some ten rows wide."""
LINE = 1000
"""The stream of the line's phases, beyond those of reflectors."""
FLUID_DB = -2.4
"""A fluid's surface returns 2 % of the light, against 3.5 % of glass (Fresnel)."""
NO_GLINT_DB = -20.0
"""A specular spot is one brighter than this."""
INNER, OUTER, EXIT, SHEATH = 0, 1, 2, 3
"""Streams of the levels of both faces, of the catheter's exit, and of the sheath's first line."""
N_FACES, N_GHOSTS = 2, 3
N_NODES = 512
"""So many nodes lie around the sheath, closer than the spot is wide out of its focus."""
SOFT_PX = 1.5
"""A band begins and ends over this."""
MOST_PX = 64
"""Scatterers of a band are drawn for so many axial pixels, whatever its thickness."""


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
            if n_m != n * finer or first_m != 0:
                field = field[:, m]
            cycles = self.delay_px[of, columns] / n
            field += _reflected(cycles, self.amplitude[of, columns], first_m - (n - 1) / 2, 1 / finer, n_m)
            yield columns, field


def scattered(sweep: Sweep) -> Scattered:
    """Return what the beams of a turn return."""
    oct_, turn, n = sweep.oct_, sweep.turn, sweep.spectrometer.window.size
    bone = speckle(sweep)
    add_sheath(sweep, bone)
    paths, levels = reflectors(sweep)
    delay = (np.array(paths) - oct_.first_sample_mm) / oct_.axial_pixel_mm
    met = np.isfinite(delay)
    delay[~met] = 0
    amplitude = np.where(met, 10 ** (np.array(levels) / 20), 0) * roll_off(oct_, delay, n)

    def of(stream: int) -> Generator:
        return generator(sweep.seed, Stage.PHASES, sweep.slice_index, stream)

    phase = np.array([PHASE_RAD * around(of(k), turn, PHASE_TURNS) for k in range(len(paths))])

    # the line's phase runs through a few turns, so that the mean over A-scans does not hold it
    rng = of(LINE)
    drift = rng.uniform(1, 3) * np.linspace(0, 2 * np.pi, turn.n) + 3.0 * around(rng, turn, 0.05)
    line = np.array([np.full(turn.n, oct_.detector_line_px + apart) for apart, _ in LINES])
    level = np.array([oct_.detector_line_db + db + np.zeros(turn.n) for _, db in LINES])
    returned: NDArray[np.complex128] = np.concatenate(
        [amplitude * np.exp(1j * phase), 10 ** (level / 20) * np.exp(1j * drift)]
    )
    return Scattered(bone, np.concatenate([delay, line]), sweep.spectrometer.unit * returned, len(paths))


def _reflected(
    cycles: Coordinates, amplitude: NDArray[np.complex128], first: float, step: float, n_steps: int
) -> Field:
    """Return Σ a·exp(2πi·cycles·(first + i·step)) over reflectors, for i < n_steps: (column, n_steps).

    With i = ``STRIDE``·j + k that is a product of two small matrices a column.
    """
    shining = np.any(amplitude != 0, axis=1)
    cycles, amplitude = np.ascontiguousarray(cycles[shining].T), np.ascontiguousarray(amplitude[shining].T)
    phasor = amplitude * np.exp(2j * np.pi * first * cycles)
    coarse = _powers(np.exp(2j * np.pi * step * STRIDE * cycles), -(-n_steps // STRIDE))
    coarse *= phasor.astype(np.complex64)
    fine = _powers(np.exp(2j * np.pi * step * cycles), STRIDE)
    field = coarse.transpose(1, 0, 2) @ fine.transpose(1, 2, 0)
    return np.asarray(field.reshape(cycles.shape[0], -1)[:, :n_steps], dtype=np.complex64)


def _powers(wave: NDArray[np.complex128], n: int) -> Field:
    """Return the powers 0 … n − 1 of phasors (column, reflector), complex64 (n, column, reflector), by doubling."""
    powers = np.empty((n, *wave.shape), np.complex64)
    powers[0] = 1
    known = 1
    while known < n:
        more = min(known, n - known)
        np.multiply(powers[:more], wave.astype(np.complex64), out=powers[known : known + more])
        known += more
        wave = wave * wave
    return powers


def reflectors(sweep: Sweep) -> tuple[list[Coordinates], list[Coordinates]]:
    """Return optical path, mm, and level in dB, before roll-off, of everything thin; each a value a column.

    First both faces, the sheath's lines and the catheter's exit, then the ghosts, glints and a fluid's surface.
    """
    oct_, echoes, turn = sweep.oct_, sweep.echoes, sweep.turn
    light_db = -echoes.shadow_db

    def course(stream: int, rms_db: float, sigma_turns: float) -> Coordinates:
        rng = generator(sweep.seed, Stage.LEVELS, sweep.slice_index, stream)
        return rms_db * around(rng, turn, sigma_turns)

    def glossy(incidence_rad: Coordinates) -> Coordinates:
        return np.maximum(-8.7 * (incidence_rad / oct_.glint_rad) ** 2, oct_.matt_db)

    # a beam that leans along the bore meets no face squarely
    lean_rad = np.real(sweep.lean * np.exp(-1j * echoes.alpha_rad))

    def square_db(incidence_rad: Coordinates) -> Coordinates:
        flare: Coordinates = oct_.flare_db * np.exp(-(incidence_rad**2 + lean_rad**2) / oct_.flare_rad**2)
        return flare

    faces = (
        (echoes.inner_path_mm, echoes.inner_incidence_rad, oct_.inner_face_db, INNER),
        (echoes.outer_path_mm, echoes.outer_incidence_rad, oct_.outer_face_db, OUTER),
    )
    paths, levels, ghosts = [], [], []
    glass_mm = echoes.outer_path_mm - echoes.inner_path_mm
    outermost_mm = max((sheath.radius_mm for sheath in oct_.sheath), default=0.0)
    for path, incidence, level, stream in faces:
        own_db = level + course(stream, 2.0, 0.05)
        paths.append(path)
        levels.append(own_db + glossy(incidence) + square_db(incidence))
        # twice to the face and back, turned around by the sheath: it must be met squarely twice
        again_db = own_db + oct_.double_pass_db + glossy(2 * incidence) + square_db(incidence)
        ghosts.append((2 * path - outermost_mm, again_db))
        if stream == OUTER:
            thrice_db = own_db + oct_.ghost_db + glossy(3 * incidence) + square_db(incidence)
            ghosts.append((path + glass_mm, thrice_db))
    for k, sheath in enumerate(oct_.sheath):
        paths.append(sheath_path_mm(sweep, k))
        levels.append(sheath.level_db + fading_db(sweep, k))
    paths.append(np.zeros(turn.n))
    levels.append(oct_.catheter_face_db + course(EXIT, 1.0, 0.08))

    for path, level_db in ghosts:
        paths.append(path)
        levels.append(level_db)
    paths.append(echoes.wall_path_mm)
    levels.append(np.where(sweep.glint_db > NO_GLINT_DB, sweep.glint_db + light_db, -np.inf))
    if np.any(np.isfinite(echoes.fluid_path_mm)):
        paths.append(echoes.fluid_path_mm)
        levels.append(oct_.outer_face_db + FLUID_DB + glossy(np.arccos(echoes.fluid_cosine)) + light_db)
    return paths, levels


def sheath_path_mm(sweep: Sweep, line: int) -> Coordinates:
    """Return the path to one of the sheath's lines, at every column."""
    sheath = sweep.oct_.sheath[line]
    path: Coordinates = sheath.radius_mm + sheath.wobble_mm * np.sin(sweep.echoes.alpha_rad + sheath.phase_rad)
    return path


def fading_db(sweep: Sweep, line: int) -> Coordinates:
    """Return by how much a line of the sheath, and the polymer behind it, fade around the turn, dB; ≤ 0 in the mean."""
    rng = generator(sweep.seed, Stage.LEVELS, sweep.slice_index, SHEATH + line)
    course = around(rng, sweep.turn, 0.08)
    fading: Coordinates = sweep.oct_.sheath_fade_db * np.minimum(course, 0.3)
    return fading


def add_sheath(sweep: Sweep, field: NDArray[np.complex64]) -> None:
    """Add what the sheath scatters to the scatterers ``field`` (column, n), in place."""
    oct_, n = sweep.oct_, field.shape[1]
    pixel, alpha = oct_.axial_pixel_mm, sweep.echoes.alpha_rad
    for line, sheath in enumerate(oct_.sheath):
        depth_px = min(MOST_PX - 8, sheath.thickness_mm / pixel)
        begin_px = (sheath_path_mm(sweep, line) - oct_.first_sample_mm) / pixel
        sigma = float(spot_sigma_mm(oct_, np.array([sheath.radius_mm]))[0]) / sheath.radius_mm / (2 * math.pi / N_NODES)
        rng = generator(sweep.seed, Stage.SHEATH, sweep.slice_index, line)
        n_px = 2 * math.ceil(depth_px / 2) + 6
        scatterers = bell(rng, N_NODES * 2 * MOST_PX).reshape(N_NODES, 2 * MOST_PX)[:, : 2 * n_px]
        band = (_around(alpha, sigma) @ scatterers).view(np.complex64)
        # a few pixels early, and as many late; and moved by the part of a pixel that the sheath is off them
        first = np.floor(begin_px).astype(np.intp) - 2
        off = np.exp(-2j * np.pi * np.outer(begin_px - np.floor(begin_px), fft.fftfreq(n_px)))
        band = fft.ifft(fft.fft(band, axis=1) * off.astype(np.complex64), axis=1)
        bins = first[:, None] + np.arange(n_px)
        into, left = bins - begin_px[:, None], begin_px[:, None] + depth_px - bins
        share = np.clip(into / SOFT_PX + 0.5, 0, 1) * np.clip(left / SOFT_PX + 0.5, 0, 1)
        level = 10 ** ((sheath.band_db + fading_db(sweep, line)) / 10)
        amplitude = np.sqrt(0.5 * sweep.spectrometer.bone_unit2 * level[:, None] * share)
        amplitude = amplitude * roll_off(oct_, bins.astype(np.float64), n) * centred(bins)
        column, k = np.nonzero((share > 0) & (np.abs(bins) < n // 2))
        field[column, bins[column, k] % n] += (band * amplitude.astype(np.float32))[column, k]


def _around(alpha_rad: NDArray[np.float64], sigma: float) -> sparse.csr_array:
    """Return how much of every node around the sheath each column gathers: a Gaussian of unit power."""
    at = np.mod(alpha_rad, 2 * np.pi) * (N_NODES / (2 * np.pi))
    half = min(N_NODES // 2 - 1, math.ceil(REACH * sigma))
    node = np.rint(at).astype(np.intp)[:, None] + np.arange(-half, half + 1)
    weight = np.exp(-0.5 * ((node - at[:, None]) / sigma) ** 2)
    weight /= np.sqrt(np.sum(weight**2, axis=1, keepdims=True))
    ends = node.shape[1] * np.arange(len(at) + 1)
    return sparse.csr_array(
        (weight.astype(np.float32).ravel(), np.mod(node, N_NODES).ravel(), ends), shape=(len(at), N_NODES)
    )
