"""Where slices of raw spectra lie: in one file or in one a stop, so many A-scans each, or as turns are found."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image
from endoct.base.compute.memory import Room
from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import check_array_size, entries, inside, is_folder, open_regular
from endoct.modalities.oct.spectra.keys import COUNTS_PER_DB, SpectraKeys
from endoct.modalities.oct.spectra.reconstruction import Counts, Reconstruction, mean_spectrum
from endoct.modalities.oct.spectra.turns import Levels, find_turns, usual_turn
from endoct.modalities.reading.frame_names import read_names
from endoct.modalities.reading.remarks import NONE, Remarks

_ROOM = Room()
MANY = "*"
"""In the name of a file, this stands for what differs from stop to stop; there is a file for each."""
FOR_MEAN = 4096
"""Where turns are looked for, the mean of so many A-scans, from all over a file, is the background."""
UNLIKE = 0.25
"""A turn is doubted where the stream correlates by less with itself a turn later."""


@dataclass(frozen=True, eq=False)
class Slices:
    """Where each slice lies, in the order recorded.

    Attributes: ``files``; ``file`` intp (n,), which of them; ``first`` and ``length`` float64 (n,), its A-scans there;
    ``ascans`` that its B-scan has; ``remarks`` on how they were found.
    """

    files: tuple[Path, ...]
    file: NDArray[np.intp]
    first: Coordinates
    length: Coordinates
    ascans: int
    remarks: Remarks = NONE

    def __len__(self) -> int:
        return self.first.size

    def counts(self, index: int, keys: SpectraKeys) -> Counts:
        """Return the samples of one slice (A-scan, sample), until this thread asks for another.

        Raises :class:`EndoctError` where the file ends before it does.
        """
        step = self.length[index] / self.ascans
        places = np.floor(self.first[index] + (np.arange(self.ascans) + 0.5) * step).astype(np.intp)
        n = int(places[-1] - places[0] + 1)
        counts: Counts = _ROOM.array("counts", (n, keys.samples), keys.dtype)
        read_ascans(self.files[self.file[index]], [(int(places[0]), counts)], f"slice {index} incomplete")
        counts = counts.astype(counts.dtype.newbyteorder("="), copy=False)
        return counts if n == self.ascans else counts[places - places[0]]


def read_ascans(file: Path, parts: Iterable[tuple[int, Counts]], where_short: str) -> None:
    """Fill arrays (A-scan, sample) with what ``file`` holds from an A-scan on, whose number stands before each.

    Raises :class:`EndoctError` where it ends before, with ``where_short`` as what was found.
    """
    with refusing(f"{file} cannot be read"), open_regular(file) as opened:
        for first, counts in parts:
            opened.seek(first * counts.nbytes // len(counts))
            if opened.readinto(counts.data) != counts.nbytes:
                raise EndoctError(f"{file} is truncated", found=where_short, remedy="copy it again")


def find_slices(path: Path, keys: SpectraKeys, chain: Reconstruction) -> Slices:
    """Return the slices of the recording at ``path``, a folder or the file itself.

    Where ``keys`` do not state how many A-scans a turn has, turns are found by what ``chain`` makes of the samples.
    Raises :class:`EndoctError` where a file is missing, does not fit ``keys``, or shows no turns.
    """
    files = _files(path, keys)
    sizes = [_count_ascans(file, keys) for file in files]
    if keys.ascans is None:
        return _by_turns(files, sizes, keys, chain)
    check_array_size((keys.ascans, keys.samples), keys.dtype.itemsize, f"a slice of {files[0]}")
    if len(files) == 1 and MANY not in keys.file:
        n = _count_slices(files[0], sizes[0], keys.ascans, keys.slices)
        file, first = np.zeros(n, np.intp), np.arange(n, dtype=np.float64) * keys.ascans
    else:
        for each, size in zip(files, sizes, strict=True):
            _count_slices(each, size, keys.ascans, 1)
        n = len(files)
        file, first = np.arange(n), np.zeros(n)
    return Slices(files, file, first, np.full(n, float(keys.ascans)), keys.ascans)


def _files(path: Path, keys: SpectraKeys) -> tuple[Path, ...]:
    """Return the files of the samples. Raises :class:`EndoctError` where there are too few."""
    if not is_folder(path):
        return (path,)
    if MANY not in keys.file:
        return (inside(path, keys.file, "'spectra.file' in the sidecar"),)
    found = [file for file in entries(path) if file.match(keys.file) and file.is_file()]
    files = tuple(name.path for name in read_names(found)[0])
    if not files or (keys.slices is not None and keys.slices > len(files)):
        raise EndoctError(
            f"{path} holds too few files of raw spectra",
            found=f"{len(files)} named like {keys.file}",
            expected=f"{keys.slices or 'one'} or more",
            remedy="check 'file' and 'slices' in the sidecar's table 'spectra'",
        )
    return files[: keys.slices]


def _count_ascans(file: Path, keys: SpectraKeys) -> int:
    with refusing(f"{file} cannot be read"), open_regular(file) as opened:
        size = opened.seek(0, 2)
    ascan = keys.samples * keys.dtype.itemsize
    if size % ascan or not size:
        raise EndoctError(
            f"{file} does not hold a whole number of A-scans",
            found=f"{size} bytes",
            expected=f"a multiple of {ascan}, for {keys.samples} samples of {keys.sample_type}",
            remedy="check 'samples' and 'sample_type' in the sidecar, and that the file has no header",
        )
    return size // ascan


def _count_slices(file: Path, n_ascans: int, ascans: int, slices: int | None) -> int:
    whole, rest = divmod(n_ascans, ascans)
    if slices is not None:
        if slices > whole:
            raise EndoctError(
                f"{file} holds fewer slices than stated",
                found=f"{whole} of {ascans} A-scans",
                expected=f"{slices}",
                remedy="check 'slices' and 'ascans' in the sidecar, or copy the file again",
            )
        return slices
    if rest or not whole:
        raise EndoctError(
            f"{file} does not end with a whole slice",
            found=f"{n_ascans} A-scans, {rest} more than {whole} slices of {ascans}",
            expected="whole slices",
            remedy="check 'ascans' and 'samples' in the sidecar"
            + (f"; to leave out the last, incomplete turn, state 'slices = {whole}'" if whole else "")
            + "; where turns are not all as long, leave out 'ascans': they are found",
        )
    return whole


def _by_turns(files: tuple[Path, ...], sizes: list[int], keys: SpectraKeys, chain: Reconstruction) -> Slices:
    """Return a slice for every turn of the one file, or for the first turn of each."""
    reads = [_levels(file, size, keys, chain) for file, size in zip(files, sizes, strict=True)]
    usual = usual_turn(reads[0], sizes[0])
    if MANY in keys.file and len(files) > 1:
        each = [find_turns(read, size, usual, most=1) for read, size in zip(reads, sizes, strict=True)]
        file, first = np.arange(len(files)), np.zeros(len(files))
        length = np.array([turns.lengths[0] for turns in each])
        alike = np.array([turns.alike[0] for turns in each])
        rest = 0
    else:
        turns = find_turns(reads[0], sizes[0], usual, most=keys.slices)
        first, length, alike = turns.starts[:-1], turns.lengths, turns.alike
        file, rest = np.zeros(first.size, np.intp), sizes[0] - int(turns.starts[-1])
    if keys.slices is not None and keys.slices > first.size:
        raise EndoctError(
            f"{files[0]} holds fewer turns than stated",
            found=f"{first.size} of about {usual:.0f} A-scans",
            expected=f"{keys.slices}",
            remedy="check 'slices' in the sidecar's table 'spectra'",
        )
    ascans = round(float(np.median(length)))
    return Slices(files, file, first, length, ascans, _remarks(length, alike, rest))


def _remarks(length: Coordinates, alike: Coordinates, rest: int) -> Remarks:
    said = f"Turns were found in the A-scans: {length.size}, of {length.min():.0f} to {length.max():.0f} A-scans."
    notes = (said, *([f"{rest} A-scans after the last whole turn were left out."] if rest else []))
    unlike = int((alike < UNLIKE).sum())
    if not unlike:
        return Remarks(notes)
    what = (
        f"Where turns end is uncertain: {unlike} of {length.size} hardly repeat what the turn before shows. "
        "State 'ascans' where it is known."
    )
    return Remarks(notes, (Doubt("turns-uncertain", what, value=float(alike.min()), unit="1", expected=(UNLIKE, 1.0)),))


def _levels(file: Path, n_ascans: int, keys: SpectraKeys, chain: Reconstruction) -> Levels:
    """Return a function that reads A-scans of ``file`` by their indices, as levels in dB (A-scan, depth)."""

    def read(indices: NDArray[np.intp]) -> Counts:
        counts: Counts = np.empty((indices.size, keys.samples), keys.dtype)
        apart = np.flatnonzero(np.diff(indices) != 1) + 1
        parts = zip(indices[np.r_[0, apart]].tolist(), np.split(counts, apart), strict=True)
        read_ascans(file, parts, "A-scans incomplete")
        return counts.astype(counts.dtype.newbyteorder("="), copy=False)

    some = read(np.arange(0, n_ascans, max(1, n_ascans // FOR_MEAN), dtype=np.intp))
    of_all = replace(chain, background=mean_spectrum(some))

    def levels(indices: NDArray[np.intp]) -> Image:
        return np.asarray(of_all.bscan(read(indices)) / np.float32(COUNTS_PER_DB), np.float32)

    return levels
