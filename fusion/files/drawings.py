"""Outlines and labels drawn in other programs, as masks on the samples of a panorama.

- A label or mask image, PNG, TIFF, …, also as napari saves a labels layer. :mod:`endoct.fusion.files.cell_values` says
  which samples are cell.
- A Zarr array of labels, or an OME-Zarr image or label group. Its finest level is read.
- Files of outlines (:mod:`endoct.fusion.files.outlines`).
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow
from PIL import ImageOps

from endoct.base.arrays import Mask
from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import inside, open_regular, read_start
from endoct.base.files.json_values import an_object, read_object
from endoct.base.zarr.zarr_metadata import LABELS, Declared, declared
from endoct.base.zarr.zarr_store import check_array, read_array
from endoct.fusion.files.cell_values import cells_by_palette, cells_in_colour, cells_of, minority
from endoct.fusion.files.outlines import OUTLINE_SUFFIXES, filled
from endoct.modalities.reading.recording import open_stack
from endoct.modalities.reading.tiff_directory import WHITE_IS_ZERO

_STORE_FILES = ("zarr.json", ".zarray", ".zgroup")


def read_drawing(path: Path, shape: tuple[int, int] | None) -> Mask:
    """Return the cells drawn in ``path``, bool (n_z, n_theta).

    ``shape`` is that of the panorama drawn on; outlines need it, images have one themselves. Raises
    :class:`EndoctError` where the file cannot be read or shows no cells.
    """
    if path.is_dir():
        return _stored(path)
    if path.suffix.lower() not in OUTLINE_SUFFIXES:
        return _image(path)
    cell = filled(path, shape)
    if not cell.any() or cell.all():
        raise EndoctError(
            f"the mask {path} shows no cells", found=f"outlines around {'all' if cell.any() else 'no'} samples"
        )
    return cell


def is_label_store(path: Path) -> bool:
    """Whether ``path`` is a Zarr store with one plane of whole numbers or truth values, as labels are."""
    if not any((path / name).is_file() for name in _STORE_FILES):
        return False
    try:
        labels = _finest(path)
    except EndoctError:
        return False
    return sum(length > 1 for length in labels.shape) == 2


def _stored(path: Path) -> Mask:
    if not any((path / name).is_file() for name in _STORE_FILES):
        raise EndoctError(
            f"{path} is no mask",
            found="a folder",
            expected="one image drawn over a panorama, PNG or TIFF, or a Zarr store of labels",
        )
    labels = _finest(path)
    if len(labels.shape) < 2 or any(length != 1 for length in labels.shape[:-2]) or 0 in labels.shape:
        raise EndoctError(f"{path} is no mask", found=f"an array of shape {labels.shape}", expected="one plane, z × θ")
    check_array(labels, whole=False)
    return cells_of(read_array(labels).reshape(labels.shape[-2:]), f"the mask {path}")


def _finest(path: Path) -> Declared:
    """Return the array at ``path``, or that of the finest level of the OME-Zarr group there."""
    with refusing(
        f"{path} holds no labels",
        expected="a Zarr array, or an OME-Zarr group with its levels listed",
        remedy="name the array or the labels/NAME group in it",
    ):
        third = (path / "zarr.json").is_file()
        if not third and (path / ".zarray").is_file():
            return declared(path, LABELS)
        stored = read_object(path / ("zarr.json" if third else ".zattrs"))
        if third and stored.get("node_type") == "array":
            return declared(path, LABELS)
        attributes = an_object(stored.get("attributes", {}), "its attributes") if third else stored
        listed = an_object(attributes.get("ome", attributes), "'ome'")["multiscales"][0]["datasets"][0]["path"]
        finest = inside(path, listed, f"the finest level of {path}")
        folders = [finest, *finest.parents]
        if any(folder.is_symlink() for folder in folders[: folders.index(path)]):
            raise EndoctError(f"{finest} cannot be part of a store", found="a link", expected="files and folders")
        return declared(finest, LABELS)


def _image(path: Path) -> Mask:
    if read_start(path, 3) == b"\xff\xd8\xff":
        raise EndoctError(
            f"the mask {path} does not say what is cell",
            found="a JPEG, whose losses leave black samples that are not zero",
            expected="PNG or TIFF",
            remedy="draw it in a format without losses",
        )
    stack = open_stack(path)
    if len(stack) != 1:
        raise EndoctError(f"{path} is no mask", found=f"{len(stack)} images", expected="one")
    subject = f"the mask {path}"
    with refusing(f"{subject} cannot be read"):
        if (indexed := _indexed(path)) is not None:
            return cells_by_palette(*indexed, subject)
        samples = stack.stored(0)
        if stack.palette is not None:
            return cells_by_palette(samples, stack.palette.reshape(len(stack.palette), -1), subject)
        cells = cells_of(samples, subject) if samples.ndim == 2 else cells_in_colour(samples, subject)
        layout = getattr(stack.reader, "layout", None)
        turned_over = layout is not None and layout.photometric == WHITE_IS_ZERO
        return minority(cells, subject) if turned_over else cells


def _indexed(path: Path) -> tuple[NDArray[Any], NDArray[Any]] | None:
    """Return the numbers of colours in a PNG or BMP that has a palette, upright, and the colours; None for others.

    Numbers: (n_z, n_theta). Colours: (n, 4), RGB and opacity.
    """
    if not read_start(path, 8).startswith((b"\x89PNG", b"BM")):
        return None
    with open_regular(path) as file, Pillow.open(file, formats=("PNG", "BMP")) as image:
        if image.mode != "P":
            return None
        image.apply_transparency()
        palette = image.getpalette("RGBA") or []
        return np.asarray(ImageOps.exif_transpose(image)), np.asarray(palette, np.uint8).reshape(-1, 4)
