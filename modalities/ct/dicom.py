"""A CT, or a segmentation of one, in DICOM: a series of slices, an enhanced CT, or a Segmentation object."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates
from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError
from endoct.base.files.files import check_array_size
from endoct.modalities.ct.dicom_files import dicom_files
from endoct.modalities.ct.dicom_slices import (
    Slice,
    axes_of,
    named,
    numbers_of,
    padding_of,
    position_of,
    slices_of,
    spacing_of,
)
from endoct.modalities.ct.hounsfield import LEAST_HU, MOST_HU
from endoct.modalities.ct.slice_grid import SliceGrid, slice_grid
from endoct.modalities.ct.stored import PLACE_MM, CtVolume, Segment, layers_as_one
from endoct.modalities.dicom.dicom_file import DicomFile, reading_dicom
from endoct.modalities.dicom.image import DicomImage, image_of

if TYPE_CHECKING:
    from pydicom import Dataset

LABEL_MAP = "LABELMAP"
AIR_HU = -1000
MOST_SLICES = 20_000


def read_segmentation(file: DicomFile) -> CtVolume:
    """Return the segments of a Segmentation object; slices without a frame are empty.

    Raises :class:`EndoctError` for a fractional one, for segments without a name or number, and where frames do not lie
    on one even grid.
    """
    with reading_dicom(file.path):
        coding = file.text("SegmentationType")
        if coding not in ("BINARY", LABEL_MAP):
            raise EndoctError(
                f"{file.path} holds shares of segments, not segments",
                found=f"SegmentationType {coding or 'not stated'}",
                expected="BINARY or LABELMAP",
                remedy="export it as a binary segmentation",
            )
        names = _names(file)
        image = image_of(file)
        places, origin, steps = _placed(image)
        shape = int(places.max()) + 1, int(file.header.Rows), int(file.header.Columns)
        check_array_size(shape, 2, str(file.path))
        if coding == LABEL_MAP:
            voxels: NDArray[Any] = np.zeros(shape, numbers_of(image, 0).dtype)
            if np.unique(places).size < places.size:
                raise EndoctError(f"{file.path} is no even volume", found="two frames at one place")
            for frame, k in enumerate(places):
                voxels[k] = numbers_of(image, frame)
            segments = tuple(Segment(label, name, (label,)) for label, name in names.items() if label != 0)
        else:
            parts = ((_segment_of(image, at, names), k, numbers_of(image, at) != 0) for at, k in enumerate(places))
            voxels, segments = layers_as_one(names, parts, shape, str(file.path))
    kind = f"DICOM Segmentation, {image.n_frames} frames"
    return CtVolume(voxels, origin, steps, "lps", kind, (file.path,), segments)


def _names(file: DicomFile) -> dict[int, str]:
    items: Sequence[Dataset] = file.header.get("SegmentSequence") or []
    names = {int(item.SegmentNumber): str(item.get("SegmentLabel") or "").strip() for item in items}
    if not names or len(names) < len(items):
        raise EndoctError(
            f"{file.path} does not say what its segments are", found=f"{len(names)} of {len(items)} numbers"
        )
    return names


def _segment_of(image: DicomImage, frame: int, names: dict[int, str]) -> int:
    number = image.of_frame(frame, "SegmentIdentificationSequence", "ReferencedSegmentNumber")
    if number is None or int(number) not in names:
        raise EndoctError(f"{image.path} has a frame of no segment", found=f"segment {number}")
    return int(number)


def _placed(image: DicomImage) -> tuple[NDArray[np.intp], Coordinates, Coordinates]:
    """Return the index of each frame along k, several at one place perhaps or none, the origin and the steps, mm."""
    name, frames = str(image.path), range(image.n_frames)
    positions = np.array([position_of(image, frame) for frame in frames])
    axes, spacings = [axes_of(image, frame) for frame in frames], [spacing_of(image, frame) for frame in frames]
    if np.ptp(np.array(axes), axis=0).max() > 1e-6 or np.ptp(np.array(spacings), axis=0).max() > 1e-6:
        raise EndoctError(f"{name} is no even volume", found="frames of several orientations or spacings")
    row, column = axes[0]
    normal = np.cross(row, column)
    along = positions @ normal
    first = int(np.argmin(along))
    places = np.unique(np.round(along - along[first], 6))
    apart = np.diff(places)
    stated = image.of_frame(0, "PixelMeasuresSequence", "SpacingBetweenSlices")
    if stated is not None and 0 < float(stated) < 100:
        between = float(stated)
    elif places.size > 1:
        between = float(apart[apart > PLACE_MM].min(initial=np.inf))
    else:
        between = np.inf
    if not np.isfinite(between):
        raise EndoctError(f"{name} is no volume", found="frames at one place", expected="frames at several places")
    index = np.rint((along - along[first]) / between).astype(np.intp)
    if index.max() >= MOST_SLICES:
        raise EndoctError(f"{name} is no volume", found=f"{int(index.max())} slices", expected=f"{MOST_SLICES} at most")
    off = np.linalg.norm(positions - (positions[first] + (index * between)[:, None] * normal), axis=1)
    if off.max() > PLACE_MM:
        worst = int(np.argmax(off))
        raise EndoctError(
            f"{name} is no even volume",
            found=f"{named(image, worst)} {off[worst]:.3g} mm off the even grid of the others",
            expected=f"every frame on one grid, to {PLACE_MM:g} mm",
        )
    steps = np.array([between * normal, spacings[0][0] * column, spacings[0][1] * row])
    return index, positions[first], steps


def read_dicom(path: Path) -> CtVolume:
    """Return the volume in a folder with one series, or in a file.

    Every slice lies where its header says, to 0.01 mm. Raises :class:`EndoctError` where the slices are no even
    volume, and for what cannot be read.
    """
    with reading_dicom(path):
        files, notes = dicom_files(path)
        if any(file.text("Modality") == "SEG" or "SegmentSequence" in file.header for file in files):
            if len(files) > 1:
                raise EndoctError(f"{path} is no volume", found=f"{len(files)} files of segmentations", expected="one")
            return read_segmentation(files[0])
        slices = [slice_ for file in files for slice_ in slices_of(file)]
        name = path.name or str(path)
        grid = slice_grid(slices, str(path))
        voxels, padded = _values(grid, path)
        on_padding, doubts = _of_padding(padded, name)
        if any(file.text("PhotometricInterpretation") == "MONOCHROME1" for file in files):
            notes = (*notes, "It is meant to be displayed inverted (MONOCHROME1); its values are as stored.")
        notes = (*notes, *grid.notes, *on_padding)
        against = (*_doubts(slices, name), *grid.doubts, *doubts)
        kind, paths = f"DICOM, {len(slices)} slices", tuple(file.path for file in files)
        return CtVolume(
            voxels, grid.origin_mm, grid.steps_mm, "lps", kind, paths, None, notes, against, tilted=grid.tilted
        )


def _values(grid: SliceGrid, path: Path) -> tuple[NDArray[Any], Counter[float]]:
    """Return the values of all slices, and how many voxels were padded, by their padding in HU; in a CT these are air.

    Values are whole numbers where slopes and intercepts are.
    """
    shape = len(grid.slices), *grid.slices[0].shape
    whole = all(slice_.slope == 1 and slice_.intercept == round(slice_.intercept) for slice_ in grid.slices)
    dtype = np.dtype(np.int16 if whole else np.float32)
    check_array_size(shape, dtype.itemsize, str(path))
    voxels: NDArray[Any] = np.empty(shape, dtype)
    padded: Counter[float] = Counter()
    for k, slice_ in enumerate(grid.slices):
        numbers = numbers_of(slice_.file, slice_.frame)
        if whole:
            values = np.add(numbers, int(slice_.intercept), dtype=np.int64 if numbers.itemsize > 2 else np.int32)
        else:
            values = numbers * slice_.slope + slice_.intercept
        if (padding := padding_of(slice_.file)) is not None and slice_.file.text("Modality") == "CT":
            outside = (numbers >= padding[0]) & (numbers <= padding[1])
            values[outside] = AIR_HU
            padded[padding[0] * slice_.slope + slice_.intercept] += int(outside.sum())
        if whole:
            ends = np.min_scalar_type(int(values.min())), np.min_scalar_type(int(values.max()))
            voxels = voxels.astype(np.result_type(voxels, *ends), copy=False)
        voxels[k] = values
    return voxels, padded


def _of_padding(padded: Counter[float], name: str) -> tuple[tuple[str, ...], list[Doubt]]:
    """Return what is to be said of voxels that were padded."""
    count = sum(padded.values())
    if not count:
        return (), []
    value, _ = padded.most_common(1)[0]
    note = f"{count} voxels of {name} hold its padding value ({value:g} HU): nothing was seen there, taken for air."
    if LEAST_HU < value < MOST_HU:
        said = f"The padding value of {name} is one that tissue has, {value:g} HU: {count} voxels were taken for air."
        return (), [Doubt("ct-padding-like-tissue", said, value=value, unit="HU", expected=None)]
    return (note,), []


def _doubts(slices: Sequence[Slice], name: str) -> list[Doubt]:
    doubts = list(dict.fromkeys(doubt for slice_ in slices for doubt in slice_.file.doubts))
    file = slices[0].file
    header, coded = file.header, None if file.read is None else file.read.coded
    modality, unit = file.text("Modality"), file.text("RescaleType")
    if modality != "CT":
        doubts.append(
            Doubt("ct-other-modality", f"{name} says that it is no CT: its modality is {modality or 'not stated'}.")
        )
    if unit not in ("", "HU", "US"):
        doubts.append(Doubt("ct-other-unit", f"{name} says that its values are {unit[:16]}, not Hounsfield units."))
    if "RescaleSlope" not in header and "SharedFunctionalGroupsSequence" not in header:
        doubts.append(Doubt("ct-no-rescale", f"{name} does not say how its numbers become Hounsfield units."))
    if file.text("LossyImageCompression") == "01" or (coded is not None and coded.lossy):
        doubts.append(Doubt("ct-lossy", f"{name} was compressed with losses: thin walls may be gone."))
    usual, _ = Counter((slice_.slope, slice_.intercept) for slice_ in slices).most_common(1)[0]
    if other := [slice_.name for slice_ in slices if (slice_.slope, slice_.intercept) != usual]:
        said = f"{len(other)} slices of {name} are scaled in another way than the others, as {other[0]}: as each says."
        doubts.append(Doubt("ct-rescale-varies", said, value=float(len(other)), unit="slices", expected=0.0))
    return doubts
