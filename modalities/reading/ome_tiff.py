"""OME-TIFF: a TIFF whose first page describes all of them in XML (docs.openmicroscopy.org/ome-model, OME-TIFF 6).

``Pixels`` states sizes in X, Y, Z, C and T, the order of planes, and physical sizes with their units. Without a unit
these are µm and s. ``TiffData`` says which plane lies on which page, and may name another file. A frame is a plane
along Z or T, whichever has several. ``Plane`` may say of each where the stage stood and when it was taken. The traps:

- several images;
- channels in planes of their own;
- frames that are called channels because nobody named the axes;
- frames in other files;
- units that are none ("pixel", and the "reference frame" that a stage's place has by itself).
"""

import math
from dataclasses import replace
from pathlib import Path
from typing import Literal
from xml.etree.ElementTree import Element

import numpy as np

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import open_regular
from endoct.base.files.xml_tree import MOST_BYTES, local_name, read_xml
from endoct.modalities.reading.format import Files, Format, Frames, Stated
from endoct.modalities.reading.numbering import Along
from endoct.modalities.reading.physical_sizes import MM, SECONDS, Steps, in_units
from endoct.modalities.reading.remarks import NONE, Remarks, doubted
from endoct.modalities.reading.tiff import of_first_page, read_tiff
from endoct.modalities.reading.tiff_directory import MOST_PAGES, pages

DESCRIPTION = 270
JITTER = 0.1
"""Places of a stage and times of a camera jitter by this share of a step."""
LOOKED_AT = 4096
ORDERS = ("XYZCT", "XYZTC", "XYCTZ", "XYCZT", "XYTCZ", "XYTZC")
PLAIN = "export it as a plain TIFF, one page a frame"


def _claims(path: Path) -> bool:
    return "<OME" in (of_first_page(path, lambda page, file: page.text(file, DESCRIPTION, LOOKED_AT)) or "")


def _open(files: Files) -> Frames:
    path = files[0]
    n_pages, read = read_tiff(path)
    root = _description(path)
    with refusing(f"the OME-XML of {path} cannot be used", remedy=PLAIN):
        pixels = _pixels(path, root)
        planes, on_planes = _planes(path, root, pixels, n_pages)
        along, on_places = _along(pixels, len(planes))
        remarks = _steps(pixels).remarks + on_planes + on_places
    x, y = _length_mm(pixels, "X"), _length_mm(pixels, "Y")
    return Frames(len(planes), replace(read, order=planes, pixel_aspect=x / y if x and y else 1.0), along, remarks)


def _states(files: Files) -> Stated:
    path = files[0]
    with refusing(f"the OME-XML of {path} cannot be used", remedy=PLAIN):
        return _steps(_pixels(path, _description(path))).stated(f"the OME-XML of {path.name}")


def _description(path: Path) -> Element:
    with refusing(f"{path} is no readable TIFF", remedy="copy or export it again"), open_regular(path) as file:
        text = next(pages(path, file)).text(file, DESCRIPTION, MOST_BYTES)
    return read_xml(text.rstrip("\0").encode("latin-1"), f"the OME-XML of {path}")


def _pixels(path: Path, root: Element) -> Element:
    found = [element for element in root.iter() if local_name(element) == "Pixels"]
    if len(found) != 1:
        raise EndoctError(
            f"{path} holds {'several images' if found else 'no image'}",
            found=f"{len(found)} in its OME-XML",
            expected="one recording in a file",
            remedy=PLAIN,
        )
    return found[0]


def _sizes(path: Path, pixels: Element) -> dict[str, int]:
    sizes = {axis: int(pixels.get(f"Size{axis}", "1")) for axis in "ZCT"}
    samples = [int(each.get("SamplesPerPixel", "1")) for each in pixels if local_name(each) == "Channel"]
    if len(samples) == 1 and samples[0] == sizes["C"]:
        sizes["C"] = 1  # colours side by side in a plane
    several = [axis for axis in "ZCT" if sizes[axis] > 1]
    if min(sizes.values()) < 1 or max(sizes.values()) > MOST_PAGES or len(several) > 1:
        raise EndoctError(
            f"{path} has the wrong dimensions",
            found=", ".join(f"Size{axis} = {size}" for axis, size in sizes.items()),
            expected="frames along Z or T, one channel",
            remedy=PLAIN,
        )
    return sizes


