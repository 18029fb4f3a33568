"""The alignment of a comparison as a transform in ITK's text format, for ITK, SimpleITK and 3D Slicer."""

from pathlib import Path

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.fusion.geometry.alignment import Alignment, Bend
from endoct.workbench.exporting.mark import BLANK, mark
from endoct.workbench.exporting.source import Exportable
from endoct.workbench.requests import ExportRequest
from endoct.workbench.running.progress import Stages

FIELD_STEP_MM = 0.02
FIELD_REACH_MM = 20.0
"""A bend is written this far from the axis, and this far beyond its ends. Farther out ITK takes it for none."""


def write_itk_transform(source: Exportable, path: Path, request: ExportRequest, stages: Stages) -> dict[str, object]:
    """Write where a point of side B lies in side A's frame, mm; with ``request.inverse`` the way back.

    It is affine; where the sides bend, a displacement field follows. Raises :class:`EndoctError` where ``source`` is no
    comparison, or its sides are not aligned.
    """
    del stages
    if source.kind != "comparison":
        raise EndoctError(f"{source.path} has no alignment", expected="a folder written by `endoct compare`")
    if source.alignment is None:
        raise EndoctError(f"the sides of {source.path} are not aligned", remedy="see its report for why")
    alignment = source.alignment.inverse() if request.inverse else source.alignment
    end, start = reversed(source.sides) if request.inverse else source.sides
    matrix, offset_mm = affine_of(alignment.rigid)
    parts = [_affine_lines(matrix, offset_mm)]
    if alignment.bend is not None:
        # of several transforms, ITK applies the last one first
        parts = [["Transform: CompositeTransform_double_3_3"], _field_lines(alignment.bend), *parts]
    _save(parts, f"takes points in the bore frame of {start} to that of {end}, mm", path)
    said = {"from": start, "to": end, "matrix": matrix.tolist(), "offset_mm": offset_mm.tolist()}
    return said | {"bends": alignment.bend is not None}


def save_affine(matrix: Coordinates, offset_mm: Coordinates, title: str, path: Path) -> None:
    """Write the affine transform that takes a point to matrix (3, 3) @ point + offset (3,); ``title`` it does."""
    _save([_affine_lines(matrix, offset_mm)], title, path)


def _save(parts: list[list[str]], title: str, path: Path) -> None:
    lines = ["#Insight Transform File V1.0", f"# {BLANK}", f"# {title}"]
    for number, part in enumerate(parts):
        lines += [f"#Transform {number}", *part]
    path.write_text("\n".join([*lines, ""]), encoding="utf-8", newline="\n")
    mark(path)


def _affine_lines(matrix: Coordinates, offset_mm: Coordinates) -> list[str]:
    values = np.concatenate([np.ravel(matrix), offset_mm])
    return ["Transform: AffineTransform_double_3_3", f"Parameters: {_text(values)}", "FixedParameters: 0 0 0"]


def _field_lines(bend: Bend) -> list[str]:
    """Return a bend as displacements at corners of planes across the bore; ITK interpolates linearly in between."""
    n_planes = int(np.ceil((bend.z_mm[-1] - bend.z_mm[0] + 2 * FIELD_REACH_MM) / FIELD_STEP_MM)) + 1
    z_mm: Coordinates = bend.z_mm[0] - FIELD_REACH_MM + FIELD_STEP_MM * np.arange(n_planes, dtype=np.float64)
    turned = np.exp(1j * bend.at(bend.roll_rad, z_mm)) - 1
    corners = FIELD_REACH_MM * np.array([-1 - 1j, 1 - 1j, -1 + 1j, 1 + 1j])
    across = turned[:, np.newaxis] * corners
    along = np.repeat(bend.at(bend.shift_mm, z_mm)[:, np.newaxis], len(corners), axis=1)
    size, origin = (2, 2, n_planes), (-FIELD_REACH_MM, -FIELD_REACH_MM, z_mm[0])
    fixed = np.array([*size, *origin, 2 * FIELD_REACH_MM, 2 * FIELD_REACH_MM, FIELD_STEP_MM, *np.eye(3).ravel()])
    return [
        "Transform: DisplacementFieldTransform_double_3_3",
        f"Parameters: {_text(np.stack([across.real, across.imag, along], axis=-1).ravel())}",
        f"FixedParameters: {_text(fixed)}",
    ]


def _text(values: Coordinates) -> str:
    return " ".join(repr(float(value)) for value in values)


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
