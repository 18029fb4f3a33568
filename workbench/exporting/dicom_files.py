"""DICOM: of each side an image, its relief as a parametric map and its cells as a segmentation, in one folder.

The wall is laid flat into a frame of reference of its own: x the arc on the nominal wall from θ = 0, y along z, in mm.
Sides that are aligned share the frame. Nothing is known of a patient, so what the standard has said of one is empty.
A segmentation is binary: readers know that kind, few know label maps.
"""

from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from pydicom.sr.codedict import codes
from pydicom.uid import generate_uid
from pydicom.valuerep import DS

from endoct.base.arrays import Image
from endoct.base.errors import EndoctError
from endoct.base.files.files import inside
from endoct.stitching.grid import SurfaceGrid
from endoct.workbench.exporting.image_layers import ImageLayer, LabelLayer, contrast_of
from endoct.workbench.exporting.source import Exportable
from endoct.workbench.requests import ExportRequest
from endoct.workbench.running.progress import Stages

MOST_PX = 65_535
"""An image has this many rows and columns at most, and as many values of 16 bits besides the one for unobserved."""
_TEXT = 64
_SCHEME = "99ENDOCT"


def write_dicom(source: Exportable, path: Path, request: ExportRequest, stages: Stages) -> dict[str, object]:
    """Write the sides of ``source`` to the folder ``path``. Returns what was written.

    Images have 16 bits, and 0 where nothing was observed; maps are float32 in mm, and NaN there. Raises
    :class:`EndoctError` without highdicom, where there is no image, or where one is too large.
    """
    del request
    hd, grid = _highdicom(), source.grid
    pictures = [layer for layer in source.layers if layer.quantity == "intensity"]
    cells = {label.side: label for label in source.labels if label.name.endswith(" cells")}
    if not pictures:
        raise EndoctError(f"{source.path} has no image", found=f"a {source.kind}", expected="a comparison or panorama")
    if max(grid.shape) > MOST_PX:
        found, most = " × ".join(map(str, grid.shape)), f"{MOST_PX} samples in either direction"
        raise EndoctError("the wall is too large for DICOM", found=found, expected=most, remedy="export OME-Zarr")
    path.mkdir()
    study, frame, files = generate_uid(None), generate_uid(None), []
    with stages.stage("DICOM") as advance:
        for k, picture in enumerate(pictures):
            side, series = picture.side, 3 * k
            if k and source.alignment is None:
                frame = generate_uid(None)
            image = _image(hd, picture, grid, study, frame, series + 1)
            made = {"image": image}
            if relief := source.layer(side, "relief"):
                made["relief"] = _relief(hd, relief, image, series + 2)
            if side in cells:
                made["cells"] = _cells(hd, cells[side], image, series + 3)
            for name, dataset in made.items():
                dataset.StudyDescription = source.title.replace("\\", "_")[:_TEXT]
                dataset.ContentQualification = "RESEARCH"
                file = inside(path, f"{side}-{name}.dcm", str(source.path))
                dataset.save_as(file, enforce_file_format=True)
                files.append(file.name)
            advance((k + 1) / len(pictures))
    return {"files": files, "shape": list(grid.shape), "step_mm": [grid.dz_mm, grid.dtheta_mm]}


def _highdicom() -> Any:
    try:
        import highdicom
    except ModuleNotFoundError as error:
        found, remedy = f"no {error.name}", "pip install 'endoct[dicom]'"
        raise EndoctError("DICOM needs a library that is not installed", found=found, remedy=remedy) from error
    return highdicom


