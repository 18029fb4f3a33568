"""Raw spectra in a file, one behind the other: as a stack of B-scans."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates
from endoct.base.compute.room import Room
from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import check_array_size, inside, open_regular
from endoct.modalities.oct.spectra.kernels import Counts
from endoct.modalities.oct.spectra.keys import COUNTS_PER_DB, EVEN, SpectraKeys
from endoct.modalities.oct.spectra.reconstruction import Reconstruction, reconstruction
from endoct.modalities.oct.spectra.resampling import dispersion_phase, sample_places, taps, window
from endoct.modalities.oct.spectra.vectors import read_vector
from endoct.modalities.reading.folders import is_folder
from endoct.modalities.reading.recording import ImageStack

if TYPE_CHECKING:
    from endoct.modalities.oct.spectra.on_device import OnDevice

LEAST_COVERED = 0.5
"""Share of the even wavenumbers that a chirp must reach; places in other units reach none or all too few."""

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
    folder = path if is_folder(path) else path.parent
    file = inside(folder, keys.file, "'spectra.file' in the sidecar") if is_folder(path) else path
    n_slices = _count_slices(file, keys)
    chain = chain_of(folder, keys)
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
