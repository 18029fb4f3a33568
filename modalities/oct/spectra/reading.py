"""Raw spectra in a file, one behind the other: as a stack of B-scans."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from endoct.base.compute.room import Room
from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import check_array_size, inside, open_regular
from endoct.modalities.oct.spectra.chain import chain_of
from endoct.modalities.oct.spectra.kernels import Counts
from endoct.modalities.oct.spectra.keys import COUNTS_PER_DB, EVEN, SpectraKeys
from endoct.modalities.oct.spectra.reconstruction import Reconstruction
from endoct.modalities.oct.spectra.thorlabs import open_thorlabs
from endoct.modalities.oct.spectra.vectors import read_vector
from endoct.modalities.reading.folders import is_folder
from endoct.modalities.reading.recording import ImageStack, files_of
from endoct.modalities.reading.thorlabs import THORLABS

if TYPE_CHECKING:
    from endoct.modalities.oct.spectra.on_device import OnDevice

_ROOM = Room()
SHARPER = 1.5
SHALLOW = 4  # of the depth, this part


class ReadSpectra:
    """Reads slices of raw spectra: called with an index, returns the B-scan, u16 (depth, A-scan)."""

    def __init__(self, path: Path, keys: SpectraKeys, chain: "Reconstruction | OnDevice") -> None:
        self.path, self.keys, self.chain = path, keys, chain

    def __call__(self, index: int) -> NDArray[np.uint16]:
        """Return one B-scan. Raises :class:`EndoctError` where the file ends before it does."""
        return self.chain.bscan(self._spectra(index)).T

    def _spectra(self, index: int) -> Counts:
        """The samples of one slice, u16 or i16 (A-scan, sample), until this thread asks for another."""
        spectra: Counts = _ROOM.array("counts", (self.keys.ascans, self.keys.samples), self.keys.dtype)
        with refusing(f"{self.path} cannot be read"), open_regular(self.path) as file:
            file.seek(index * spectra.nbytes)
            if file.readinto(spectra.data) != spectra.nbytes:
                raise EndoctError(
                    f"{self.path} is truncated", found=f"slice {index} incomplete", remedy="copy it again"
                )
        return spectra.astype(spectra.dtype.newbyteorder("="), copy=False)


def open_spectra(path: Path, keys: SpectraKeys, device: str | None = None) -> ImageStack:
    """Open a folder, or a file, of raw spectra as a stack of B-scans (depth, A-scan); only the first is made.

    They are made on ``device``, as torch names it; None: on the CPU, without torch.
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
    folder = path if is_folder(path) else path.parent
    file = inside(folder, keys.file, "'spectra.file' in the sidecar") if is_folder(path) else path
    n_slices = _count_slices(file, keys)
    chain = chain_of(keys, partial(read_vector, folder))
    if device is None:
        return ImageStack(path, n_slices, ReadSpectra(file, keys, chain))
    from endoct.modalities.oct.spectra.on_device import OnDevice  # which loads torch

    return ImageStack(path, n_slices, ReadSpectra(file, keys, OnDevice(chain, device)))


def is_sharper_turned_around(path: Path, keys: SpectraKeys, bscan: NDArray[np.uint16]) -> bool:
    """Say whether ``bscan`` (depth, A-scan), that of the first slice, is sharper with the other ``chirp_gives``."""
    if keys.chirp == EVEN:
        return False
    other = "sample" if keys.chirp_gives == "wavenumber" else "wavenumber"
    turned = open_spectra(path, keys.model_copy(update={"chirp_gives": other}))[0]
    return _sharpness(turned) > SHARPER * _sharpness(bscan)


def _sharpness(bscan: NDArray[np.uint16]) -> float:
    """Return the contrast of power, where a chirp that is wrong blurs most: away from depth 0."""
    level_db = bscan[len(bscan) // SHALLOW :].astype(np.float64) / COUNTS_PER_DB
    power = 10 ** ((level_db - level_db.max()) / 10)
    return float(np.mean(power**2) / np.mean(power) ** 2)


def _count_slices(file: Path, keys: SpectraKeys) -> int:
    shape = keys.ascans, keys.samples
    check_array_size(shape, keys.dtype.itemsize, f"a slice of {file}")
    with open_regular(file) as opened:
        size = opened.seek(0, 2)
    ascan = keys.samples * keys.dtype.itemsize
    if size % ascan or not size:
        raise EndoctError(
            f"{file} does not hold a whole number of A-scans",
            found=f"{size} bytes",
            expected=f"a multiple of {ascan}, for {keys.samples} samples of {keys.sample_type}",
            remedy="check 'samples' and 'sample_type' in the sidecar, and that the file has no header",
        )
    whole, rest = divmod(size // ascan, keys.ascans)
    if keys.slices is not None:
        if keys.slices > whole:
            raise EndoctError(
                f"{file} holds fewer slices than stated",
                found=f"{whole} of {keys.ascans} A-scans",
                expected=f"{keys.slices}",
                remedy="check 'slices' and 'ascans' in the sidecar, or copy the file again",
            )
        return keys.slices
    if rest or not whole:
        raise EndoctError(
            f"{file} does not end with a whole slice",
            found=f"{size // ascan} A-scans, {rest} more than {whole} slices of {keys.ascans}",
            expected="whole slices",
            remedy="check 'ascans' and 'samples' in the sidecar"
            + (f"; to leave out the last, incomplete turn, state 'slices = {whole}'" if whole else ""),
        )
    return whole
