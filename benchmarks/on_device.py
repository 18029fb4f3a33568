"""What torch computes on a device against the reference: how far apart they are, and the time that each takes.

    python -m benchmarks.on_device cuda          # or cpu: torch's CPU device, for the differences alone

Slices of 14 000 A-scans × 1024 samples of 12 bits, in noise, with a wall or without; and the frames of an endoscope
of the preset `quick`. Times are those of the clock, the least of five, with the way to the device and back.
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from endoct.modalities.endoscope.plugin import EndoscopeModality
from endoct.modalities.oct.spectra.keys import COUNTS_PER_DB, ZERO_DB
from endoct.modalities.oct.spectra.on_device import OnDevice
from endoct.modalities.oct.spectra.reconstruction import (
    Reconstruction,
    dispersion_phase,
    reconstruction,
    sample_places,
    taps,
    window,
)
from endoct.modalities.recognition import open_recording
from endoct.synthetic.oct.spectrometer import chirp
from endoct.synthetic.specimen import simulate

ASCANS, N = 14_000, 1024
UNDER_NOISE_DB = 20
SEED = 1001


def main(device: str) -> None:
    """Print what was found, a line for each chain, and one for the frames."""
    rng, places = np.random.default_rng(0), sample_places(chirp(N), "wavenumber")
    noise = rng.normal(2000, 20, (ASCANS, N)).astype(np.float32)
    wall = noise.copy()
    for depth_px in rng.uniform(60, 300, 10):
        phase = rng.uniform(0, 2 * np.pi, (ASCANS, 1)).astype(np.float32)
        wall += 30 * np.cos((2 * np.pi / N * depth_px * chirp(N)).astype(np.float32) + phase)
    mirror = 30_000 + 10_000 * np.cos(2 * np.pi * chirp(N) * 200 / N + np.arange(ASCANS)[:, None])
    shape = window("hann", places)
    for interpolation in ("cubic", "linear", "sinc"):
        chain = reconstruction(taps(places, interpolation), shape)
        for name, spectra in (("noise", noise), ("wall", wall), ("mirror without noise", mirror)):
            compare_slices(f"{interpolation}, {name}", chain, spectra.round().astype(np.uint16), device)
    turned = reconstruction(taps(places, "cubic"), shape, phase_rad=dispersion_phase(N, (77.8, 12.5)))
    compare_slices("cubic, dispersion, wall", turned, wall.round().astype(np.uint16), device)
    compare_frames(device)


def compare_slices(name: str, chain: Reconstruction, spectra: NDArray[np.uint16], device: str) -> None:
    """Print how far apart the levels of a slice are above and below the noise, and its amplitudes at most."""
    there = OnDevice(chain, device)
    expected, found = chain.bscan(spectra).astype(int), there.bscan(spectra).astype(int)
    apart = np.abs(found - expected)
    clear = expected >= np.median(expected) - UNDER_NOISE_DB * COUNTS_PER_DB
    theirs, ours = (10 ** ((level / COUNTS_PER_DB + ZERO_DB) / 20) for level in (expected, found))
    beyond_rounding = np.abs(ours - theirs) - np.maximum(ours, theirs) * (10 ** (1 / COUNTS_PER_DB / 20) - 1)
    print(
        f"{name}: {apart[clear].max()} counts apart at most ({np.mean(apart[clear] > 0):.2%} at all); "
        f"below the noise ({np.mean(~clear):.2%}) {apart[~clear].max(initial=0)}; "
        f"amplitudes {beyond_rounding.max() / spectra.max() * 2**24:.2f} · 2⁻²⁴ of the largest sample; "
        f"{seconds(chain.bscan, spectra):.4f} s, there {seconds(there.bscan, spectra):.4f} s"
    )


def compare_frames(device: str) -> None:
    """Print how far apart the strips of an endoscope's frames are."""
    here, there = EndoscopeModality(), EndoscopeModality().on_device(device)
    with TemporaryDirectory() as folder:
        simulate(Path(folder) / "specimen", preset="quick", seed=SEED)
        _, stream = open_recording(Path(folder) / "specimen" / "endoscope")
        calibration = here.survey(stream, here.parameters())
        apart, other = [], 0
        for frame in (stream[i] for i in range(len(stream))):
            expected, found = here.unroll(frame, calibration), there.unroll(frame, calibration)
            both = expected.valid & found.valid
            apart.append(np.abs(found.intensity[both] / expected.intensity[both] - 1).max())
            other += np.count_nonzero(expected.valid != found.valid)
        times = (seconds(lambda one=one: one.unroll(frame, calibration)) for one in (here, there))
        print(
            f"{len(stream)} frames: {max(apart):.1e} of the light at most, {other} samples valid in one alone; "
            f"{' s, there '.join(f'{one:.4f}' for one in times)} s a frame"
        )


def seconds(function: Callable[..., object], *arguments: object) -> float:
    """Return the least time of five, by the clock."""
    times = []
    for _ in range(5):
        start = time.perf_counter()
        function(*arguments)
        times.append(time.perf_counter() - start)
    return min(times)


if __name__ == "__main__":
    main(*sys.argv[1:])
