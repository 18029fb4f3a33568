"""One ThorImage file: where its B-scans lie in it, whatever its header claims. See :mod:`.thorlabs` for the format."""

import functools
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np

from endoct.base.errors import EndoctError
from endoct.base.files.files import check_array_size, read_start, state_of
from endoct.base.files.zip_members import ZIP_START, Member, check_held, list_members, read_member
from endoct.modalities.reading.remarks import NONE, Remarks, doubted
from endoct.modalities.reading.thorlabs_header import ROOT, DataFile, Header, axial_pixel_mm, read_header, regions_of

SampleKind = Literal["raw", "real", "complex"]
NAME = "a Thorlabs OCT file (ThorImage)"
HEADER = "header.xml"
MOST_HEADER_BYTES = 16_000_000
INTENSITY, COMPLEX = "data/intensity.data", "data/complex.data"
_SPECTRAL = re.compile(r"data/spectral([0-9]{1,9})\.data")
_ROOT = re.compile(rf"<\s*{ROOT}\b")
_FIRST_MEMBER = re.compile(rb"(data[\\/][A-Za-z0-9_]+\.data|Header\.xml)")
_STORAGE = "in ThorImage choose, under Settings, to store processed data or raw spectra, and save it again"


@dataclass(frozen=True)
class AScans:
    """``count`` A-scans of a member, from the A-scan ``first`` on."""

    member: Member
    first: int
    count: int


@dataclass(frozen=True)
class BScan:
    """Where one B-scan lies; of raw spectra also those that were taken without the sample, if any."""

    ascans: AScans
    apodised: AScans | None = None


@dataclass(frozen=True, eq=False)
class Container:
    """One opened file: its B-scans, of ``n_samples`` of ``dtype`` an A-scan, and what is to be said of it.

    ``axial_pixel_mm``: of B-scans, in air; None where the header contradicts itself or does not say.
    """

    path: Path
    header: Header
    members: dict[str, Member]
    kind: SampleKind
    dtype: np.dtype[Any]
    n_samples: int
    bscans: tuple[BScan, ...]
    axial_pixel_mm: float | None
    remarks: Remarks

    @property
    def n_ascans(self) -> int:
        """A-scans of every B-scan."""
        return self.bscans[0].ascans.count


def open_container(path: Path) -> Container:
    """Open one file. Raises :class:`EndoctError` where it holds no B-scans that are read."""
    return _container(path, _state(path))


def is_thorlabs(path: Path) -> bool:
    """Say by its content whether a file is one of ThorImage's, also one that was cut off."""
    return _is_thorlabs(path, _state(path))


def _state(path: Path) -> tuple[tuple[str, tuple[int, ...]], ...]:
    """What changes where a file does, so that what was made of it is not used any more."""
    return tuple(sorted(state_of(path).items()))


@functools.lru_cache(maxsize=2048)
def _is_thorlabs(path: Path, _: object) -> bool:
    start = read_start(path, 100)
    if not start.startswith(ZIP_START):
        return False
    header = None
    with suppress(EndoctError):
        header = list_members(path).get(HEADER)
    if header is None:  # cut off, so that nothing lists its members, or packed again without it
        return _FIRST_MEMBER.match(start[30:]) is not None
    try:
        data = read_member(header, MOST_HEADER_BYTES)
    except EndoctError as error:
        return bool(error.what)  # it has one; opening it says what is wrong
    encoding = "utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    return _ROOT.search(data[:4096].decode(encoding, "replace")) is not None


@functools.lru_cache(maxsize=512)
def _container(path: Path, _: object) -> Container:
    members = list_members(path)
    if HEADER not in members:
        raise EndoctError(f"{path} is no ThorImage file", found="no Header.xml", remedy="copy it again")
    header = read_header(read_member(members[HEADER], MOST_HEADER_BYTES), f"Header.xml in {path}")
    listed = {file.key: file for file in header.data_files}
    if len(listed) < len(header.data_files):
        raise EndoctError(f"Header.xml in {path} lists a file of data twice")
    if header.axis_order and not header.axis_order.upper().startswith("ZXY"):
        raise EndoctError(
            f"{path} is not read", found=f"samples in the order {header.axis_order[:20]}", expected="ZXY, depth fastest"
        )
    raw = [file for key, file in listed.items() if _SPECTRAL.fullmatch(key) and file.kind.startswith("Raw")]
    raw.sort(key=_number)
    for key, kind, dtype in ((INTENSITY, "Real", np.dtype("<f4")), (COMPLEX, "Complex", np.dtype("<c8"))):
        if key in listed and listed[key].kind == kind:
            return _processed(path, header, members, listed[key], dtype, len(raw))
    if raw:
        return _raw(path, header, members, raw)
    raise _nothing_read(path, header)


