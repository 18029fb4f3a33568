"""Raw spectra in files as a stack of B-scans: one spectrum behind the other, or in a ThorImage file.

Both are read by one chain, made from what is stated, wherever its vectors lie.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates
from endoct.base.compute.memory import Room
from endoct.base.errors import EndoctError
from endoct.base.files.files import SMALL_BYTES, is_folder
from endoct.base.files.zip_members import key_of, read_member
from endoct.modalities.oct.spectra.keys import COUNTS_PER_DB, EVEN, SpectraKeys
from endoct.modalities.oct.spectra.reconstruction import (
    Counts,
    Reconstruction,
    dispersion_phase,
    mean_spectrum,
    reconstruction,
    sample_places,
    taps,
    window,
)
from endoct.modalities.oct.spectra.slices import Slices, find_slices
from endoct.modalities.oct.spectra.vectors import read_vector, vector_of
from endoct.modalities.reading.format import Files
from endoct.modalities.reading.recording import ImageStack, files_of
from endoct.modalities.reading.remarks import Remarks
from endoct.modalities.reading.thorlabs import THORLABS, open_scan, read_ascans
from endoct.modalities.reading.thorlabs_file import AScans, BScan, Container

SHARPER = 1.5
SHALLOW = 4  # of the depth, this part
APODISATION = "data/ApodizationSpectrum.data"
LEAST_COVERED = 0.5
"""A chirp must reach this part of the even wavenumbers; places in other units reach none or all too few."""

ReadVector = Callable[[str, str, int], Coordinates]
_ROOM = Room()


class ReadSpectra:
    """Reads slices of raw spectra: called with an index, returns the B-scan, u16 (depth, A-scan)."""

    def __init__(self, slices: Slices, keys: SpectraKeys, chain: Reconstruction) -> None:
        self.slices, self.keys, self.chain = slices, keys, chain

    @property
    def remarks(self) -> Remarks:
        """What is to be said of how slices were found."""
        return self.slices.remarks

    def __call__(self, index: int) -> NDArray[np.uint16]:
        """Return one B-scan. Raises :class:`EndoctError` where the file ends before it does."""
        return self.chain.bscan(self.slices.counts(index, self.keys)).T


def open_spectra(path: Path, keys: SpectraKeys) -> ImageStack:
    """Open a folder, or a file, of raw spectra as a stack of B-scans (depth, A-scan); only the first is made.

    Where ``keys`` do not state how long a turn is, some of all A-scans are read to find that.
    Raises :class:`EndoctError` where a file that ``keys`` name is missing, or does not fit them.
    """
    if (files := files_of(path, THORLABS)) is not None:
        return open_thorlabs(path, files, keys)
    if keys.background == "apodisation":
        raise EndoctError(
            "'spectra.background' cannot be 'apodisation'",
            found=f"{path}, which is no ThorImage file",
            expected="mean, or offset and a file of the background",
        )
    chain = chain_of(keys, partial(read_vector, path if is_folder(path) else path.parent))
    slices = find_slices(path, keys, chain)
    return ImageStack(path, len(slices), ReadSpectra(slices, keys, chain))


def is_sharper_turned_around(path: Path, keys: SpectraKeys, bscan: NDArray[np.uint16]) -> bool:
    """Say whether ``bscan`` (depth, A-scan), that of the first slice, is sharper with the other ``chirp_gives``."""
    if keys.chirp == EVEN:
        return False
    other = "sample" if keys.chirp_gives == "wavenumber" else "wavenumber"
    first = {"ascans": bscan.shape[1], "slices": 1}  # turns that were found need not be found again
    turned = open_spectra(path, keys.model_copy(update={"chirp_gives": other, **first}))[0]
    deep = len(bscan) // SHALLOW  # where a chirp that is wrong blurs most; but a blur may reach there from above
    is_so_deep = _sharpness(turned[deep:]) > SHARPER * _sharpness(bscan[deep:])
    return is_so_deep and _sharpness(turned) > _sharpness(bscan)


def _sharpness(bscan: NDArray[np.uint16]) -> float:
    """Return the contrast of power."""
    level_db = bscan.astype(np.float64) / COUNTS_PER_DB
    power = 10 ** ((level_db - level_db.max()) / 10)
    return float(np.mean(power**2) / np.mean(power) ** 2)


def chain_of(keys: SpectraKeys, read: ReadVector) -> Reconstruction:
    """Return the chain that ``keys`` describe; ``read`` returns a vector by its name, its key, and its length.

    Raises :class:`EndoctError` where a vector is missing or is not what its key says.
    """
    n = keys.samples
    places = np.arange(n, dtype=np.float64)
    if keys.chirp != EVEN:
        places = _places(read(keys.chirp, "spectra.chirp", n), keys)
    background = None
    if keys.offset is not None:
        offset = read(keys.offset, "spectra.offset", n)
        background = offset / keys.electrons_per_count if keys.background == "offset" else None
    phase = None
    if keys.dispersion_rad is not None:
        phase = dispersion_phase(n, keys.dispersion_rad)
    elif keys.dispersion is not None:
        phase = read(keys.dispersion, "spectra.dispersion", n)
    return reconstruction(
        taps(places, keys.interpolation),
        window(keys.window, places),
        electrons_per_count=keys.electrons_per_count,
        background=background,
        phase_rad=phase,
    )


def _places(chirp: Coordinates, keys: SpectraKeys) -> Coordinates:
    """Return where even wavenumbers lie among the samples. Raises :class:`EndoctError` where this is no chirp."""
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


class ReadThorlabsSpectra:
    """Reads the spectra of B-scans: called with an index, returns the B-scan, u16 (depth, A-scan).

    ``apodised``: whether to subtract the mean of a B-scan's own spectra without the sample, where it has such.
    """

    def __init__(self, bscans: tuple[BScan, ...], first: Container, chain: Reconstruction, apodised: bool) -> None:
        self._bscans, self._n_samples, self._dtype = bscans, first.n_samples, first.dtype
        self._chain, self._apodised = chain, apodised

    def __call__(self, index: int) -> NDArray[np.uint16]:
        """Return one B-scan. Raises :class:`EndoctError` where the file ends before it does."""
        bscan = self._bscans[index]
        chain = self._chain
        if self._apodised and bscan.apodised is not None:
            chain = replace(chain, background=mean_spectrum(self._spectra(bscan.apodised)))
        return chain.bscan(self._spectra(bscan.ascans)).T

    def _spectra(self, ascans: AScans) -> Counts:
        """Spectra, u16 or i16 (A-scan, sample), until this thread asks for others."""
        room: Counts = _ROOM.array("counts", (ascans.count, self._n_samples), self._dtype)
        spectra = read_ascans(ascans, self._n_samples, self._dtype, room)
        return spectra.astype(spectra.dtype.newbyteorder("="), copy=False)


def open_thorlabs(path: Path, files: Files, keys: SpectraKeys) -> ImageStack:
    """Open the raw spectra in ThorImage's ``files`` as a stack of B-scans (depth, A-scan).

    Raises :class:`EndoctError` where ``keys`` state something else than the files hold, or a vector is missing.
    """
    recording = open_scan(files)
    first = recording.first
    if first.kind != "raw" or keys.samples != first.n_samples or not keys.ascans or keys.ascans > first.n_ascans:
        found = f"{first.n_ascans} A-scans of {first.n_samples} samples" if first.kind == "raw" else "B-scans"
        raise EndoctError(
            f"{path} does not hold the spectra that are stated",
            found=found,
            expected=f"{keys.ascans or 'a number of'} A-scans of {keys.samples} samples",
            remedy="leave the table 'spectra' out of the sidecar: the file states it",
        )
    bscans = [replace(bscan, ascans=replace(bscan.ascans, count=keys.ascans)) for bscan in recording.bscans]
    remarks = recording.remarks
    if keys.ascans < first.n_ascans:
        note = f"Of the {first.n_ascans} A-scans of every B-scan the first {keys.ascans} were read, as one turn."
        remarks += Remarks(notes=(note,))
    chain = chain_of(keys, partial(_vector, first))
    apodised = keys.background == "apodisation"
    if apodised and any(bscan.apodised is None for bscan in bscans):
        chain = replace(chain, background=_apodisation(first, keys))
    if keys.slices is not None and keys.slices > len(bscans):
        raise EndoctError(f"{path} holds fewer slices than stated", found=f"{len(bscans)}", expected=f"{keys.slices}")
    kept, along = tuple(bscans[: keys.slices]), recording.along
    if along is not None:
        along = replace(along, values=along.values[: len(kept)])
    read = ReadThorlabsSpectra(kept, first, chain, apodised)
    return ImageStack(path, len(kept), read, along=along, remarks=remarks)


def _vector(container: Container, name: str, key: str, n: int) -> Coordinates:
    """Return a vector that lies in the file, or next to it."""
    if (member := container.members.get(key_of(name))) is None:
        return read_vector(container.path.parent, name, key, n)
    return vector_of(read_member(member, SMALL_BYTES), container.path / member.name, key, n)


def _apodisation(container: Container, keys: SpectraKeys) -> Coordinates:
    """Return the spectrum without the sample that the file holds for all B-scans, counts."""
    if key_of(APODISATION) not in container.members:
        raise EndoctError(
            f"{container.path} holds no spectra without the sample",
            expected="ApodizationSpectrum.data, or A-scans of an ApoRegion",
            remedy="leave 'spectra.background' at 'mean'",
        )
    electrons = _vector(container, APODISATION, "spectra.background", keys.samples)
    return electrons / keys.electrons_per_count
