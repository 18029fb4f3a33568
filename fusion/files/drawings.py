"""Outlines and labels drawn in other programs, as masks on the samples of a panorama.

- A label or mask image, PNG, TIFF, …, also as napari saves a labels layer.
- A Zarr array of labels, or an OME-Zarr image or label group. Its finest level is read.
- Files of outlines (:mod:`endoct.fusion.files.outlines`).

Samples of an image are cell by their values. It is a mask where its ground is known and the rest is of one kind: 0 and
one other value, black and one colour, or one colour on a transparent ground. Labels on a ground of 0 are cells as well.
Everything else is refused with what was found: grey values, probabilities, soft edges, pictures that were painted on,
labels without a ground. Soft edges are not cut at half, as nobody can tell them from probabilities.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow
from PIL import ImageOps
from skimage.measure import label

from endoct.base.arrays import Mask
from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import inside, open_regular, read_start
from endoct.base.files.json_values import an_object, read_object
from endoct.base.zarr.zarr_metadata import LABELS, Declared, declared
from endoct.base.zarr.zarr_store import check_array, read_array
from endoct.fusion.files.outlines import OUTLINE_SUFFIXES, filled
from endoct.modalities.reading.recording import open_stack
from endoct.modalities.reading.tiff_directory import WHITE_IS_ZERO

EXPECTED = "0 and one other value, or labels counted from 1 on a ground of 0"
REMEDY = "save cells as white on black, without soft edges; what lies in an overlay of Fiji, from its ROI manager"
SPARSE = 2
"""The highest of labels that were counted from 1 is at most so many times their number, as some were deleted."""
PIECES = 2
"""Other labels are names of regions: so many regions have one name at most, as the seam cuts some in two."""
WHITE = (255, 65535)
"""Nobody counts so far; this is paint."""
LEAST_REGION = 3
"""Samples of the median region, where labels touch: soft edges and grey values come in smaller ones."""
LEAST_ON_GROUND = 0.5
"""The share of its border that each label has with the ground: levels of votes or probabilities enclose each other."""
_STORE_FILES = ("zarr.json", ".zarray", ".zgroup")


def cells_of(samples: NDArray[Any], subject: str) -> Mask:
    """Return where whole numbers, truth values or floats (n_z, n_theta) are cell.

    Raises :class:`EndoctError` where they are neither two values with 0 nor labels on a ground of 0.
    """
    if samples.dtype.kind == "f" and not np.isfinite(samples).all():
        raise _unclear(subject, "NaN or infinity")
    low, high = samples.min(), samples.max()
    if low == high:
        raise EndoctError(f"{subject} shows no cells", found=f"{low:g} everywhere", expected=EXPECTED)
    two = bool(((samples == low) | (samples == high)).all())
    if low != 0 or not (two or _are_labels(samples)):
        raise _unclear(subject, _listed(np.unique(samples)))
    return np.asarray(samples != 0)


def cells_in_colour(samples: NDArray[Any], subject: str) -> Mask:
    """Return where an image (n_z, n_theta, channel) is cell: grey or RGB, with opacity last where there are 2 or 4.

    Raises :class:`EndoctError` where it is neither one colour on a ground that is black or transparent, nor a grey
    image that :func:`cells_of` reads.
    """
    colours, opacity = (samples[..., :-1], samples[..., -1]) if samples.shape[2] in (2, 4) else (samples, None)
    if opacity is None or (opacity == opacity.max()).all():
        if opacity is not None and not opacity.any():
            raise EndoctError(f"{subject} shows no cells", found="all of it is transparent")
        if (colours == colours[..., :1]).all():
            return cells_of(colours[..., 0], subject)
        drawn = colours.any(axis=2)
        if drawn.all() or not _is_one_colour(colours[drawn]):
            kinds = np.unique(colours[drawn], axis=0)
            none = ", none of them black" if drawn.all() else ""
            raise _unclear(subject, f"{len(kinds) + (not none)} colours{none}")
        return np.asarray(drawn)
    opaque = opacity != 0
    levels = np.unique(opacity)
    if len(levels) != 2 or levels[0] != 0:
        raise _unclear(subject, f"{len(levels)} degrees of transparency")
    if not _is_one_colour(colours[opaque]):
        raise _unclear(subject, f"{len(np.unique(colours[opaque], axis=0))} colours on a transparent ground")
    return np.asarray(opaque)


def cells_by_palette(numbers: NDArray[Any], palette: NDArray[Any], subject: str) -> Mask:
    """Return where an image (n_z, n_theta) of numbers of colours is cell; ``palette``: (n, 3), or (n, 4) with opacity.

    0 is the ground, unless its colour contradicts. A palette with the colours of the image alone may have been sorted
    by a program that made the file smaller; there, what is black is the ground. Raises :class:`EndoctError` where
    nothing says which is the ground.
    """
    used = np.unique(numbers)
    ground = (palette[:, :3].max(axis=1) == 0) | (palette[:, 3:] == 0).any(axis=1)
    others = used[used > 0]
    if ground[0] and not ground[others].any():
        return cells_of(numbers, subject)
    if len(palette) > len(used) and not ground[used].any():
        return cells_of(numbers, subject)
    if len(palette) == len(used) == 2 and np.count_nonzero(ground) == 1:
        return minority(~ground[numbers], subject)
    if ground[0]:
        raise _unclear(subject, "a palette in which 0 is black or transparent, and another number is too")
    if ground[others].any():
        raise _unclear(subject, "a palette in which 0 is not black, and another number is")
    raise _unclear(subject, "a palette without black, whose order says nothing")


def minority(cells: Mask, subject: str) -> Mask:
    """Return ``cells``. Raises :class:`EndoctError` where most samples are: black and white may have changed places."""
    if cells.mean() > 0.5:
        raise _unclear(
            subject, f"{cells.mean():.0%} of it white, in a file that changes what black and white stand for"
        )
    return cells


def _are_labels(samples: NDArray[Any]) -> bool:
    """Say whether more than two values, the lowest 0, are labels of regions on that ground."""
    if samples.dtype.kind == "f" and (samples != np.rint(samples)).any():
        return False
    values, numbers = np.unique(samples, return_inverse=True)
    numbers = numbers.reshape(samples.shape).astype(np.int32)
    highest, n = values[-1], len(values) - 1
    regions, n_regions = label(numbers, connectivity=1, return_num=True)
    counted, beyond = highest <= SPARSE * n, highest > WHITE[1]
    if not (counted or beyond or (n_regions <= PIECES * n and highest not in WHITE)):
        return False
    one = np.concatenate([numbers[:-1].ravel(), numbers.ravel()])
    other = np.concatenate([numbers[1:].ravel(), np.roll(numbers, -1, axis=1).ravel()])
    differ = one != other
    one, other = one[differ], other[differ]
    border = np.bincount(np.concatenate([one, other]), minlength=n + 1)[1:]
    on_ground = np.bincount(np.concatenate([one[other == 0], other[one == 0]]), minlength=n + 1)[1:]
    if (on_ground == border).all():
        return True
    if np.median(np.bincount(regions.ravel())[1:]) < LEAST_REGION:
        return False
    return bool(beyond or (on_ground >= LEAST_ON_GROUND * border).all())  # no grey values or votes go as far as that


def _is_one_colour(colours: NDArray[Any]) -> bool:
    """Say whether all of ``colours`` (n, channel) are alike; there is one at least."""
    return bool((colours == colours[0]).all())


def _listed(values: NDArray[Any]) -> str:
    if len(values) > 4:
        return f"{len(values)} values from {values[0]:g} to {values[-1]:g}"
    return "values " + ", ".join(f"{value:g}" for value in values) + ("" if 0 in values else ", none of them 0")


def _unclear(subject: str, held: str) -> EndoctError:
    return EndoctError(f"{subject} does not say what is cell", found=held, expected=EXPECTED, remedy=REMEDY)


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
