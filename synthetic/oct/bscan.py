"""B-scans and raw spectra of the OCT: beams, what they bring back, and the spectrometer that records it.

Raw spectra are written as the rig writes them: headerless little-endian u16, with two vectors.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.compute.parallel import Advance, thread_map
from endoct.synthetic.bone.wall import Wall
from endoct.synthetic.oct.beams import Echoes, stream_position, trace
from endoct.synthetic.oct.scattered_field import Scattered, scattered
from endoct.synthetic.oct.spectrometer import (
    FULL_SCALE,
    Spectrometer,
    chirp,
    counts,
    dark_counts,
    digitised,
    logarithmic,
    reconstruct,
)
from endoct.synthetic.oct.sweep import BEYOND, Appearance, sweeps
from endoct.synthetic.sample.parameters import Sample
from endoct.synthetic.sample.presets import PRESETS
from endoct.synthetic.sample.randomness import Stage, generator

FINER = 4
"""The field is worked out at so many places a sample of the spectrum, to be read between them."""
SAMPLES, CHIRP, OFFSET = "spectra.bin", "Chirp.bin", "Offset.bin"
CHAIN = (
    "counts x electrons_per_count, minus Offset.bin, minus the mean over the A-scans of a slice; interpolate the "
    "values, which lie at Chirp.bin, at 0, 1, ... samples - 1; Hann window; FFT; keep the first half; squared "
    "magnitude; 10 log10"
)


def render_bscan(sample: Sample, wall: Wall, appearance: Appearance, slice_index: int) -> NDArray[np.uint8]:
    """Return slice ``slice_index``, u8 (depth, A-scan), logarithmic."""
    return next(render_bscans(sample, wall, appearance, [slice_index]))


def render_bscans(
    sample: Sample, wall: Wall, appearance: Appearance, slices: Sequence[int]
) -> Iterator[NDArray[np.uint8]]:
    """Yield several slices, u8 (depth, A-scan), the same as one by one, in less time."""
    for slice_ in _slices(sample, wall, appearance, slices):
        m = np.arange(slice_.spectrometer.window.size, dtype=np.float64)
        yield reconstruct(sample.oct, slice_.spectrometer, slice_.recorded(m, slice_.at_even_samples()))


def spectra(sample: Sample, wall: Wall, appearance: Appearance, slice_index: int) -> NDArray[np.uint16]:
    """Return the raw spectra of slice ``slice_index``, u16 (A-scan, 2·depth), 12 bits.

    Pixel p was recorded at sample :func:`endoct.synthetic.oct.spectrometer.chirp` [p] of even wavenumbers. The same
    noise falls on it as on that sample of :func:`render_bscan`.
    """
    slice_ = next(_slices(sample, wall, appearance, [slice_index]))
    m = chirp(slice_.spectrometer.window.size)
    return slice_.recorded(m, slice_.at(m))


def offset(sample: Sample) -> Coordinates:
    """Return what each pixel of the detector gives in the dark, electrons, float64 (2·depth,)."""
    return sample.oct.electrons_per_count * _dark(sample)


def noise_free(sample: Sample, wall: Wall, appearance: Appearance, slice_index: int) -> NDArray[np.uint8]:
    """Return :func:`render_bscan` without what the detector adds, u8 (depth, A-scan).

    Speckle, sheath, faces, mirror image and roll-off are the same. Left out are its noise, rounding and clipping, its
    fixed line, and the autocorrelation. What does not change from A-scan to A-scan is not lost.
    """
    slice_ = next(_slices(sample, wall, appearance, [slice_index]))
    instrument = slice_.spectrometer
    reference = instrument.reference(np.arange(instrument.window.size, dtype=np.float64)).astype(np.float32)
    linear = np.empty((slice_.n_columns, reference.size), np.float32)
    for columns, field in slice_.light.field(0, 1, reference.size, with_line=False):
        np.multiply(field.real, 2 * reference, out=linear[columns])
    ascans = np.concatenate([block for _, block in slice_.interpolated(linear)])
    return logarithmic(sample.oct, instrument, ascans, np.zeros(reference.size, np.float32))


def _dark(sample: Sample) -> Coordinates:
    size = PRESETS[sample.preset]
    return dark_counts(generator(sample.seed, Stage.DARK), sample.oct, 2 * size.n_depth)


def artificial(
    sample: Sample, wall: Wall, appearance: Appearance, slice_index: int
) -> tuple[Scattered, NDArray[np.intp], Mask]:
    """Return what a slice scatters, and of every recorded A-scan its column and whether the detector clipped it."""
    slice_ = next(_slices(sample, wall, appearance, [slice_index]))
    column = slice_.margin + slice_.position // slice_.every
    brightest = slice_.at_even_samples().max(axis=1) + float(_dark(sample).max())
    return slice_.light, column, (brightest > FULL_SCALE)[column]


@dataclass(frozen=True, eq=False)
class _Slice:
    """One slice being rendered. Columns lie ``every`` A-scans apart, the first ``margin`` of them before A-scan 0."""

    sample: Sample
    spectrometer: Spectrometer
    light: Scattered
    rng: Generator
    position: NDArray[np.intp]
    every: int
    margin: int

    @property
    def n_columns(self) -> int:
        return int(self.light.bone.shape[0])

    def at_even_samples(self) -> Image:
        n = self.spectrometer.window.size
        m = np.arange(n, dtype=np.float64)
        mean = np.empty((self.n_columns, n), np.float32)
        for columns, field in self.light.field(0, 1, n, with_line=True):
            mean[columns] = counts(self.spectrometer, m, field)
        return mean

    def at(self, m: Coordinates) -> Image:
        """Return mean counts at any samples −0.5 < m < n − 0.5, by cubic interpolation between finer ones."""
        n = self.spectrometer.window.size
        finer = (m + 1) * FINER
        whole = np.floor(finer).astype(np.intp)
        part = (finer - whole).astype(np.float32)
        weights = (
            -part * (1 - part) * (2 - part) / 6,
            (1 + part) * (1 - part) * (2 - part) / 2,
            (1 + part) * part * (2 - part) / 2,
            -(1 + part) * part * (1 - part) / 6,
        )
        mean = np.empty((self.n_columns, n), np.float32)
        for columns, field in self.light.field(-1, FINER, (n + 2) * FINER, with_line=True):
            read = sum(field[:, whole + k - 1] * weight for k, weight in enumerate(weights))
            mean[columns] = counts(self.spectrometer, m, np.asarray(read, dtype=np.complex64))
        return mean

    def interpolated(self, columns: Image) -> Iterator[tuple[NDArray[np.intp], Image]]:
        """Yield indices of recorded A-scans and those A-scans, block by block."""
        a_block = 64
        n_taken = self.n_columns - 2 * self.margin
        for first in range(0, n_taken, a_block):
            last = min(n_taken, first + a_block)
            low, high = first * self.every, last * self.every
            block: NDArray[np.generic] = columns[self.margin + first : self.margin + last]
            if self.every > 1:
                around = columns[self.margin + first - BEYOND : self.margin + last + BEYOND]
                size = around.shape[1], around.shape[0] * self.every
                wide = cv2.resize(around, size, interpolation=cv2.INTER_CUBIC)
                block = wide[BEYOND * self.every : -BEYOND * self.every]
            recorded = np.arange(*np.searchsorted(self.position, [low, high]))
            kept = self.position[recorded] - low
            yield recorded, np.asarray(block if kept.size == block.shape[0] else block[kept], dtype=np.float32)

    def recorded(self, m: Coordinates, mean: Image) -> NDArray[np.uint16]:
        dark = _dark(self.sample)
        ascans = np.empty((self.position.size, m.size), np.uint16)
        for recorded, block in self.interpolated(mean):
            ascans[recorded] = digitised(self.rng, self.spectrometer, m, block, dark)
        return ascans


def _slices(sample: Sample, wall: Wall, appearance: Appearance, slices: Sequence[int]) -> Iterator[_Slice]:
    """Yield slices, ready to be recorded."""
    every = PRESETS[sample.preset].ascans_per_column
    for i, (sweep, position) in zip(slices, sweeps(sample, wall, appearance, slices), strict=True):
        rng = generator(sample.seed, Stage.DETECTOR, i)
        light = scattered(sweep)
        yield _Slice(sample, sweep.spectrometer, light, rng, position, every, -sweep.turn.first)


def ascan_echoes(sample: Sample, wall: Wall, slice_index: int) -> Echoes:
    """Return what the beam of every A-scan recorded of a slice meets."""
    position = stream_position(sample.oct, slice_index, PRESETS[sample.preset].n_ascans)
    return trace(sample, wall.scene, slice_index, position.astype(np.float64))


def write_spectra(
    folder: Path, sample: Sample, wall: Wall, appearance: Appearance, advance: Advance, workers: int
) -> None:
    """Write ``spectra.bin`` (slice, A-scan, sample), ``Chirp.bin``, ``Offset.bin`` and ``spectra.json``.

    A-scans lie one behind the other. The vectors are little-endian float64, one value a sample: its place on even
    wavenumbers, and what the detector gives in the dark, in electrons.
    """
    folder.mkdir()
    size = PRESETS[sample.preset]
    n = 2 * size.n_depth
    with (folder / SAMPLES).open("wb") as file:
        slices = thread_map(lambda i: spectra(sample, wall, appearance, i), range(size.n_slices), workers)
        for i, ascans in enumerate(slices, 1):
            file.write(np.ascontiguousarray(ascans, dtype="<u2").tobytes())
            advance(i / size.n_slices)
    (folder / CHIRP).write_bytes(chirp(n).astype("<f8").tobytes())
    (folder / OFFSET).write_bytes(offset(sample).astype("<f8").tobytes())
    about = {
        "slices": size.n_slices,
        "ascans": size.n_ascans,
        "samples": n,
        "electrons_per_count": sample.oct.electrons_per_count,
        "axial_pixel_mm": sample.oct.axial_pixel_mm,
        "chain": CHAIN,
    }
    (folder / "spectra.json").write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
