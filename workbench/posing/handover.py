"""A bore's pose for other programs: ITK transforms, markups and meshes, all LPS, mm."""

from pathlib import Path
from typing import Any

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.fusion.pose.pose import BorePose
from endoct.fusion.pose.summary import radius_of
from endoct.modalities.ct.trajectory import write_line
from endoct.workbench.exporting.itk_transform import save_affine
from endoct.workbench.exporting.mesh_files import Mesh, quads, save_ply, save_stl
from endoct.workbench.posing.result import axis_of

AROUND, ALONG_MM = 48, 0.5
COLOUR = (230, 159, 0)
BORE_TO_WORLD = "takes points of the bore frame (mm, z inward from the planned entry) to the CT's world, LPS"
WORLD_TO_BORE = "takes points of the CT's world, LPS, to the bore frame (mm, z inward from the planned entry)"


def write_handover(pose: BorePose, name: str, folder: Path) -> None:
    """Write the transforms both ways, the axis as a line called ``name``, and the bore as a mesh into ``folder``."""
    to_lps = pose.bore_to_lps
    to_bore = np.asarray(np.linalg.inv(to_lps), dtype=np.float64)
    save_affine(to_lps[:3, :3], to_lps[:3, 3], BORE_TO_WORLD, folder / "bore_to_world.tfm")
    save_affine(to_bore[:3, :3], to_bore[:3, 3], WORLD_TO_BORE, folder / "world_to_bore.tfm")
    _write_hdf5(to_lps, folder / "bore_to_world.h5")
    write_line(axis_of(pose), name, folder / "trajectory.mrk.json")
    tube = tube_of(to_lps, radius_of(pose), pose.plan.length_mm)
    save_ply(tube, folder / "bore.ply", "LPS of the patient's CT")
    save_stl(tube, folder / "bore.stl")


def tube_of(to_lps: Coordinates, radius_mm: float, length_mm: float) -> Mesh:
    """Return a cylinder about z of a frame, from 0 to ``length_mm``, closed at both ends, facing outward, LPS."""
    angle = 2 * np.pi / AROUND * np.arange(AROUND)
    z = np.linspace(0, length_mm, 1 + max(1, round(length_mm / ALONG_MM)))
    ring = radius_mm * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    wall = np.concatenate([np.column_stack([ring, np.full(AROUND, depth)]) for depth in z])
    points = np.concatenate([wall, [[0, 0, 0], [0, 0, length_mm]]]) @ to_lps[:3, :3].T + to_lps[:3, 3]
    corners, first = quads(z.size, AROUND), np.arange(AROUND)
    beside, last, mouth = np.roll(first, -1), len(wall) - AROUND, np.full(AROUND, len(wall))
    at_mouth = np.column_stack([mouth, beside, first])
    at_end = np.column_stack([mouth + 1, first + last, beside + last])
    faces = np.concatenate([corners[:, (0, 1, 2)], corners[:, (1, 3, 2)], at_mouth, at_end])
    colours = np.broadcast_to(np.array(COLOUR, np.uint8), points.shape)
    return Mesh(points.astype(np.float32), colours, faces.astype(np.int32), {})


def _write_hdf5(to_lps: Coordinates, path: Path) -> None:
    import SimpleITK as sitk

    transform: Any = sitk.AffineTransform(3)
    transform.SetMatrix(to_lps[:3, :3].ravel().tolist())
    transform.SetTranslation(to_lps[:3, 3].tolist())
    try:
        sitk.WriteTransform(transform, str(path))
    except RuntimeError as error:
        raise EndoctError(f"{path.name} cannot be written by SimpleITK", found=str(error)) from error
