"""The formats that can be exported, by name and by the suffix of a file."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, get_args

from endoct.base.errors import EndoctError
from endoct.workbench.requests import ExportRequest, FormatName

if TYPE_CHECKING:
    from endoct.workbench.exporting.source import Exportable
    from endoct.workbench.running.progress import Stages

VOXEL_MM = 0.01
VERTEX_MM = 0.02
Writer = Callable[["Exportable", Path, ExportRequest, "Stages"], dict[str, object]]
_TIFF = ".ome.tiff", ".ome.tif", ".tiff", ".tif"
_WALL = "side", "vertex_mm"


@dataclass(frozen=True)
class Format:
    """A format: the ``suffixes`` that its files may have, its ``options``, and "module:function" that writes it.

    ``opens``: what it holds, and what reads it; ``by_suffix``: whether a suffix alone means this format;
    ``is_folder``: whether it is a folder, not a file; ``is_marked``: whether its files say that endoct wrote them.
    """

    name: FormatName
    suffixes: tuple[str, ...]
    options: tuple[str, ...]
    writer: str
    opens: str
    by_suffix: bool = True
    is_folder: bool = False
    is_marked: bool = True

    def load(self) -> Writer:
        """Return the function that writes it."""
        module, function = self.writer.split(":")
        writer: Writer = getattr(import_module(f"endoct.workbench.exporting.{module}"), function)
        return writer


FORMATS = {
    one.name: one
    for one in (
        Format(
            "ome-zarr",
            (".ome.zarr", ".zarr"),
            ("version",),
            "ome_files:write_ome_zarr",
            "images and cells, for napari",
            is_folder=True,
        ),
        Format("ome-tiff", _TIFF, (), "ome_files:write_ome_tiff", "images, for Fiji, QuPath, 3D Slicer"),
        Format("nrrd", (".nrrd",), ("voxel_mm",), "volume_files:write_nrrd", "the volume, for 3D Slicer, ParaView"),
        Format(
            "nifti",
            (".nii.gz", ".nii"),
            ("voxel_mm",),
            "volume_files:write_nifti",
            "the volume, for ITK-SNAP, 3D Slicer",
        ),
        Format(
            "ply", (".ply",), ("color", *_WALL), "mesh_files:write_ply", "the wall, for ParaView, Blender, 3D Slicer"
        ),
        Format("stl", (".stl",), _WALL, "mesh_files:write_stl", "the wall without colours, to be printed"),
        Format("glb", (".glb",), ("color", *_WALL), "mesh_files:write_glb", "the wall, for Blender, viewers of glTF"),
        Format(
            "itk-transform",
            (".tfm", ".txt"),
            ("inverse",),
            "itk_transform:write_itk_transform",
            "the alignment, for 3D Slicer, SimpleITK",
        ),
        Format("labels", _TIFF, (), "ome_files:write_labels", "cells by number, for Fiji, napari", by_suffix=False),
        Format(
            "dicom",
            (".dicom",),
            (),
            "dicom_files:write_dicom",
            "images, relief and cells, for archives and other readers of DICOM",
            is_folder=True,
        ),
        Format(
            "csv",
            (".csv",),
            ("side",),
            "quality_table:write_quality",
            "numbers per frame, for spreadsheets, R",
            is_marked=False,
        ),
        Format("pdf", (".pdf",), (), "figure_files:write_pdf", "the report's figures, a page each", is_marked=False),
        Format(
            "svg",
            (".svg.zip", ".zip"),
            (),
            "figure_files:write_svg",
            "the report's figures, to be edited in Inkscape",
            is_marked=False,
        ),
    )
}
assert set(FORMATS) == set(get_args(FormatName))  # noqa: S101 - the names stand twice, for type checkers


def format_for(to: str | None, output: Path) -> Format:
    """Return the format named ``to``, else the one that the suffix of ``output`` means.

    Raises :class:`EndoctError` where there is no such format, or the suffix is that of another.
    """
    name = output.name.lower()
    if to is None:
        for one in FORMATS.values():
            if one.by_suffix and name.endswith(one.suffixes):
                return one
        suffixes = ", ".join(one.suffixes[0] for one in FORMATS.values() if one.by_suffix)
        remedy = "or name it with to='FORMAT'"
        raise EndoctError(f"the name {output} does not say which format it is", expected=suffixes, remedy=remedy)
    if to not in FORMATS:
        raise EndoctError(f"there is no format '{to}'", expected=", ".join(FORMATS))
    chosen = FORMATS[to]
    if not name.endswith(chosen.suffixes):
        names = " or ".join(f"NAME{suffix}" for suffix in chosen.suffixes)
        raise EndoctError(f"a file of {to} cannot be called {output.name}", expected=names)
    return chosen
