"""B-scans of the raw spectra in a ThorImage file, by the chain of all raw spectra."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates
from endoct.base.compute.memory import Room
from endoct.base.errors import EndoctError
from endoct.base.files.files import SMALL_BYTES
from endoct.base.files.zip_members import key_of, read_member
from endoct.modalities.oct.spectra.chain import chain_of
from endoct.modalities.oct.spectra.kernels import Counts
from endoct.modalities.oct.spectra.keys import SpectraKeys
from endoct.modalities.oct.spectra.reconstruction import Reconstruction, mean_spectrum
from endoct.modalities.oct.spectra.vectors import read_vector, vector_of
from endoct.modalities.reading.format import Files
from endoct.modalities.reading.recording import ImageStack
from endoct.modalities.reading.remarks import Remarks
from endoct.modalities.reading.thorlabs import open_recording, read_ascans
from endoct.modalities.reading.thorlabs_file import AScans, BScan, Container

if TYPE_CHECKING:
    from endoct.modalities.oct.spectra.on_device import OnDevice

APODISATION = "data/ApodizationSpectrum.data"
_ROOM = Room()


class ReadSpectra:
    """Reads the spectra of B-scans: called with an index, returns the B-scan, u16 (depth, A-scan).

    ``apodised``: what is subtracted is the mean of a B-scan's own spectra without the sample, where it has such.
    """

    def __init__(
        self, bscans: tuple[BScan, ...], first: Container, chain: "Reconstruction | OnDevice", apodised: bool
    ) -> None:
        self._bscans, self._n_samples, self._dtype = bscans, first.n_samples, first.dtype
        self._chain, self._apodised = chain, apodised

    def __call__(self, index: int) -> NDArray[np.uint16]:
        """Return one B-scan. Raises :class:`EndoctError` where the file ends before it does."""
        bscan = self._bscans[index]
        chain = self._chain
        if self._apodised and bscan.apodised is not None:
            chain = _with_background(chain, mean_spectrum(self._spectra(bscan.apodised)))
        return chain.bscan(self._spectra(bscan.ascans)).T

    def _spectra(self, ascans: AScans) -> Counts:
        """Spectra, u16 or i16 (A-scan, sample), until this thread asks for others."""
        room: Counts = _ROOM.array("counts", (ascans.count, self._n_samples), self._dtype)
        spectra = read_ascans(ascans, self._n_samples, self._dtype, room)
        return spectra.astype(spectra.dtype.newbyteorder("="), copy=False)


def open_thorlabs(path: Path, files: Files, keys: SpectraKeys, device: str | None = None) -> ImageStack:
    """Open the raw spectra in ThorImage's ``files`` as a stack of B-scans (depth, A-scan), made on ``device``.

    Raises :class:`EndoctError` where ``keys`` state something else than the files hold, or a vector is missing.
    """
    recording = open_recording(files)
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
    read = ReadSpectra(kept, first, chain, apodised)
    if device is not None:
        from endoct.modalities.oct.spectra.on_device import OnDevice  # which loads torch

        read = ReadSpectra(kept, first, OnDevice(chain, device), apodised)
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


def _with_background(chain: "Reconstruction | OnDevice", background: Coordinates) -> "Reconstruction | OnDevice":
    if isinstance(chain, Reconstruction):
        return replace(chain, background=background)
    return replace(chain, reference=replace(chain.reference, background=background))
