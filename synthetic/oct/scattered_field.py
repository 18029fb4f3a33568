"""The complex field that comes back to the spectrometer: from bone, and from everything thin.

Bone returns fully developed speckle: the scatterers of its lattice, weakened with depth and summed across the beam.
Arrays are (column, sample).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.random import Generator
from numpy.typing import NDArray
from scipy import fft, sparse

from endoct.base.arrays import Coordinates
from endoct.synthetic.oct.beams import BONE_INDEX, Echoes, coupling, spot_sigma_mm
from endoct.synthetic.oct.reflectors import add_sheath, reflectors
from endoct.synthetic.oct.scatterers import Lattice, Nodes, along_beams, lattice, nodes, unwrapped_rad
from endoct.synthetic.oct.spectrometer import centred, roll_off
from endoct.synthetic.oct.sweep import REACH, Sweep, around
from endoct.synthetic.sample.parameters import Oct
from endoct.synthetic.sample.randomness import Stage, generator

Field = NDArray[np.complex64]
COLUMNS = 128  # worked on at a time
STRIDE = 32  # samples of a spectrum that follow from one phasor
# the phase of reflectors wanders as fast as columns can follow, as a stand-in for the carrier: so the mean over
# A-scans holds next to nothing of them
PHASE_RAD, PHASE_TURNS = 12.0, 0.01
# the detector's line has a weaker companion; real ones are some ten rows wide
LINES = ((0.0, 0.0), (6.0, -9.0))
LINE = 1000  # its stream of phases, beyond those of reflectors


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


NODES = 128  # worked on at a time
NEGLIGIBLE_DB = -20.0  # what bone returns below this is left out
TABLE_PER_PX = 32


def speckle(sweep: Sweep) -> NDArray[np.complex64]:
    """Return the scatterers that every column's beam gathers, complex64 (column, n), of relative amplitude."""
    oct_, one, echoes = sweep.oct_, sweep.spectrometer, sweep.echoes
    n, pixel = one.window.size, oct_.axial_pixel_mm
    bone = np.zeros((sweep.turn.n, n), np.complex64)
    if not np.any(np.isfinite(echoes.wall_path_mm)):
        return bone
    places = lattice(sweep.bore_seed, sweep.radius_mm, oct_)
    passed = nodes(sweep, places)
    near, dust = passed.near, echoes.dust[passed.near]
    level_db = oct_.wall_db + sweep.wall_db[near] + oct_.dust_db * dust - echoes.shadow_db[near]
    # a steep wall returns little
    level = 10 ** (level_db / 10) * (0.06 + 0.94 * np.nan_to_num(echoes.wall_cosine[near]) ** 1.5)
    level *= coupling(oct_, np.nan_to_num(passed.path_mm))
    layer = places.roughness(round(float(np.mean(passed.z_mm)) / places.layer_mm))
    rough_mm = np.where(dust, oct_.dust_roughness_mm * layer[np.mod(passed.number, places.n_nodes)], 0)
    entry_px = (passed.path_mm + rough_mm - oct_.first_sample_mm) / pixel
    first = int(np.clip(np.nanmin(entry_px) - 1, 0, n - 1))
    last = _negligible_from(oct_, float(level.max()), first, n)

    # all nodes show one profile, shifted: they are windows of it, tabulated for every 1/32 pixel of shift, and
    # everything twice in a row, for the real and the imaginary part
    bins = np.arange(first, last)
    below = np.arange(-TABLE_PER_PX, (last - first + 2) * TABLE_PER_PX) / TABLE_PER_PX
    table = np.sqrt(_profile(oct_, below, np.clip(below + 0.5, 0, 1))).astype(np.float32).reshape(-1, TABLE_PER_PX).T
    above, beyond_table = np.zeros((TABLE_PER_PX, bins.size), np.float32), np.repeat(table[:, -1:], bins.size, axis=1)
    table = np.repeat(np.concatenate([above, table, beyond_table], axis=1), 2, axis=1)
    place = TABLE_PER_PX * (first + 1) - np.rint(np.nan_to_num(entry_px, nan=2.0 * n) * TABLE_PER_PX).astype(np.intp)
    start = np.clip(place // TABLE_PER_PX + bins.size, 0, table.shape[1] // 2 - bins.size)
    windows = sliding_window_view(table, 2 * bins.size, axis=1)
    # as many rings as an axial pixel holds add up in it
    rings = pixel / BONE_INDEX / places.ring_mm
    gain = np.sqrt(0.5 * rings * one.bone_unit2 * level).astype(np.float32)[:, None]
    rolled = np.repeat(roll_off(oct_, bins.astype(np.float64), n) * centred(bins), 2).astype(np.float32)
    amplitude = along_beams(sweep, places, passed, bins).reshape(near.size, -1)
    for a_block in range(0, near.size, NODES):
        some = slice(a_block, min(near.size, a_block + NODES))
        part = windows[place[some] % TABLE_PER_PX, 2 * start[some]]
        for node in np.flatnonzero(np.isfinite(echoes.exit_path_mm[near[some]])) + a_block:
            part[node - a_block] = np.repeat(_beyond_septum(oct_, echoes, int(near[node]), entry_px[node], bins), 2)
        part *= gain[some]
        part *= rolled
        amplitude[some] *= part
    bone[:, first:last] = (_spots(sweep, places, passed) @ amplitude).view(np.complex64)
    return bone


def _spots(sweep: Sweep, places: Lattice, passed: Nodes) -> sparse.csr_array:
    """Return how much of every node's light each column gathers, (column, node): a Gaussian of unit power."""
    echoes, theta = sweep.echoes, unwrapped_rad(sweep)
    path_mm = np.where(np.isfinite(echoes.wall_path_mm), echoes.wall_path_mm, np.nanmedian(echoes.wall_path_mm))
    sigma_mm = spot_sigma_mm(sweep.oct_, path_mm)
    # across the beam, where the wall is: beams diverge as they turn
    diverging = 1 + np.gradient(echoes.slant_rad, theta)
    mm_per_rad = sweep.radius_mm * np.cos(echoes.slant_rad) + np.nan_to_num(echoes.beyond_mm) * diverging
    at = theta / places.node_rad - passed.number[0]
    half = math.ceil(float(np.max(REACH * sigma_mm / (mm_per_rad * places.node_rad))))
    node = np.rint(at).astype(np.intp)[:, None] + np.arange(-half, half + 1)
    apart = (node - at[:, None]) * (places.node_rad * mm_per_rad / sigma_mm)[:, None]
    known = (node >= 0) & (node < passed.number.size)
    weight = np.where(known & (np.abs(apart) <= REACH), np.exp(-0.5 * apart**2), 0)
    weight /= np.sqrt(np.sum(weight**2, axis=1, keepdims=True))
    n_columns, n_taps = node.shape
    ends = n_taps * np.arange(n_columns + 1)
    chosen = np.clip(node, 0, passed.number.size - 1).ravel()
    shape = n_columns, passed.number.size
    return sparse.csr_array((weight.astype(np.float32).ravel(), chosen, ends), shape=shape)


def _beyond_septum(oct_: Oct, echoes: Echoes, column: int, entry_px: float, bins: NDArray[np.intp]) -> Coordinates:
    """Return the amplitude from axial pixels ``bins`` of a beam that leaves bone and may meet it again."""
    ends = [echoes.exit_path_mm[column], echoes.reentry_path_mm[column]]
    out, back = (np.nan_to_num(np.array(ends), nan=np.inf) - oct_.first_sample_mm) / oct_.axial_pixel_mm
    inside, beyond = bins - entry_px, np.minimum(bins, back) - out
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
    bright = np.flatnonzero(most * left * roll_off(oct_, bins, n) ** 2 > 10 ** (NEGLIGIBLE_DB / 10))
    return first + (int(bright[-1]) + 1 if bright.size else 1)