def _planes(path: Path, root: Element, pixels: Element, n_pages: int) -> tuple[tuple[int, ...], Remarks]:
    """Return on which page each frame lies."""
    sizes = _sizes(path, pixels)
    frames = max(sizes, key=lambda axis: sizes[axis])
    if pixels.get("DimensionOrder") not in ORDERS:
        raise EndoctError(f"{path} is damaged", found=f"planes in the order {pixels.get('DimensionOrder')!r:.20}")
    n_frames = sizes[frames]
    blocks = [element for element in pixels if local_name(element) == "TiffData"]
    found: dict[int, int] = {}
    for block in blocks:
        _check_own(path, root, block)
        first_page = int(block.get("IFD", "0"))
        first = int(block.get(f"First{frames}", "0"))
        whole = n_pages if "IFD" not in block.keys() else 1  # noqa: SIM118  # an element is no mapping
        count = int(block.get("PlaneCount", str(min(whole, n_frames - first))))
        if not (first >= 0 and first_page >= 0 and 0 <= count <= n_frames):
            raise EndoctError(f"{path} is damaged", found=f"a block of {count} planes from {first} on")
        found |= {first + k: first_page + k for k in range(count)}
    planes = [found.get(frame, frame if not blocks else -1) for frame in range(n_frames)]
    if min(planes) < 0 or max(planes) >= n_pages or len(set(planes)) < n_frames:
        raise EndoctError(
            f"{path} does not hold the frames that it describes",
            found=f"{n_pages} pages",
            expected=f"{n_frames} frames, each on a page of its own",
            remedy="copy or export it again",
        )
    if frames != "C" or n_frames == 1:
        return tuple(planes), NONE
    what = f"The OME-XML calls the {n_frames} planes channels, not places or times; they were taken for frames."
    return tuple(planes), doubted("frames-as-channels", what, float(n_frames))


def _along(pixels: Element, n_frames: int) -> tuple[Along | None, Remarks]:
    """Return where frames lie by the planes' own places, or else, of frames along T, by their times.

    A place or a time that is the same throughout says nothing.
    """
    axis = "T" if int(pixels.get("SizeT", "1")) > 1 else "Z" if int(pixels.get("SizeZ", "1")) > 1 else "C"
    planes = {plane.get(f"The{axis}", ""): plane for plane in pixels if local_name(plane) == "Plane"}
    in_order = [planes.get(str(k)) for k in range(n_frames)]
    for name, units in (("PositionZ", MM), ("DeltaT", SECONDS)):
        if name == "DeltaT" and axis != "T":
            continue
        values = [None if plane is None else plane.get(name) for plane in in_order]
        told = [float(value) for value in values if value is not None]
        if n_frames < 2 or len(set(told)) < 2:
            continue
        if len(told) < n_frames or not all(map(math.isfinite, told)):
            what = f"The OME-XML states {name} of {len(told)} of {n_frames} frames; all were placed evenly."
            return None, doubted("frames-uneven", what)
        assumed = "s" if name == "DeltaT" else ""
        stated = {plane.get(f"{name}Unit", assumed) for plane in in_order if plane is not None}
        factor = units.get(stated.pop()) if len(stated) == 1 else None
        along = np.array(told) * (factor or 1.0)
        along = along if along[-1] > along[0] else -along
        unit: Literal["", "mm", "s"] = "" if factor is None else "mm" if units is MM else "s"
        return Along(along, unit, f"{name} in the OME-XML", within=JITTER), NONE
    return None, NONE


def _length_mm(pixels: Element, axis: str) -> float | None:
    return in_units(pixels.get(f"PhysicalSize{axis}"), pixels.get(f"PhysicalSize{axis}Unit", "µm"), MM)


def _check_own(path: Path, root: Element, block: Element) -> None:
    """Raise :class:`EndoctError` where planes lie in another file."""
    for element in block:
        if local_name(element) == "UUID" and element.text != root.get("UUID"):
            name = element.get("FileName")
            if name != path.name:
                raise EndoctError(
                    f"{path} is a part of a recording",
                    found=f"frames in another file, {name!r:.60}",
                    remedy="export all frames into one file",
                )


def _steps(pixels: Element) -> Steps:
    """Return what a description states of sizes; µm and s are what has no unit."""
    along_t = int(pixels.get("SizeT", "1")) > 1
    row_mm, frame_mm = _length_mm(pixels, "Y"), _length_mm(pixels, "Z")
    frame_s = in_units(pixels.get("TimeIncrement"), pixels.get("TimeIncrementUnit", "s"), SECONDS)
    return Steps(row_mm, None if along_t else frame_mm, frame_s if along_t else None)


OME_TIFF = Format("OME-TIFF", _claims, _open, _states)
