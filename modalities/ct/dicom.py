"""A CT, or a segmentation of one, in DICOM: a series of slices, an enhanced CT, or a Segmentation object."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError
from endoct.base.files.files import check_array_size
from endoct.modalities.ct.dicom_files import DicomFile, dicom_files
from endoct.modalities.ct.dicom_segmentation import is_segmentation, read_segmentation
from endoct.modalities.ct.dicom_slices import Slice, slices_of
from endoct.modalities.ct.dicom_voxels import stored_numbers
from endoct.modalities.ct.slice_grid import SliceGrid, slice_grid
from endoct.modalities.ct.stored import StoredVolume
from endoct.modalities.dicom.dicom_file import reading_dicom


def read_dicom(path: Path) -> StoredVolume:
    """Return the volume in a folder with one series, or in a file.

    Every slice lies where its header says, to 0.01 mm. Raises :class:`EndoctError` where the slices are no even
    volume, and for what cannot be read.
    """
    with reading_dicom(path):
        return _read(path)


def _read(path: Path) -> StoredVolume:
    files, notes = dicom_files(path)
    if any(is_segmentation(file) for file in files):
        if len(files) > 1:
            raise EndoctError(f"{path} is no volume", found=f"{len(files)} files of segmentations", expected="one")
        return read_segmentation(files[0])
    slices = [slice_ for file in files for slice_ in slices_of(file)]
    name = path.name or str(path)
    grid = slice_grid(slices, str(path))
    if any(file.text("PhotometricInterpretation") == "MONOCHROME1" for file in files):
        notes = (*notes, "It is meant to be displayed inverted (MONOCHROME1); its values are as stored.")
    return StoredVolume(
        voxels=_values(grid, path),
        origin_mm=grid.origin_mm,
        steps_mm=grid.steps_mm,
        coordinates="lps",
        placed=True,
        kind=f"DICOM, {len(slices)} slices",
        files=tuple(file.path for file in files),
        tilted=grid.tilted,
        notes=(*notes, *grid.notes),
        doubts=(*_doubts(files, name), *_of_rescale(slices, name), *grid.doubts),
    )


def _values(grid: SliceGrid, path: Path) -> NDArray[Any]:
    """Return the values of all slices, whole numbers where slopes and intercepts are."""
    n_j, n_i = grid.slices[0].shape
    shape = len(grid.slices), n_j, n_i
    whole = all(slice_.slope == 1 and slice_.intercept == round(slice_.intercept) for slice_ in grid.slices)
    dtype = np.dtype(np.int16 if whole else np.float32)
    check_array_size(shape, dtype.itemsize, str(path))
    voxels: NDArray[Any] = np.empty(shape, dtype)
    small = np.iinfo(np.int16)
    of_file: dict[Path, list[tuple[int, Slice]]] = {}
    for k, slice_ in enumerate(grid.slices):
        of_file.setdefault(slice_.file.path, []).append((k, slice_))
    for some in of_file.values():
        frames = stored_numbers(some[0][1].file)
        for k, slice_ in some:
            if not whole:
                voxels[k] = frames[slice_.frame] * slice_.slope + slice_.intercept
                continue
            values = frames[slice_.frame].astype(np.int64) + int(slice_.intercept)
            if voxels.dtype == np.int16 and not small.min <= int(values.min()) <= int(values.max()) <= small.max:
                voxels = voxels.astype(np.int32)
            voxels[k] = values
    return voxels


def _of_rescale(slices: Sequence[Slice], name: str) -> list[Doubt]:
    usual, _ = Counter((slice_.slope, slice_.intercept) for slice_ in slices).most_common(1)[0]
    other = [slice_ for slice_ in slices if (slice_.slope, slice_.intercept) != usual]
    if not other:
        return []
    said = f"{len(other)} slices of {name} are scaled in another way than the others, as {other[0].name}: as each says."
    return [Doubt("ct-rescale-varies", said, value=float(len(other)), unit="slices", expected=0.0)]


def _doubts(files: Sequence[DicomFile], name: str) -> list[Doubt]:
    doubts = []
    header = files[0].header
    modality, unit = files[0].text("Modality"), files[0].text("RescaleType")
    if modality != "CT":
        doubts.append(
            Doubt("ct-other-modality", f"{name} says that it is no CT: its modality is {modality or 'not stated'}.")
        )
    if unit not in ("", "HU", "US"):
        doubts.append(Doubt("ct-other-unit", f"{name} says that its values are {unit[:16]}, not Hounsfield units."))
    if "RescaleSlope" not in header and "SharedFunctionalGroupsSequence" not in header:
        doubts.append(Doubt("ct-no-rescale", f"{name} does not say how its numbers become Hounsfield units."))
    if files[0].text("LossyImageCompression") == "01":
        doubts.append(Doubt("ct-lossy", f"{name} was compressed with losses: thin walls may be gone."))
    return doubts
