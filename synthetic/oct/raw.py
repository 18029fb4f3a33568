"""Raw spectra as the rig writes them: headerless little-endian u16, with its two vectors."""

import json
from pathlib import Path

import numpy as np

from endoct.base.compute.parallel import thread_map
from endoct.synthetic.bone.wall import Wall
from endoct.synthetic.oct.appearance import Appearance
from endoct.synthetic.oct.bscan import offset, spectra
from endoct.synthetic.oct.spectrometer import chirp
from endoct.synthetic.progress import Advance
from endoct.synthetic.sample.parameters import Sample
from endoct.synthetic.sample.presets import PRESETS

SAMPLES, CHIRP, OFFSET = "spectra.bin", "Chirp.bin", "Offset.bin"
CHAIN = (
    "counts x electrons_per_count, minus Offset.bin, minus the mean over the A-scans of a slice; interpolate the "
    "values, which lie at Chirp.bin, at 0, 1, ... samples - 1; Hann window; FFT; keep the first half; squared "
    "magnitude; 10 log10"
)


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
