"""Raw spectra in a file, one behind the other: as a stack of B-scans."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from endoct.base.errors import EndoctError
from endoct.base.files.files import is_folder
from endoct.modalities.oct.spectra.chain import chain_of
from endoct.modalities.oct.spectra.keys import COUNTS_PER_DB, EVEN, SpectraKeys
from endoct.modalities.oct.spectra.reconstruction import Reconstruction
from endoct.modalities.oct.spectra.slices import Slices, find_slices
from endoct.modalities.oct.spectra.thorlabs import open_thorlabs
from endoct.modalities.oct.spectra.vectors import read_vector
from endoct.modalities.reading.recording import ImageStack, files_of
from endoct.modalities.reading.remarks import Remarks
from endoct.modalities.reading.thorlabs import THORLABS

if TYPE_CHECKING:
    from endoct.modalities.oct.spectra.on_device import OnDevice

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
    if (files := files_of(path, THORLABS)) is not None:
        return open_thorlabs(path, files, keys, device)
    if keys.background == "apodisation":
        raise EndoctError(
            "'spectra.background' cannot be 'apodisation'",
            found=f"{path}, which is no ThorImage file",
            expected="mean, or offset and a file of the background",
        )
    chain = chain_of(keys, partial(read_vector, path if is_folder(path) else path.parent))
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
