"""Writes a volume as DICOM, NIfTI, NRRD and MetaImage, with headers by hand where a fault has to go in."""

import gzip
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import nibabel
import numpy as np
from numpy.typing import NDArray
from pydicom.config import disable_value_validation
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.sequence import Sequence as Items
from pydicom.uid import ExplicitVRLittleEndian

from benchmarks.ct_faults.drawn import Drawn

CT, ENHANCED, SECONDARY = "1.2.840.10008.5.1.4.1.1.2", "1.2.840.10008.5.1.4.1.1.2.1", "1.2.840.10008.5.1.4.1.1.7.3"
ROOT = "1.2.826.0.1.3680043.8.498"
LPS_TO_RAS = np.diag([-1.0, -1.0, 1.0, 1.0])


def write_slice(path: Path, number: int, elements: Mapping[str, Any], syntax: str = ExplicitVRLittleEndian) -> None:
    """Write a slice of a CT; ``elements`` by keyword replace the usual ones, None leaves one out."""
    values = np.asarray(elements["values"])
    of = Dataset()
    usual: dict[str, Any] = {
        "SOPClassUID": CT,
        "SOPInstanceUID": f"{ROOT}.9.{number}",
        "Modality": "CT",
        "PatientID": "0",
        "StudyInstanceUID": f"{ROOT}.2",
        "SeriesInstanceUID": f"{ROOT}.1",
        "FrameOfReferenceUID": f"{ROOT}.3",
        "SamplesPerPixel": 1,
        "PhotometricInterpretation": "MONOCHROME2",
        "Rows": values.shape[0],
        "Columns": values.shape[1],
        "BitsAllocated": 16,
        "BitsStored": 16,
        "HighBit": 15,
        "PixelRepresentation": 1,
        "PixelData": values.astype("<i2").tobytes(),
    }
    with disable_value_validation():
        for keyword, value in (usual | {key: value for key, value in elements.items() if key[0].isupper()}).items():
            if value is not None:
                setattr(of, keyword, value)
    save(of, path, syntax)


def save(of: Dataset, path: Path, syntax: str = ExplicitVRLittleEndian) -> None:
    """Write a data set of DICOM with its preamble."""
    of.file_meta = FileMetaDataset()
    of.file_meta.TransferSyntaxUID = syntax
    of.file_meta.MediaStorageSOPClassUID = of.SOPClassUID
    of.file_meta.MediaStorageSOPInstanceUID = of.SOPInstanceUID
    if "PixelData" in of:
        of["PixelData"].VR = "OW"
    with disable_value_validation():
        of.save_as(path, enforce_file_format=True)


