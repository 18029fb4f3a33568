"""The complex field that comes back to the spectrometer: from bone, and from everything thin.

Arrays are (column, sample).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy import fft

from endoct.base.arrays import Coordinates
from endoct.synthetic.oct.reflectors import add_sheath, reflectors
from endoct.synthetic.oct.speckle import speckle
from endoct.synthetic.oct.spectrometer import roll_off
from endoct.synthetic.oct.sweep import Sweep, around
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

    def of(what: int) -> Generator:
        return generator(sweep.seed, Stage.PHASES, sweep.slice_index, what)

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
