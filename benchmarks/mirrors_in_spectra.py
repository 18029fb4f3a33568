"""How a mirror at each depth shows in a B-scan made of raw spectra: its level, its place, and the highest false echo.

    python -m benchmarks.mirrors_in_spectra

The chirp is the simulator's, a fit to the rig's: at one end of the detector samples lie 1.25 even wavenumbers apart,
where depths beyond 0.8 of the range cannot be told from their mirror images by any means.
"""

import math

import numpy as np

from endoct.modalities.oct.spectra.keys import COUNTS_PER_DB, ZERO_DB
from endoct.modalities.oct.spectra.reconstruction import reconstruction, sample_places, taps, window
from endoct.synthetic.oct.spectrometer import chirp

N, ASCANS, AMPLITUDE = 1024, 64, 10_000
NEAR_PX = 12  # of a mirror belongs to it


def main() -> None:
    """Print a table in Markdown: cubic, linear and sinc interpolation side by side."""
    places = sample_places(chirp(N), "wavenumber")
    print("| depth, samples of 512 | level, dB | place, samples | highest false echo, dB |\n|---|---|---|---|")
    for depth_px in (50.3, 100.3, 200.3, 300.3, 350.3, 400.3, 450.3):
        rows = []
        for interpolation in ("cubic", "linear", "sinc"):
            chain = reconstruction(taps(places, interpolation), window("hann", places))
            phase = np.arange(ASCANS)[:, None] * 2 * np.pi / ASCANS
            spectra = 30_000 + AMPLITUDE * np.cos(2 * np.pi * depth_px * chirp(N) / N + phase)
            level_db = chain.bscan(spectra.round().astype(np.uint16)) / COUNTS_PER_DB + ZERO_DB
            level_db -= 20 * math.log10(AMPLITUDE)
            peak = level_db.argmax(axis=1)
            before, at, after = (level_db[np.arange(ASCANS), peak + step] for step in (-1, 0, 1))
            place = peak + (before - after) / (2 * (before - 2 * at + after)) - depth_px
            top = at + (before - after) ** 2 / (8 * (2 * at - before - after))
            beside = np.abs(np.arange(N // 2) - depth_px) > NEAR_PX
            rows.append((top.mean(), np.abs(place).max(), (level_db[:, beside].max(axis=1) - top).max()))
        for_each = zip(*rows, (2, 3, 0), strict=True)
        cells = (" · ".join(f"{value:.{digits}f}" for value in values) for *values, digits in for_each)
        print(f"| {depth_px:g} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
