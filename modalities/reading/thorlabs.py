"""Thorlabs' ``.oct``, as ThorImage OCT and its SDK (SpectralRadar) write it: a ZIP file with ``Header.xml`` and data.

Nothing public specifies it. The layout is what public readers read and what the SDK's header file describes:

- The header's root is ``Ocity``. ``DataFiles/DataFile`` lists members by name, with ``Type`` (Raw, Real, Complex,
  Colored), ``SizeZ/X/Y``, ``RangeZ/X/Y`` in mm and ``BytesPerPixel``. Little-endian; z fastest, then x, then y.
- ``data\\Intensity.data``: Real, float32, dB. ``data\\Complex.data``: pairs of float32. ``data\\SpectralN.data``:
  Raw, 16 bits, with a sign where ``Instrument/RawDataIsSigned`` says so. ``Chirp.data``, ``OffsetErrors.data``,
  ``ApodizationSpectrum.data``: float32, one value a sample; the latter two in electrons.
- Of raw spectra ``ApoRegionStart0/End0`` and ``ScanRegionStart0/End0`` say which A-scans were taken without and with
  the sample. Chirp: the place of each sample among even wavenumbers.

Checked against KaLKMaNLaB/optical-coherence-tomography (raw, apodisation, Real), the SDK's examples for MATLAB (raw,
Complex, two cameras), MyYo/myOCT and its successor WinetraubLab/myOCT (averaging, chirp), and SpectralRadar.h. Traps,
and who met them:

- ``Spectral0`` may hold the apodisation alone, so that types and sizes are those of ``Spectral1`` (a public converter
  to MAT files); or all B-scans, one behind the other, of which the header says nothing (WinetraubLab/myOCT, pull
  request 147). There is one apodisation for all B-scans, or one for each (SpectralRadar.h).
- ``SpeckleAveraging/SlowAxis`` claims 1 although every place was recorded several times; repeats follow each other
  (WinetraubLab/myOCT, pull request 146).
- A negative ``SizeReal/SizeY`` says that what is counted along y are repeats of one place (MyYo/myOCT,
  ``yOCTLoadInterfFromFile_ThorlabsHeader.m``).
- Members may be missing, or empty, after a copy that failed (WinetraubLab/myOCT, pull request 101).
- Names of members are separated by ``\\`` or by ``/`` (readers differ in what they expect).
- ``RangeZ`` is the depth of the image, of raw spectra too, whose ``SizeZ`` counts twice as many samples as the image
  has: 1.6558 mm, 2048 samples and a pixel of 1.617 µm in a public copy of a GAN632's header. The refractive index is
  "applied to the whole image" (SpectralRadar.h): lengths are those in the medium.
- ``RangeX`` and ``RangeY`` are those of the program's own scanner. A catheter is turned and pulled by something else,
  so that neither is a turn or a pullback: the pitch is asked of the user.

No file of the instrument was at hand.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.errors import EndoctError
from endoct.base.files.zip_members import read_part
from endoct.modalities.reading.format import Files, Format, Frames, Stated
from endoct.modalities.reading.frame_files import choose_frames
from endoct.modalities.reading.numbering import Along
from endoct.modalities.reading.remarks import NONE, Remarks, doubted
from endoct.modalities.reading.thorlabs_file import NAME, AScans, BScan, Container, is_thorlabs, open_container
from endoct.modalities.reading.thorlabs_header import alike

LEAST_DB = -100.0
"""Samples made of complex ones, which may be 0, are no darker than this."""


@dataclass(frozen=True, eq=False)
class ThorlabsRecording:
    """A file, or the files of the stops of a pullback in their order; ``first`` of them says how all are read."""

    containers: tuple[Container, ...]
    along: Along | None
    remarks: Remarks

    @property
    def first(self) -> Container:
        """The first file."""
        return self.containers[0]

    @property
    def bscans(self) -> tuple[BScan, ...]:
        """All B-scans, in their order."""
        return tuple(bscan for container in self.containers for bscan in container.bscans)

    @property
    def by(self) -> str:
        """Whose headers these are, in words."""
        n = len(self.containers)
        return f"the header of {self.first.path.name}" if n == 1 else f"the headers of {n} .oct files"


def open_scan(files: Files) -> ThorlabsRecording:
    """Return the recording that lies in ``files``. Raises :class:`EndoctError` where it cannot be read."""
    if len(files) == 1:
        container = open_container(files[0])
        return ThorlabsRecording((container,), None, container.remarks)
    ordered, along, remarks = _ordered([open_container(file) for file in files])
    first, folder = ordered[0], files[0].parent
    for each in ordered:
        if each.header.slices_mm and len(each.bscans) > 1:
            raise EndoctError(
                f"{folder} holds more than one recording",
                found=f"{each.path.name}, a volume of {len(each.bscans)} B-scans, and {len(files) - 1} more .oct",
                expected="one .oct, or one for every stop of a pullback",
                remedy="keep each recording in a folder of its own",
            )
        if _shape(each) != _shape(first):
            raise EndoctError(
                f"{each.path} differs from {first.path.name}",
                found=_shape(each),
                expected=_shape(first),
                remedy="keep each recording in a folder of its own",
            )
        codes = {doubt.code for doubt in remarks.doubts}  # one doubt of a kind will do for all files
        remarks += Remarks(doubts=tuple(doubt for doubt in each.remarks.doubts if doubt.code not in codes))
    remarks += Remarks(notes=first.remarks.notes) + _on_stops(ordered)
    one_a_stop = tuple(replace(each, bscans=each.bscans[:1]) for each in ordered)
    return ThorlabsRecording(one_a_stop, along, remarks)


def read_ascans(ascans: AScans, n_samples: int, dtype: np.dtype[Any], room: NDArray[Any] | None = None) -> NDArray[Any]:
    """Return A-scans of a file (A-scan, sample), in ``room`` of that shape and ``dtype`` where it is given.

    Raises :class:`EndoctError` where the file ends before they do.
    """
    read: NDArray[Any] = np.empty((ascans.count, n_samples), dtype) if room is None else room
    read_part(ascans.member, ascans.first * n_samples * dtype.itemsize, read.reshape(-1).view(np.uint8).data)
    return read


class ReadBScans:
    """Reads B-scans that ThorImage made: called with an index, returns one, float32 dB (depth, A-scan)."""

    def __init__(self, recording: ThorlabsRecording) -> None:
        self._bscans = recording.bscans
        self._n_samples, self._dtype = recording.first.n_samples, recording.first.dtype

    def __call__(self, index: int) -> NDArray[np.float32]:
        """Return one B-scan. Raises :class:`EndoctError` where the file ends before it does."""
        read = read_ascans(self._bscans[index].ascans, self._n_samples, self._dtype)
        if read.dtype.kind == "c":
            power = np.square(read.real) + np.square(read.imag)
            read = 10 * np.log10(np.maximum(power, np.float32(10 ** (LEAST_DB / 10))))
        return np.asarray(read, np.float32).T


def _open(files: Files) -> Frames:
    recording = open_scan(files)
    if recording.first.kind == "raw":
        raise EndoctError(
            f"{recording.first.path} holds raw spectra, of which only the modality 'oct' makes images",
            remedy="read it with modality='oct'",
        )
    return Frames(len(recording.bscans), ReadBScans(recording), recording.along, recording.remarks)


def _states(files: Files) -> Stated:
    """Return what the header states; in mm of air, as sidecars have it.

    Not what it knows nothing of: bore, capillary and pullback.
    """
    recording = open_scan(files)
    first = recording.first
    keys: dict[str, Any] = {"modality": "oct"}
    pixels = [each.axial_pixel_mm for each in recording.containers]
    if (pixel := pixels[0]) is not None and all(each is not None and alike(each, pixel) for each in pixels):
        keys["axial_pixel_mm"] = pixel
    if "axial_pixel_mm" in keys and (index := first.header.refractive_index) is not None and index != 1:
        keys["medium_index"] = index
    if first.kind != "raw":
        return Stated({**keys, "intensity": "log", "db_per_count": 1.0}, recording.by)
    spectra: dict[str, Any] = {
        "file": first.path.name,
        "samples": first.n_samples,
        "ascans": first.n_ascans,
        "sample_type": "i16" if first.dtype.kind == "i" else "u16",
        "chirp": _vector(first, "Chirp"),
    }
    if spectra["chirp"] is None:
        raise EndoctError(
            f"{first.path} holds raw spectra and no chirp",
            expected="data\\Chirp.data in it, or Chirp.dat next to it",
            remedy="copy Chirp.dat from the folder SpectralRadar\\Config of the Thorlabs program next to it",
        )
    if (offset := _vector(first, "OffsetErrors")) is not None:
        spectra["offset"] = offset
    if first.header.electrons_per_count:
        spectra["electrons_per_count"] = first.header.electrons_per_count
    return Stated({**keys, "spectra": spectra}, recording.by)


def _vector(container: Container, name: str) -> str | None:
    """Return the name of a vector with one value a sample in the file, or next to it; None where there is none."""
    if f"data/{name.lower()}.data" in container.members:
        return f"data/{name}.data"
    beside = (container.path.with_name(name + suffix) for suffix in (".dat", ".data"))
    return next((file.name for file in beside if file.is_file()), None)


def _ordered(containers: list[Container]) -> tuple[list[Container], Along | None, Remarks]:
    """Put the stops of a pullback in the order of their names, or else of the times at which they were recorded."""
    by_path = {each.path: each for each in containers}
    chosen = choose_frames(containers[0].path.parent, list(by_path), lambda *_: False)
    ordered = [by_path[file] for file in chosen.files]
    times = [each.header.recorded_s or 0.0 for each in ordered]
    if not all(times) or all(before <= after for before, after in pairwise(times)):  # 0: nobody said
        return ordered, chosen.along, chosen.remarks
    if chosen.along is None and len(set(times)) == len(times):
        note = "Stops were put in the order of the times in their headers, as their names have no numbers that count."
        in_time = sorted(ordered, key=lambda each: each.header.recorded_s or 0.0)
        return in_time, None, Remarks(notes=(*chosen.remarks.notes, note))
    at = next(k for k, (before, after) in enumerate(pairwise(times)) if before > after)
    what = (
        f"By its name {ordered[at + 1].path.name} follows {ordered[at].path.name}, but the times in their headers say "
        "that it was recorded before it; stops were put in the order of their names."
    )
    return ordered, chosen.along, chosen.remarks + doubted("stops-order", what)


def _on_stops(containers: list[Container]) -> Remarks:
    first, remarks = containers[0], NONE
    several = [each for each in containers if len(each.bscans) > 1]
    if several:
        what = (
            f"{len(several)} of {len(containers)} files hold several B-scans, {several[0].path.name} "
            f"{len(several[0].bscans)}; of every file the first was read, as a stop."
        )
        remarks += doubted("stops-repeated", what, len(several), 0)
    other = [each for each in containers if _crc(each) != _crc(first)]
    if first.kind == "raw" and other:
        what = f"{other[0].path.name} has another chirp than {first.path.name}, by which all spectra were read."
        remarks += doubted("stops-differ", what, len(other), 0)
    return remarks


def _crc(container: Container) -> int | None:
    chirp = container.members.get("data/chirp.data")
    return None if chirp is None else chirp.crc


def _shape(container: Container) -> str:
    return f"{container.n_ascans} A-scans of {container.n_samples} samples, {container.kind} {container.dtype}"


THORLABS = Format(NAME, is_thorlabs, _open, _states, joins=True)