def write_series(folder: Path, slices: Sequence[Mapping[str, Any]]) -> Path:
    """Write slices, each under its ``name``, into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, one in enumerate(slices, 1):
        write_slice(folder / one["name"], number, one)
    return folder


def items(**elements: Any) -> Items:
    """Return a sequence of one item."""
    of = Dataset()
    for keyword, value in elements.items():
        setattr(of, keyword, value)
    return Items([of])


def enhanced(slices: Sequence[Mapping[str, Any]]) -> Dataset:
    """Return an enhanced CT of slices, all in one file: positions and what else varies by frame."""
    of = Dataset()
    values = np.stack([one["values"] for one in slices])
    of.SOPClassUID, of.SOPInstanceUID, of.Modality, of.PatientID = ENHANCED, f"{ROOT}.9.1", "CT", "0"
    of.SeriesInstanceUID, of.StudyInstanceUID, of.FrameOfReferenceUID = f"{ROOT}.1", f"{ROOT}.2", f"{ROOT}.3"
    of.InstanceNumber, of.NumberOfFrames = 1, len(slices)
    of.Rows, of.Columns = values.shape[1:]
    of.SamplesPerPixel, of.PhotometricInterpretation = 1, "MONOCHROME2"
    of.BitsAllocated, of.BitsStored, of.HighBit, of.PixelRepresentation = 16, 16, 15, 1
    shared = Dataset()
    shared.PlaneOrientationSequence = items(ImageOrientationPatient=slices[0]["ImageOrientationPatient"])
    shared.PixelMeasuresSequence = items(PixelSpacing=slices[0]["PixelSpacing"], SliceThickness=0.5)
    shared.PixelValueTransformationSequence = items(RescaleSlope=1, RescaleIntercept=-1024, RescaleType="HU")
    of.SharedFunctionalGroupsSequence = Items([shared])
    frames = []
    for one in slices:
        frame = Dataset()
        frame.PlanePositionSequence = items(ImagePositionPatient=one["ImagePositionPatient"])
        frames.append(frame)
    of.PerFrameFunctionalGroupsSequence = Items(frames)
    of.PixelData = (values + 1024).astype("<i2").tobytes()
    return of


def segmentation(
    volume: Drawn, masks: Mapping[str, NDArray[np.bool_]], *, kind: str = "BINARY", frames_apart: bool = True
) -> Dataset:
    """Return a Segmentation of ``masks`` (k, j, i) by name; slices without a voxel of a segment have no frame."""
    of = Dataset()
    of.SOPClassUID, of.SOPInstanceUID, of.Modality = "1.2.840.10008.5.1.4.1.1.66.4", f"{ROOT}.9.5", "SEG"
    of.SeriesInstanceUID, of.StudyInstanceUID, of.FrameOfReferenceUID = f"{ROOT}.4", f"{ROOT}.2", f"{ROOT}.3"
    of.SegmentationType, of.SamplesPerPixel, of.PhotometricInterpretation = kind, 1, "MONOCHROME2"
    of.Rows, of.Columns = volume.voxels.shape[1:]
    bits = 1 if kind == "BINARY" else 8
    of.BitsAllocated, of.BitsStored, of.HighBit, of.PixelRepresentation = bits, bits, bits - 1, 0
    segments, frames, planes = [], [], []
    for number, (name, mask) in enumerate(masks.items(), 1):
        segment = Dataset()
        segment.SegmentNumber, segment.SegmentLabel = number, name
        segments.append(segment)
        for k in range(len(mask)) if kind == "BINARY" else []:
            if mask[k].any() or not frames_apart:
                frames.append(_segment_frame(volume, k, number))
                planes.append(mask[k])
    if kind != "BINARY":
        labels = np.zeros(volume.voxels.shape, np.uint8)
        for number, mask in enumerate(masks.values(), 1):
            labels[mask] = number
        frames, planes = [_segment_frame(volume, k, None) for k in range(len(labels))], list(labels)
    shared = Dataset()
    shared.PlaneOrientationSequence = items(ImageOrientationPatient=[*volume.row, *volume.column])
    shared.PixelMeasuresSequence = items(PixelSpacing=list(volume.spacing), SpacingBetweenSlices=volume.between)
    of.SegmentSequence, of.SharedFunctionalGroupsSequence = Items(segments), Items([shared])
    of.PerFrameFunctionalGroupsSequence, of.NumberOfFrames = Items(frames), len(frames)
    stacked = np.stack(planes)
    data = np.packbits(stacked.ravel(), bitorder="little") if kind == "BINARY" else stacked.astype(np.uint8)
    of.PixelData = data.tobytes() + b"\0" * (data.size % 2)
    return of


def _segment_frame(volume: Drawn, k: int, segment: int | None) -> Dataset:
    frame = Dataset()
    frame.PlanePositionSequence = items(ImagePositionPatient=[float(f"{x:.8g}") for x in volume.position(k)])
    if segment is not None:
        frame.SegmentIdentificationSequence = items(ReferencedSegmentNumber=segment)
    return frame


def nifti(volume: Drawn, voxels: NDArray[Any] | None = None) -> Any:
    """Return a NIfTI image of nibabel, in mm, with sform and qform."""
    to_ras = LPS_TO_RAS @ volume.to_lps
    image = nibabel.Nifti1Image((volume.voxels if voxels is None else voxels).transpose(), to_ras)
    image.set_sform(to_ras, 1)
    image.set_qform(to_ras, 1)
    image.header.set_xyzt_units("mm")
    return image


def nrrd_header(volume: Drawn) -> dict[str, str]:
    """Return the fields of an NRRD header."""
    steps = volume.to_lps[:3, :3].T
    return {
        "type": "short",
        "dimension": "3",
        "space": "left-posterior-superior",
        "sizes": " ".join(map(str, volume.voxels.shape[::-1])),
        "space directions": " ".join(_vector(step) for step in steps),
        "kinds": "domain domain domain",
        "endian": "little",
        "encoding": "gzip",
        "space origin": _vector(volume.origin),
    }


def write_nrrd(path: Path, header: Mapping[str, str], data: bytes) -> Path:
    """Write an NRRD, its voxels packed as the header says."""
    text = "".join(f"{field}: {value}\n" for field, value in header.items())
    packed = gzip.compress(data, mtime=0) if header.get("encoding") == "gzip" else data
    path.write_bytes(f"NRRD0004\n{text}\n".encode() + packed)
    return path


def metaimage_header(volume: Drawn) -> dict[str, str]:
    """Return the lines of a MetaImage header, its voxels in the same file."""
    return {
        "ObjectType": "Image",
        "NDims": "3",
        "BinaryData": "True",
        "BinaryDataByteOrderMSB": "False",
        "CompressedData": "False",
        "TransformMatrix": " ".join(f"{x:.15g}" for x in (*volume.row, *volume.column, *volume.normal)),
        "Offset": " ".join(f"{x:.15g}" for x in volume.origin),
        "ElementSpacing": f"{volume.spacing[1]:.15g} {volume.spacing[0]:.15g} {volume.between:.15g}",
        "DimSize": " ".join(map(str, volume.voxels.shape[::-1])),
        "ElementType": "MET_SHORT",
        "ElementDataFile": "LOCAL",
    }


def write_metaimage(path: Path, header: Mapping[str, str], data: bytes) -> Path:
    """Write a MetaImage whose voxels follow its header."""
    text = "".join(f"{key} = {value}\n" for key, value in header.items())
    path.write_bytes(text.encode() + data)
    return path


def _vector(values: NDArray[np.float64]) -> str:
    return "(" + ",".join(f"{value:.15g}" for value in values) + ")"
