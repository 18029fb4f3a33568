"""Raw spectra in a file, one behind the other: as a stack of B-scans."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.modalities.oct.spectra.keys import COUNTS_PER_DB, EVEN, SpectraKeys
from endoct.modalities.oct.spectra.reconstruction import Reconstruction, reconstruction
from endoct.modalities.oct.spectra.resampling import dispersion_phase, sample_places, taps, window
from endoct.modalities.oct.spectra.slices import Slices, find_slices
from endoct.modalities.oct.spectra.vectors import read_vector
from endoct.modalities.reading.folders import is_folder
from endoct.modalities.reading.recording import ImageStack
from endoct.modalities.reading.remarks import Remarks

if TYPE_CHECKING:
    from endoct.modalities.oct.spectra.on_device import OnDevice

LEAST_COVERED = 0.5
"""Share of the even wavenumbers that a chirp must reach; places in other units reach none or all too few."""

SHARPER = 1.5
SHALLOW = 4  # of the depth, this part


class ReadSpectra:
    """Reads slices of raw spectra: called with an index, returns the B-scan, u16 (depth, A-scan)."""

    def __init__(self, slices: Slices, keys: SpectraKeys, chain: "Reconstruction | OnDevice") -> None:
        self.slices, self.keys, self.chain = slices, keys, chain

    @property
    def remarks(self) -> Remarks:
        """What is to be said of how slices were found."""
        return self.slices.remarks

    def __call__(self, index: int) -> NDArray[np.uint16]:
        """Return one B-scan. Raises :class:`EndoctError` where the file ends before it does."""
        return self.chain.bscan(self.slices.counts(index, self.keys)).T


def open_spectra(path: Path, keys: SpectraKeys, device: str | None = None) -> ImageStack:
    """Open a folder, or a file, of raw spectra as a stack of B-scans (depth, A-scan); only the first is made.

    They are made on ``device``, as torch names it; None: on the CPU, without torch. Where ``keys`` do not state how
    long a turn is, some of all A-scans are read to find that.
    Raises :class:`EndoctError` where a file that ``keys`` name is missing, or does not fit them.
    """
    chain = chain_of(path if is_folder(path) else path.parent, keys)
    slices = find_slices(path, keys, chain)
    if device is None:
        return ImageStack(path, len(slices), ReadSpectra(slices, keys, chain))
    from endoct.modalities.oct.spectra.on_device import OnDevice  # which loads torch

    return ImageStack(path, len(slices), ReadSpectra(slices, keys, OnDevice(chain, device)))


def is_sharper_turned_around(path: Path, keys: SpectraKeys, bscan: NDArray[np.uint16]) -> bool:
    """Say whether ``bscan`` (depth, A-scan), that of the first slice, is sharper with the other ``chirp_gives``."""
    if keys.chirp == EVEN:
        return False
    other = "sample" if keys.chirp_gives == "wavenumber" else "wavenumber"
    first = {"ascans": bscan.shape[1], "slices": 1}  # turns that were found need not be found again
    turned = open_spectra(path, keys.model_copy(update={"chirp_gives": other, **first}))[0]
    return _sharpness(turned) > SHARPER * _sharpness(bscan)


def _sharpness(bscan: NDArray[np.uint16]) -> float:
    """Return the contrast of power, where a chirp that is wrong blurs most: away from depth 0."""
    level_db = bscan[len(bscan) // SHALLOW :].astype(np.float64) / COUNTS_PER_DB
    power = 10 ** ((level_db - level_db.max()) / 10)
    return float(np.mean(power**2) / np.mean(power) ** 2)


def chain_of(folder: Path, keys: SpectraKeys) -> Reconstruction:
    """Return the chain that ``keys`` describe, its vectors read from ``folder``. Raises as :func:`open_spectra`."""
    n = keys.samples
    places = np.arange(n, dtype=np.float64)
    if keys.chirp != EVEN:
        places = _places(read_vector(folder, keys.chirp, "spectra.chirp", n), keys)
    background = None
    if keys.offset is not None:
        offset = read_vector(folder, keys.offset, "spectra.offset", n)
        background = offset / keys.electrons_per_count if keys.background == "offset" else None
    phase = None
    if keys.dispersion_rad is not None:
        phase = dispersion_phase(n, keys.dispersion_rad)
    elif keys.dispersion is not None:
        phase = read_vector(folder, keys.dispersion, "spectra.dispersion", n)
    return reconstruction(
        taps(places, keys.interpolation),
        window(keys.window, places),
        electrons_per_count=keys.electrons_per_count,
        background=background,
        phase_rad=phase,
    )


def _places(chirp: Coordinates, keys: SpectraKeys) -> Coordinates:
    """Return where even wavenumbers lie among the samples. Raises :class:`EndoctError` for what is no chirp."""
    if (falls := np.flatnonzero(np.diff(chirp) <= 0)).size:
        i = int(falls[0])
        raise EndoctError(
            f"the chirp in {keys.chirp} does not rise throughout",
            found=f"{chirp[i]:g} and then {chirp[i + 1]:g} at values {i} and {i + 1}",
            expected=f"places in samples, from about 0 to about {chirp.size - 1}",
            remedy="check the file; one that falls throughout is turned around by subtracting it from "
            f"{chirp.size - 1}",
        )
    reached = np.count_nonzero((np.arange(chirp.size) >= chirp[0]) & (np.arange(chirp.size) <= chirp[-1]))
    places = sample_places(chirp, keys.chirp_gives)
    if np.isfinite(places).sum() < LEAST_COVERED * chirp.size or reached < LEAST_COVERED * chirp.size:
        raise EndoctError(
            f"the chirp in {keys.chirp} holds no places in samples",
            found=f"values from {chirp[0]:g} to {chirp[-1]:g}",
            expected=f"from about 0 to about {chirp.size - 1}",
            remedy="scale it, if it holds wavenumbers; or check the file",
        )
    return places
