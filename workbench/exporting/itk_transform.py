"""An affine transform, as the alignment of a comparison, in ITK's text format, for ITK, SimpleITK and 3D Slicer."""

from pathlib import Path

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.fusion.geometry.alignment import Alignment
from endoct.workbench.exporting.mark import BLANK, mark
from endoct.workbench.exporting.source import Exportable
from endoct.workbench.requests import ExportRequest
from endoct.workbench.running.progress import Stages


def write_itk_transform(source: Exportable, path: Path, request: ExportRequest, stages: Stages) -> dict[str, object]:
    """Write where a point of side B lies in side A's frame, mm; with ``request.inverse`` the way back.

    Raises :class:`EndoctError` where ``source`` is no comparison, or its sides are not aligned, or bend.
    """
    del stages
    if source.kind != "comparison":
        raise EndoctError(f"{source.path} has no alignment", expected="a folder written by `endoct compare`")
    if source.alignment is None:
        raise EndoctError(f"the sides of {source.path} are not aligned", remedy="see its report for why")
    if source.alignment.bend is not None:
        raise EndoctError(
            f"{source.sides[1]} bends along the bore, and no affine transform follows that",
            found=f"a bend of {len(source.alignment.bend.z_mm)} knots in the result of {source.path}",
            remedy="take bend from result.json, or export an image: images lie where the bend puts them",
        )
    a, b = source.sides
    matrix, offset_mm = affine_of(source.alignment)
    start, end = b, a
    if request.inverse:
        matrix = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
        offset_mm, start, end = -matrix @ offset_mm, a, b
    save_affine(matrix, offset_mm, f"takes points in the bore frame of {start} to that of {end}, mm", path)
    return {"from": start, "to": end, "matrix": matrix.tolist(), "offset_mm": offset_mm.tolist()}


def save_affine(matrix: Coordinates, offset_mm: Coordinates, title: str, path: Path) -> None:
    """Write the affine transform that takes a point to matrix (3, 3) @ point + offset (3,); ``title`` it does."""
    lines = [
        "#Insight Transform File V1.0",
        f"# {BLANK}",
        f"# {title}",
        "#Transform 0",
        "Transform: AffineTransform_double_3_3",
        f"Parameters: {' '.join(repr(float(value)) for value in (*matrix.ravel(), *offset_mm))}",
        "FixedParameters: 0 0 0",
        "",
    ]
    path.write_text("\n".join(lines), encoding="utf-8", newline="\n")
    mark(path)


def affine_of(alignment: Alignment) -> tuple[Coordinates, Coordinates]:
    """Return (matrix (3, 3), offset_mm (3,)): x, y, z of side A of a point of side B are matrix @ point + offset.

    It turns about z, after a reflection in y where θ runs the other way. Along z it scales, by a negative factor where
    z runs the other way, and shifts. Distances from the axis stay as they are.
    """
    cos, sin = np.cos(alignment.theta_shift_rad), np.sin(alignment.theta_shift_rad)
    sense = -1.0 if alignment.mirrored else 1.0
    along = -alignment.z_scale if alignment.z_reversed else alignment.z_scale
    matrix = np.array([[cos, -sense * sin, 0], [sin, sense * cos, 0], [0, 0, along]])
    return matrix, np.array([0, 0, alignment.z_shift_mm])