def _image(hd: Any, layer: ImageLayer, grid: SurfaceGrid, study: str, frame: str, series: int) -> Any:
    """Return a secondary capture of a layer: that is what the standard has for images of unknown instruments."""
    values = layer.read(0, layer.rows.size)
    known, (low, high) = np.isfinite(values), _range(values)
    step = (high - low) / (MOST_PX - 1) or 1.0
    stored = np.zeros(grid.shape, np.uint16)
    stored[known] = np.rint((values[known] - low) / step) + 1
    image = hd.sc.SCImage(
        stored,
        photometric_interpretation="MONOCHROME2",
        bits_allocated=16,
        coordinate_system="PATIENT",
        patient_orientation=("L", "P"),
        pixel_spacing=(grid.dz_mm, grid.dtheta_mm),
        study_instance_uid=study,
        specific_character_set="ISO_IR 192",
        **_series(layer.name, series),
    )
    image.FrameOfReferenceUID, image.PositionReferenceIndicator = frame, None
    image.ImagePositionPatient = [_decimal(grid.theta0_rad * grid.radius_mm), _decimal(grid.z0_mm), _decimal(0)]
    image.ImageOrientationPatient = [1, 0, 0, 0, 1, 0]
    image.SliceThickness = _decimal(grid.dz_mm)  # a sheet has none, but readers take no image without
    image.PixelSpacingCalibrationType = "GEOMETRY"
    image.PixelSpacingCalibrationDescription = f"arc on a wall of radius {grid.radius_mm:.6g} mm, and z"
    image.PixelPaddingValue = 0
    image.RescaleIntercept, image.RescaleSlope, image.RescaleType = _decimal(low - step), _decimal(step), "US"
    darkest, brightest = contrast_of(layer)
    image.WindowCenter, image.WindowWidth = _decimal((darkest + brightest) / 2), _decimal(brightest - darkest)
    return image


def _relief(hd: Any, layer: ImageLayer, image: Any, series: int) -> Any:
    """Return a parametric map of a relief, in the place of ``image``."""
    values = layer.read(0, layer.rows.size)
    low, high = contrast_of(layer)
    mapping = hd.pm.RealWorldValueMapping(
        lut_label="relief",
        lut_explanation="depth of the wall behind the nominal one",
        unit=codes.UCUM.Millimeter,
        value_range=_range(values),
        slope=1.0,
        intercept=0.0,
        quantity_definition=codes.DCM.Depth,
    )
    return hd.pm.ParametricMap(
        [image],
        values,
        contains_recognizable_visual_features=False,
        real_world_value_mappings=[mapping],
        voi_lut_transformations=[hd.VOILUTTransformation(window_center=(low + high) / 2, window_width=high - low)],
        content_label="RELIEF",
        **_series(layer.name, series),
    )


def _cells(hd: Any, label: LabelLayer, image: Any, series: int) -> Any:
    """Return a segmentation of ``image``, one segment: its cells. Where it observed nothing there are none."""
    family = hd.sr.CodedConcept("evidence", _SCHEME, "Evidence above a threshold, or a mask as given")
    segment = hd.seg.SegmentDescription(
        segment_number=1,
        segment_label=label.name[:_TEXT],
        segmented_property_category=codes.SCT.SpatialAndRelationalConcept,
        segmented_property_type=hd.sr.CodedConcept("cell", _SCHEME, "Cell that opens in the wall of a bore"),
        algorithm_type="SEMIAUTOMATIC",
        algorithm_identification=hd.AlgorithmIdentificationSequence("endoct", family, version("endoct")),
    )
    return hd.seg.Segmentation(
        [image],
        label.read() > 0,
        segmentation_type="BINARY",
        segment_descriptions=[segment],
        omit_empty_frames=False,
        content_label="CELLS",
        **_series(label.name, series),
    )


def _series(name: str, number: int) -> dict[str, Any]:
    """Return what every object says of itself and its series, which holds nothing else."""
    return {
        "series_instance_uid": generate_uid(None),
        "series_number": number,
        "sop_instance_uid": generate_uid(None),
        "instance_number": 1,
        "manufacturer": "endoct",
        "manufacturer_model_name": "endoct",
        "software_versions": version("endoct"),
        "device_serial_number": "none",
        "series_description": name[:_TEXT],
    }


def _range(values: Image) -> tuple[float, float]:
    known = values[np.isfinite(values)]
    return (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)


def _decimal(value: float) -> Any:
    """Return a number as DICOM writes it, in at most 16 characters."""
    return DS(float(value), auto_format=True)
