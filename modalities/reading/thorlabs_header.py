"""What the ``Header.xml`` of a ThorImage file says, as it says it, and how it parts frames into B-scans.

Where a field is missing it is None; where it cannot be what it should be, the file is refused. How far depth samples
lie apart it says up to three times, in some medium.
"""

import math
import re
from dataclasses import dataclass
from xml.etree.ElementTree import Element

from endoct.base.errors import EndoctError
from endoct.base.files.xml_tree import read_xml
from endoct.base.files.zip_members import key_of
from endoct.modalities.reading.remarks import NONE, Remarks, doubted

ALIKE = 0.01
"""Lengths that say the same may differ by this share."""
LEAST_PIXEL_MM, MOST_PIXEL_MM = 1e-4, 0.2
"""Depth samples lie so far apart; what a header says beyond is of something else."""
ROOT = "Ocity"
MOST = 10**9
_WHOLE = re.compile(r"\+?[0-9]{1,12}")
Region = tuple[int, int]


@dataclass(frozen=True)
class DataFile:
    """One file of data: ``key`` of its member, its ``kind`` (Raw, Real, Complex, Colored), samples along each axis.

    ``apodised`` and ``scanned``: from which A-scan up to which, not included, lie spectra without and with the sample.
    """

    key: str
    kind: str
    size_z: int
    size_x: int
    size_y: int
    range_z_mm: float | None
    sample_bytes: int | None
    apodised: tuple[Region, ...]
    scanned: tuple[Region, ...]


@dataclass(frozen=True)
class Header:
    """The header: sizes in pixels and mm of what the program showed, what it averaged, and the instrument."""

    data_files: tuple[DataFile, ...]
    mode: str
    size_z: int | None
    size_x: int | None
    size_y: int | None
    depth_mm: float | None
    depth_pixel_mm: float | None
    slices_mm: float | None
    axis_order: str
    refractive_index: float | None
    spectra_averaged: int
    ascans_averaged: int
    bscans_averaged: int
    is_signed: bool | None
    sample_bytes: int | None
    electrons_per_count: float | None
    recorded_s: float | None


def read_header(data: bytes, subject: str) -> Header:
    """Return what the header says that ``subject`` names. Raises :class:`EndoctError` where it is none."""
    root = read_xml(data, subject)
    if root.tag != ROOT:
        raise EndoctError(f"{subject} is no header of a ThorImage file", found=root.tag[:80], expected=ROOT)
    read = _Fields(root, subject)
    signed = read.text("Instrument/RawDataIsSigned").lower()
    size_y, slices_mm = read.whole("Image/SizePixel/SizeY"), read.length("Image/SizeReal", "SizeY")
    averaged = read.whole("Acquisition/IntensityAveraging/BScans") or 1
    averaged *= read.whole("Acquisition/SpeckleAveraging/SlowAxis") or 1
    if slices_mm is not None and slices_mm < 0:  # what is counted along y are repeats of one place
        size_y, averaged = 1, size_y or 1
    return Header(
        data_files=tuple(_data_file(element, subject) for element in root.findall("DataFiles/DataFile")),
        mode=read.text("MetaInfo/AcquisitionMode"),
        size_z=read.whole("Image/SizePixel/SizeZ"),
        size_x=read.whole("Image/SizePixel/SizeX"),
        size_y=size_y,
        depth_mm=read.length("Image/SizeReal", "SizeZ"),
        depth_pixel_mm=read.length("Image/PixelSpacing", "SizeZ"),
        slices_mm=slices_mm,
        axis_order=read.text("Image/AxisOrder"),
        refractive_index=read.number("Acquisition/RefractiveIndex"),
        spectra_averaged=read.whole("Acquisition/IntensityAveraging/Spectra") or 1,
        ascans_averaged=read.whole("Acquisition/IntensityAveraging/AScans") or 1,
        bscans_averaged=averaged,
        is_signed={"true": True, "false": False}.get(signed),
        sample_bytes=read.whole("Instrument/BytesPerPixel"),
        electrons_per_count=read.number("Instrument/BinaryToElectronCountScaling"),
        recorded_s=float(time) if _WHOLE.fullmatch(time := read.text("Acquisition/Timestamp")) else None,
    )


def regions_of(file: DataFile, header: Header, subject: str, *, all_in_one: bool) -> list[tuple[Region | None, Region]]:
    """Return, for every B-scan in a frame, which of its A-scans were taken without the sample, if any, and with it.

    ``all_in_one``: it is the only frame. Raises :class:`EndoctError` where it has fewer A-scans.
    """
    n_lines = file.size_x
    if any(end > n_lines for _, end in (*file.apodised, *file.scanned)):
        raise EndoctError(
            f"{file.key} in {subject} has fewer A-scans than its regions",
            found=f"{n_lines}",
            expected=f"{max(end for _, end in (*file.apodised, *file.scanned))}",
        )
    without = file.apodised[0] if file.apodised else None
    if len(file.scanned) > 1:
        return [(file.apodised[k] if k < len(file.apodised) else without, scan) for k, scan in enumerate(file.scanned)]
    scan = file.scanned[0] if file.scanned else (without[1] if without else 0, n_lines)
    n_bscans = (header.size_y or 1) * header.bscans_averaged
    n_ascans = (header.size_x or 0) * header.ascans_averaged * header.spectra_averaged
    if not all_in_one or n_bscans < 2 or not n_ascans:
        return [(without, scan)]
    if scan[1] - scan[0] == n_bscans * n_ascans:  # one apodisation, if any, before all of them
        return [(without, (scan[0] + k * n_ascans, scan[0] + (k + 1) * n_ascans)) for k in range(n_bscans)]
    block, rest = divmod(n_lines, n_bscans)
    if rest or block <= n_ascans:
        return [(without, scan)]
    starts = range(0, n_lines, block)  # each with an apodisation of its own before it
    return [((at, at + block - n_ascans), (at + block - n_ascans, at + block)) for at in starts]