def _number(file: DataFile) -> int:
    return int(file.key.removeprefix("data/spectral").removesuffix(".data"))


def _processed(
    path: Path, header: Header, members: dict[str, Member], file: DataFile, dtype: np.dtype[Any], n_raw: int
) -> Container:
    if file.sample_bytes not in (None, dtype.itemsize):
        raise EndoctError(
            f"{file.key} in {path} is not read",
            found=f"{file.sample_bytes} bytes a sample",
            expected=f"{dtype.itemsize}, for {file.kind}",
        )
    member = _member(path, members, file)
    check_array_size((file.size_x, file.size_z), dtype.itemsize, f"a B-scan of {path}")
    n_bscans = _whole_parts(member, file.size_x * file.size_z * dtype.itemsize, "B-scans", file)
    bscans = tuple(BScan(AScans(member, k * file.size_x, file.size_x)) for k in range(n_bscans))
    both = "The file holds B-scans and raw spectra; the B-scans were read."
    remarks = Remarks(notes=(both,)) if n_raw else NONE
    if (header.slices_mm or 0) < 0:
        bscans, on_places = _one_a_place(path, bscans, header)
        remarks += on_places
    if n_bscans != file.size_y:
        remarks += _miscounted(path, n_bscans, file.size_y)
    kind: SampleKind = "complex" if dtype.kind == "c" else "real"
    return _described(Container(path, header, members, kind, dtype, file.size_z, bscans, None, remarks), file)


def _raw(path: Path, header: Header, members: dict[str, Member], files: list[DataFile]) -> Container:
    n_samples = files[-1].size_z
    for before, after in pairwise(map(_number, files)):
        if after != before + 1:
            found = f"no spectra between {before} and {after}"
            raise EndoctError(f"{path} is incomplete", found=found, remedy="copy or export it again")
    if {file.size_z for file in files} != {n_samples} or n_samples % 2:
        sizes = sorted({file.size_z for file in files})
        raise EndoctError(
            f"the spectra in {path} cannot be read", found=f"{sizes} samples"[:80], expected="one even number for all"
        )
    sample_bytes = files[-1].sample_bytes or header.sample_bytes
    if sample_bytes != 2:
        raise EndoctError(f"the spectra in {path} cannot be read", found=f"{sample_bytes} bytes a sample", expected="2")
    if header.is_signed is None:
        raise EndoctError(f"Header.xml in {path} does not say whether samples have a sign", expected="RawDataIsSigned")
    bscans: list[BScan] = []
    apodised: AScans | None = None
    alone = len(files) == 1
    for file in files:
        member = _member(path, members, file)
        check_array_size((file.size_x, n_samples), sample_bytes, f"a B-scan of {path}")
        n_blocks = _whole_parts(member, file.size_x * n_samples * sample_bytes, "frames", file)
        if file.apodised and not file.scanned and not alone:  # without the sample, all of it
            apodised = AScans(member, 0, n_blocks * file.size_x)
            continue
        for k in range(n_blocks):
            regions = regions_of(file, header, str(path), all_in_one=alone and n_blocks == 1)
            at = k * file.size_x
            for without, scan in regions:
                if without is not None:
                    apodised = AScans(member, at + without[0], without[1] - without[0])
                bscans.append(BScan(AScans(member, at + scan[0], scan[1] - scan[0]), apodised))
    counts = {bscan.ascans.count for bscan in bscans}
    if len(counts) != 1 or 0 in counts:
        found = f"B-scans of {', '.join(map(str, sorted(counts)[:4]))} A-scans" if any(counts) else "apodisation alone"
        raise EndoctError(f"the spectra in {path} are no B-scans of one size", found=found)
    places, remarks = _one_a_place(path, bscans, header)
    if unlisted := sum(_SPECTRAL.fullmatch(key) is not None for key in members) - len(files):
        what = f"{path.name} holds {unlisted} more spectra than its header lists."
        remarks += doubted("thorlabs-count", what, unlisted, 0)
    if not header.electrons_per_count:
        note = f"The header of {path.name} does not say how many electrons a count is; levels are of counts."
        remarks += Remarks(notes=(note,))
    n_ascans, averaged = counts.pop(), header.ascans_averaged * header.spectra_averaged
    if header.size_x is not None and n_ascans not in (header.size_x, averaged * header.size_x):
        what = (
            f"The header of {path.name} says {header.size_x} A-scans a B-scan, {averaged} averaged; the file holds "
            f"{n_ascans}, which were all read as one turn."
        )
        remarks += doubted("thorlabs-count", what, n_ascans, header.size_x)
    dtype = np.dtype("<i2" if header.is_signed else "<u2")
    return _described(Container(path, header, members, "raw", dtype, n_samples, places, None, remarks), files[-1])


