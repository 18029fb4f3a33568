"""DICOM of catheters and endoscopes as consoles write it, by pydicom alone: no line of endoct is used here.

After PS3.3 A.66 (IVOCT), A.32.5 (video endoscopic) and A.8 (secondary capture). Only the elements that a reader may
look at are there, and some that it should not mind.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.sequence import Sequence as Items
from pydicom.uid import ExplicitVRLittleEndian

ROOT = "1.2.826.0.1.3680043.10.999"
STORAGE = "1.2.840.10008.5.1.4.1.1"
IVOCT_PROCESSING, IVOCT_PRESENTATION = f"{STORAGE}.14.2", f"{STORAGE}.14.1"
ENDOSCOPE, VIDEO_ENDOSCOPE, CAPTURES = f"{STORAGE}.77.1.1", f"{STORAGE}.77.1.1.1", f"{STORAGE}.7.4"


def item(**elements: Any) -> Dataset:
    """Return a dataset of ``elements``; those that are None are left out."""
    made = Dataset()
    for keyword, value in elements.items():
        if value is not None:
            setattr(made, keyword, value)
    return made


def pixels(frames: NDArray[Any], photometric: str = "MONOCHROME2") -> Dataset:
    """Return the image module of ``frames``, (frame, row, column) or (frame, row, column, 3), uncompressed."""
    bits = 8 * frames.dtype.itemsize
    made = item(
        NumberOfFrames=len(frames),
        Rows=frames.shape[1],
        Columns=frames.shape[2],
        SamplesPerPixel=1 if frames.ndim == 3 else frames.shape[3],
        PhotometricInterpretation=photometric,
        BitsAllocated=bits,
        BitsStored=bits,
        HighBit=bits - 1,
        PixelRepresentation=0,
        PlanarConfiguration=0 if frames.ndim == 4 else None,
    )
    data = np.ascontiguousarray(frames, frames.dtype.newbyteorder("<")).tobytes()
    made.PixelData = data + bytes(len(data) % 2)
    made["PixelData"].VR = "OB" if bits == 8 else "OW"
    return made


def ivoct(
    bscans: NDArray[Any],
    *,
    per_frame: Sequence[Mapping[str, Any]] = (),
    sop_class: str = IVOCT_PROCESSING,
    to_linear: NDArray[np.uint16] | None = None,
    **header: Any,
) -> Dataset:
    """Return an IVOCT image of ``bscans``, (frame, A-scan, depth); ``header`` replaces or, with None, removes elements.

    ``per_frame``: of each frame ``distance``, ``place``, ``offset``, ``seam`` and ``padded``.
    """
    made = pixels(bscans)
    elements: dict[str, Any] = {
        "SOPClassUID": sop_class,
        "SOPInstanceUID": f"{ROOT}.1.1",
        "Modality": "IVOCT",
        "SeriesInstanceUID": f"{ROOT}.2",
        "PresentationIntentType": "FOR PROCESSING",
        "InstanceNumber": 1,
        "EffectiveRefractiveIndex": 1.0,
        "OCTAcquisitionDomain": "FREQUENCY",
        "ALinesPerFrame": bscans.shape[1],
        "OCTZOffsetApplied": "YES",
        "RefractiveIndexApplied": "YES",
        "ALinePixelSpacing": 0.005,
        "PixelIntensityRelationship": "LOG",
        "FirstALineLocation": 0.0,
        "IVUSAcquisition": "MEASURED",
        "CatheterDirectionOfRotation": "CW",
    }
    for keyword, value in (elements | header).items():
        if value is not None:
            setattr(made, keyword, value)
    shared = item(PixelMeasuresSequence=Items([item(PixelSpacing=[0.01, 0.01])]))
    if to_linear is not None:
        table = item(LUTDescriptor=[len(to_linear) % 65_536, 0, 16], LUTFunction="TO_LINEAR")
        table.LUTData = to_linear.astype("<u2").tobytes()
        table["LUTData"].VR = "OW"
        shared.PixelIntensityRelationshipLUTSequence = Items([table])
    made.SharedFunctionalGroupsSequence = Items([shared])
    groups = []
    for said in per_frame or [{}] * len(bscans):
        content = item(IntravascularLongitudinalDistance=said.get("distance"), SeamLineLocation=said.get("place"))
        of_oct = item(
            OCTZOffsetCorrection=said.get("offset", 0),
            SeamLineIndex=said.get("seam", 0),
            NumberOfPaddedALines=said.get("padded"),
        )
        groups.append(
            item(
                IntravascularFrameContentSequence=Items([content]),
                IntravascularOCTFrameContentSequence=Items([of_oct]),
            )
        )
    made.PerFrameFunctionalGroupsSequence = Items(groups)
    return made


def write(made: Dataset, path: Path, syntax: str = ExplicitVRLittleEndian) -> Path:
    """Write a file with a preamble and a meta header."""
    meta = FileMetaDataset()
    meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID = made.SOPClassUID, made.SOPInstanceUID
    meta.TransferSyntaxUID, meta.ImplementationClassUID = syntax, f"{ROOT}.9"
    made.file_meta = meta
    made.save_as(path, enforce_file_format=True)
    return path