@dataclass(frozen=True)
class _Fields:
    """The fields below an element, by their paths."""

    root: Element
    subject: str

    def text(self, path: str) -> str:
        return (self.root.findtext(path) or "").strip()

    def whole(self, path: str) -> int | None:
        return _whole(self.text(path), path, self.subject)

    def number(self, path: str) -> float | None:
        return _number(self.text(path), path, self.subject)

    def length(self, parent: str, name: str) -> float | None:
        """Return a length in mm; None where its unit is another."""
        found = self.root.find(parent)
        unit = "mm" if found is None else found.get("Unit", "mm")
        return self.number(f"{parent}/{name}") if unit == "mm" else None


def _data_file(element: Element, subject: str) -> DataFile:
    name = (element.text or "").strip()
    of = f"{name[:80]} in {subject}"

    def whole(attribute: str) -> int | None:
        return _whole(element.get(attribute, "").strip(), attribute, of)

    return DataFile(
        key=key_of(name),
        kind=element.get("Type", ""),
        size_z=whole("SizeZ") or 1,
        size_x=whole("SizeX") or 1,
        size_y=whole("SizeY") or 1,
        range_z_mm=_number(element.get("RangeZ", "").strip(), "RangeZ", of),
        sample_bytes=whole("BytesPerPixel"),
        apodised=_regions(element, "Apo", of),
        scanned=_regions(element, "Scan", of),
    )


def _regions(element: Element, kind: str, of: str) -> tuple[Region, ...]:
    """Return the regions that are numbered from 0 on, those left out that are empty."""
    regions: list[Region] = []
    while f"{kind}RegionEnd{len(regions)}" in element.attrib:
        start, end = (element.get(f"{kind}Region{at}{len(regions)}", "0").strip() for at in ("Start", "End"))
        regions.append((_whole(start, f"{kind}RegionStart", of) or 0, _whole(end, f"{kind}RegionEnd", of) or 0))
    return tuple(region for region in regions if region[1] > region[0])


def _whole(text: str, field: str, subject: str) -> int | None:
    if not text:
        return None
    if not _WHOLE.fullmatch(text) or int(text) > MOST:
        raise EndoctError(
            f"'{field}' of {subject} is no count", found=text[:80], expected=f"a whole number up to {MOST}"
        )
    return int(text)


def _number(text: str, field: str, subject: str) -> float | None:
    if not text:
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise EndoctError(f"'{field}' of {subject} is no number", found=text[:80], expected="one with a point")
    return value


def axial_pixel_mm(header: Header, range_z_mm: float | None, n_depth: int, name: str) -> tuple[float | None, Remarks]:
    """Return the distance of ``n_depth`` samples in air, mm; None where it is not said, or not to be believed.

    ``range_z_mm``: what is said of the data; ``name``: of the file, for doubts.
    """
    said = {"RangeZ of its data": range_z_mm and range_z_mm / n_depth}
    if header.size_z in (None, n_depth):
        said |= {"SizeReal": header.depth_mm and header.depth_mm / n_depth, "PixelSpacing": header.depth_pixel_mm}
    pixels = {where: pixel for where, pixel in said.items() if pixel}
    if not pixels:
        return None, NONE
    pixel_mm, index = next(iter(pixels.values())), header.refractive_index
    if not all(alike(pixel_mm, other) for other in pixels.values()):
        listed = ", ".join(f"{1000 * pixel:.4g} µm by {where}" for where, pixel in pixels.items())
        what = f"The header of {name} gives several distances of depth samples, none of which was taken: {listed}."
        return None, doubted("thorlabs-depth", what)
    if index is None or index == 1:
        return _plausible(pixel_mm), NONE
    what = f"The header of {name} applies a refractive index of {index:g} to the whole image"
    if not 1 < index <= 2:
        return None, doubted("thorlabs-index", f"{what}, which none has: its depths were not taken.", index, 1.0)
    what += ": depths are divided by it. It should be that of what fills the bore; where that is another, state "
    return _plausible(pixel_mm * index), doubted("thorlabs-index", f"{what}medium_index.", index, 1.0)


def _plausible(axial_mm: float) -> float | None:
    return axial_mm if LEAST_PIXEL_MM <= axial_mm <= MOST_PIXEL_MM else None


def alike(number: float, other: float) -> bool:
    """Say whether two numbers are the same, as programs round them."""
    return abs(number - other) <= ALIKE * max(abs(number), abs(other))
