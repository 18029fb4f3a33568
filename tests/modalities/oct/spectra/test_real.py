"""Real raw spectra: layers of tape behind a spectrometer, whose dispersion its owners have published.

From rjcanoy/KUBOL_DispersionCompensationAlgorithm: the 25 files of TapePhantom/RAW, joined in order to
``tape-phantom/spectra.bin``; even wavenumbers, 2048 samples, 1000 A-scans a slice. No licence is stated.
"""

from pathlib import Path

import numpy as np
import pytest

from endoct.modalities.oct.spectra.keys import SpectraKeys
from endoct.modalities.oct.spectra.reading import open_spectra
from tests.modalities.oct.spectra.fringes import levels_db

# where their search starts: 7.4168e-5 and 1.164e-8 rad, per sample squared and cubed, from the middle of 2048
PUBLISHED_RAD = (7.4168e-5 * 1024**2, 1.164e-8 * 1024**3)


@pytest.fixture
def tape(recordings: Path) -> Path:
    folder = recordings / "tape-phantom"
    if not folder.is_dir():
        pytest.skip("the folder of real recordings has no tape-phantom")
    return folder


def contrast(folder: Path, factor: float) -> float:
    """Contrast of amplitude in the middle slice, with ``factor`` times the published dispersion taken off."""
    rad = tuple(factor * a for a in PUBLISHED_RAD)
    keys = SpectraKeys(file="spectra.bin", samples=2048, ascans=1000, chirp="even", slices=25, dispersion_rad=rad)
    amplitude = 10 ** (levels_db(open_spectra(folder, keys)[12][20:620]) / 20)
    return float(np.mean(amplitude**2) / np.mean(amplitude) ** 2)


def test_published_dispersion_makes_real_layers_sharp(tape: Path) -> None:
    found = {factor: contrast(tape, factor) for factor in (-1.0, 0.0, 0.5, 0.75, 0.9, 1.0, 1.1, 1.25, 1.5)}
    assert found[1.0] > 1.7 * max(found[0.0], found[-1.0])
    assert max(found, key=lambda factor: found[factor]) in (0.9, 1.0, 1.1)