def _one_a_place(path: Path, bscans: Sequence[BScan], header: Header) -> tuple[tuple[BScan, ...], Remarks]:
    """Return the first B-scan of every place; the others are not averaged, as turns do not begin at one angle."""
    n, places, stated = len(bscans), header.size_y or 1, header.bscans_averaged
    repeats = stated if n == places * stated else n // places if places > 1 and n % places == 0 else 1
    kept = tuple(bscans[::repeats])
    if n == places * stated:
        note = f"Of {repeats} B-scans at every place the first was read; they were not averaged."
        return kept, Remarks(notes=(note,)) if repeats > 1 else NONE
    if repeats > 1:
        what = (
            f"{path.name} holds {n} B-scans, its header says {places} places and {stated} B-scans averaged at each. "
            f"{repeats} were taken for one place, and the first of them was read."
        )
        return kept, doubted("thorlabs-averaging", what, repeats, stated)
    return kept, _miscounted(path, n, places) if header.size_y is not None else NONE


def _described(container: Container, file: DataFile) -> Container:
    """Return the container with its scale in depth, and with what is to be said of its header."""
    name, slices_mm = container.path.name, container.header.slices_mm
    n_depth = container.n_samples // 2 if container.kind == "raw" else container.n_samples
    axial_mm, remarks = axial_pixel_mm(container.header, file.range_z_mm, n_depth, name)
    if slices_mm and len(container.bscans) > 1:
        note = (
            f"The header of {name} says {slices_mm:g} mm across the B-scans: the range of the program's own scanner, "
            "which was not taken for the pullback's."
        )
        remarks += Remarks(notes=(note,))
    if any("_cam1" in key for key in container.members):
        remarks += Remarks(notes=(f"Of the two cameras of {name} the first was read.",))
    return replace(container, axial_pixel_mm=axial_mm, remarks=container.remarks + remarks)


def _member(path: Path, members: dict[str, Member], file: DataFile) -> Member:
    if file.key not in members:
        raise EndoctError(f"{path} is incomplete", found=f"no {file.key[:80]}", remedy="copy or export it again")
    check_held(members[file.key])
    return members[file.key]


def _whole_parts(member: Member, part_bytes: int, of: str, file: DataFile) -> int:
    n, rest = divmod(member.n_bytes, part_bytes)
    if rest or not n or n > 10**6:
        raise EndoctError(
            f"{member} holds no whole {of}",
            found=f"{member.n_bytes} bytes",
            expected=f"a multiple of {part_bytes}, for {file.size_x} A-scans of {file.size_z} samples",
            remedy="copy or export it again",
        )
    return n


def _nothing_read(path: Path, header: Header) -> EndoctError:
    kinds = {file.kind for file in header.data_files if "image" not in file.key}
    if header.mode == "Mode1D" or any(file.key == "data/spectralfloat.data" for file in header.data_files):
        found = "single A-scans (Mode1D)"
    elif kinds == {"Colored"}:
        found = "coloured images alone, whose colours cannot be undone"
    else:
        found = f"data of the kinds {', '.join(sorted(kinds))[:80]}" if kinds - {""} else "no data"
    return EndoctError(
        f"{path} holds no B-scans that are read", found=f"{NAME} with {found}",
        expected="Intensity, Complex or Spectral data", remedy=_STORAGE,
    )  # fmt: skip


def _miscounted(path: Path, counted: int, stated: int) -> Remarks:
    what = f"{path.name} holds {counted} B-scans, its header says {stated}; all that are there were read."
    return doubted("thorlabs-count", what, counted, stated)
