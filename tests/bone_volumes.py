"""A volume that can be worked out by hand: a block of bone with one round air cell, in any file and orientation."""

import locale
from pathlib import Path

import numpy as np
import SimpleITK as sitk

from benchmarks.ct_faults.writing import write_series
from endoct.base.arrays import Coordinates
from endoct.synthetic.bone.patient import stated_volume
from endoct.synthetic.draw import draw
from endoct.synthetic.sample.parameters import Sample, Volume

VOXEL_MM = 0.2
SIZE = 90
ORIGIN = np.array([-31.0, 12.0, 40.0])
"""Of the volume, LPS; its axes are those of LPS unless turned."""
ENTRY = np.array([-28.0, 20.5, 45.0])
INWARD = np.array([0.8, 0.36, 0.48]) / np.linalg.norm([0.8, 0.36, 0.48])
LENGTH_MM = 9.0
TARGET = ENTRY + LENGTH_MM * INWARD
CELL = ENTRY + 4.6 * INWARD + 1.3 * np.cross(INWARD, [0, 0, 1.0]) / np.linalg.norm(np.cross(INWARD, [0, 0, 1.0]))
"""Middle of the cell, beside the wall of a bore with a radius of about 1.25 mm."""
CELL_RADIUS_MM = 0.9
RAS = np.array([-1.0, -1.0, 1.0])


def block(path: Path, *, turned: bool = False, labels: bool = False, air: bool = False) -> Path:
    """Write the block; ``turned``: its first two axes run to the right and the front, with the voxels to match."""
    k, j, i = np.indices((SIZE,) * 3)
    places = ORIGIN + VOXEL_MM * np.stack([i, j, k], axis=-1)
    inside = CELL_RADIUS_MM - np.linalg.norm(places - CELL, axis=-1)
    share = np.clip(inside / VOXEL_MM + 0.5, 0, 1)
    voxels = (share < 0.5).astype(np.uint8) if labels else np.rint(1500 - 2500 * share).astype(np.int16)
    if air:
        voxels[:] = 0 if labels else -1000
    direction, origin = np.eye(3), ORIGIN
    if turned:
        voxels, direction = voxels[:, ::-1, ::-1], np.diag([-1.0, -1.0, 1.0])
        origin = ORIGIN + VOXEL_MM * (SIZE - 1) * np.array([1.0, 1.0, 0.0])
    image = sitk.GetImageFromArray(np.ascontiguousarray(voxels))
    image.SetSpacing((VOXEL_MM,) * 3)
    image.SetOrigin(origin.tolist())
    image.SetDirection(direction.ravel().tolist())
    sitk.WriteImage(image, str(path))
    return path


def tilted(folder: Path, degrees: float) -> Path:
    """Write the block as a series taken with a tilted gantry: each slice farther back than the one before."""
    step = VOXEL_MM * np.array([0.0, np.tan(np.radians(degrees)), 1.0])
    corner = ORIGIN - np.array([0.0, SIZE / 2 * step[1], 0.0])
    j, i = np.indices((2 * SIZE, SIZE))
    slices = []
    for k in range(SIZE):
        places = corner + k * step + VOXEL_MM * np.stack([i, j, np.zeros_like(i)], axis=-1)
        share = np.clip((CELL_RADIUS_MM - np.linalg.norm(places - CELL, axis=-1)) / VOXEL_MM + 0.5, 0, 1)
        slices.append(
            {
                "name": f"{k}.dcm", "values": np.rint(1500 - 2500 * share).astype(np.int16), "InstanceNumber": k + 1,
                "ImagePositionPatient": (corner + k * step).tolist(), "ImageOrientationPatient": [1, 0, 0, 0, 1, 0],
                "PixelSpacing": [VOXEL_MM] * 2, "RescaleSlope": 1, "RescaleIntercept": 0, "GantryDetectorTilt": degrees,
            }
        )  # fmt: skip
    return write_series(folder, slices)


def dicom(folder: Path) -> Path:
    """Write the block as a DICOM series, a file a slice, in no order."""
    image = sitk.ReadImage(str(block(folder.with_suffix(".nrrd"))))
    folder.mkdir()
    writer = sitk.ImageFileWriter()
    writer.KeepOriginalImageUIDOn()
    before = locale.setlocale(locale.LC_ALL)
    for k in range(SIZE):
        slice_ = image[:, :, k]
        place = image.TransformIndexToPhysicalPoint((0, 0, k))
        tags = {
            "0008|0060": "CT",
            "0020|000e": "1.2.826.0.1.3680043.2.1125.1",
            "0020|000d": "1.2.826.0.1.3680043.2.1125.2",
            "0008|0018": f"1.2.826.0.1.3680043.2.1125.3.{k + 1}",
            "0020|0032": "\\".join(f"{value:.6f}" for value in place),
            "0020|0037": "1\\0\\0\\0\\1\\0",
            "0020|0013": str(k + 1),
        }
        for tag, text in tags.items():
            slice_.SetMetaData(tag, text)
        writer.SetFileName(str(folder / f"{(37 * k) % SIZE:03d}.dcm"))
        writer.Execute(slice_)
    locale.setlocale(locale.LC_ALL, before)  # writing DICOM leaves the process with "C"
    return folder


def point(place: Coordinates) -> tuple[float, float, float]:
    """Return a place as three numbers."""
    x, y, z = (float(value) for value in place)
    return x, y, z


def stated(path: Path, **options: object) -> Volume:
    """Return the volume drilled from the entry to the target, in LPS."""
    usual: dict[str, object] = {"coordinates": "lps"}
    return stated_volume(path, (point(ENTRY), point(TARGET)), **(usual | options))  # type: ignore[arg-type]


def drilled(volume: Volume, **bore: object) -> Sample:
    """Return a ``learning`` sample with an even bore through ``volume``."""
    sample = draw("learning", 3, volume=volume)
    even: dict[str, object] = {
        "taper_mm": 0.0,
        "wander_mm": 0.0,
        "roughness_mm": 0.0,
        "drill_mark_depth_mm": 0.0,
        "diameter_mm": 2.5,
        "dust": 0.0,
        "fluid": 0.0,
    }
    return sample.model_copy(update={"bore": sample.bore.model_copy(update=even | bore)})
