"""A CT, or a segmentation of one: its voxels, where in the patient they lie, and what its file says of them.

Coordinates here are LPS, as in DICOM: mm to the patient's left, to the back, to the head. A file may use another
convention for its own numbers (NIfTI: RAS); :attr:`CtVolume.coordinates` says which. The format of a file follows from
its content.

Why not SimpleITK? Its series reader does not compare positions and orientations of slices. A damaged header ends the
process, and any file that a header names is opened.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.base.files.files import open_regular
from endoct.modalities.ct.dicom import read_dicom
from endoct.modalities.ct.dicom_files import dicom_in
from endoct.modalities.ct.hounsfield import LEAST_HU, hounsfield_doubts
from endoct.modalities.ct.label_names import OUR_NAMES, OUR_TABLE, read_label_names, table_next_to
from endoct.modalities.ct.metaimage import is_metaimage, read_metaimage
from endoct.modalities.ct.nifti import is_nifti, is_our_label_map, read_nifti
from endoct.modalities.ct.nrrd import is_nrrd, read_nrrd
from endoct.modalities.ct.stored import EXPECTED, SIGNS, Convention, Segment, segments_of
from endoct.modalities.ct.stored import CtVolume as CtVolume
from endoct.modalities.ct.trajectory import Point, Trajectory, as_point
from endoct.modalities.dicom.dicom_file import is_dicom, kind_of

MOST_LABELS = 64
LABEL_SIGMA_VOXELS = 0.6
"""A segmentation is blurred by this: it takes its steps, and leaves septa of one voxel."""
VOXELS_MM = (0.001, 20.0)
"""Voxels of a patient, or of a bone in a micro-CT, have sizes between these; anything else is another unit."""
_FORMATS: tuple[tuple[Callable[[Path], bool], Callable[[Path], CtVolume]], ...] = (
    (is_nrrd, read_nrrd),
    (is_dicom, read_dicom),
    (is_nifti, read_nifti),
    (is_metaimage, read_metaimage),
)


def is_volume(path: Path) -> bool:
    """Say whether a path is, by its content, a volume: a file, or slices in a folder; no recording in DICOM."""
    if path.is_dir():
        return dicom_in(path)
    return any(is_format(path) for is_format, _ in _FORMATS) and not kind_of(path).is_recording


def read_ct(path: Path, stated: Convention | None = None) -> CtVolume:
    """Return the volume in a file or in a folder of DICOM.

    A file that does not say what its coordinates mean is taken to use those that are ``stated``. Raises
    :class:`EndoctError` for what is no such volume, or needs too much memory. Raises it also for one that is sheared,
    whose slices lie unevenly, that does not say where it lies, or whose values are no numbers.
    """
    if not path.exists():
        found = "a link that leads nowhere" if path.is_symlink() else "no such file"
        raise EndoctError(f"{path} cannot be read", found=found, expected=EXPECTED, remedy="check the path")
    stored = read_dicom(path) if path.is_dir() else _read_file(path)
    _check_geometry(stored, path)
    origin, steps = stored.origin_mm, stored.steps_mm
    if not stored.placed:
        if stated is None:
            raise _unsaid(str(path))
        origin, steps = origin * SIGNS[stated], steps * SIGNS[stated]
    low, high = float(stored.voxels.min()), float(stored.voxels.max())
    if not np.isfinite(low + high):
        raise EndoctError(f"{path} has values that are no numbers", found=f"{low:g} to {high:g}")
    files, segments = stored.files, stored.segments
    if segments is None and not path.is_dir() and low >= 0 and stored.voxels.dtype.kind in "iu":
        if (table := table_next_to(path)) is not None:
            segments, files = segments_of(read_label_names(table)) or None, (*files, table)
        elif is_our_label_map(path):
            segments = segments_of(OUR_NAMES)
    doubts = hounsfield_doubts(stored.voxels, path.name or str(path)) if low < LEAST_HU else ()
    return replace(
        stored, origin_mm=origin, steps_mm=steps, placed=True, files=files, segments=segments,
        doubts=(*stored.doubts, *doubts),
    )  # fmt: skip


def with_label_names(ct: CtVolume, names: Path | str | None) -> CtVolume:
    """Return a segmentation whose labels are named by a table, or as endoct's own where ``names`` is "endoct".

    With None it stays as it is. Raises :class:`EndoctError` for what is no such table.
    """
    if names is None:
        return ct
    if str(names) == OUR_TABLE:
        return replace(ct, segments=segments_of(OUR_NAMES))
    table = Path(names)
    return replace(ct, segments=segments_of(read_label_names(table)), files=(*ct.files, table))


def part_around(ct: CtVolume, places_mm: Coordinates, margin_mm: float) -> CtVolume:
    """Return the part of a volume that holds places (n, 3) LPS, and ``margin_mm`` more, as far as it reaches.

    It has no voxels where the places lie farther away than that.
    """
    to_index = np.linalg.inv(ct.steps_mm)
    index = (places_mm - ct.origin_mm) @ to_index
    margin = margin_mm * np.linalg.norm(to_index, axis=0)
    first = np.clip(np.floor(index.min(axis=0) - margin), 0, ct.voxels.shape).astype(int)
    end = np.clip(np.ceil(index.max(axis=0) + margin) + 1, first, ct.voxels.shape).astype(int)
    voxels = ct.voxels[tuple(slice(a, b) for a, b in zip(first, end, strict=True))]
    return replace(ct, voxels=voxels, origin_mm=ct.origin_mm + first @ ct.steps_mm)


def upright(ct: CtVolume) -> CtVolume:
    """Return a volume whose steps lie at right angles: each slice of a sheared one is moved along itself.

    Values between voxels are cubic, of labels the nearest; beyond a slice they go on as at its border.
    """
    if not ct.is_sheared:
        return ct
    from scipy import ndimage  # takes a while to load

    step, *within = ct.steps_mm
    aside = np.array([step @ axis / (axis @ axis) for axis in within])  # voxels from a slice to the next
    first = np.floor(np.minimum(0, aside * (len(ct.voxels) - 1))).astype(int)
    more = np.ceil(np.abs(aside) * (len(ct.voxels) - 1)).astype(int)
    shape = ct.voxels.shape[1] + int(more[0]), ct.voxels.shape[2] + int(more[1])
    labels = ct.segments is not None or float(ct.voxels.min()) >= 0
    order, dtype = (0, ct.voxels.dtype) if labels else (3, np.dtype(np.float32))
    voxels = np.empty((len(ct.voxels), *shape), dtype)
    for k, values in enumerate(ct.voxels):
        ndimage.affine_transform(
            values.astype(dtype), np.ones(2), first - k * aside, shape, voxels[k], order, mode="nearest"
        )
    steps = np.array([step - aside @ np.array(within), *within])
    return replace(ct, voxels=voxels, origin_mm=ct.origin_mm + first @ np.array(within), steps_mm=steps)


def holds_labels(ct: CtVolume, name: str, remedy: str) -> bool:
    """Whether a volume, called ``name``, holds labels, 0 for air, and not Hounsfield units.

    Raises :class:`EndoctError` with ``remedy`` where that cannot be told.
    """
    least = float(ct.voxels.min())
    if least < LEAST_HU:
        return False
    whole = least >= 0 and np.issubdtype(ct.voxels.dtype, np.integer)
    if whole and ct.segments is not None:
        _check_names_bone(ct.segments, name)
        return True
    if whole and len(np.unique(ct.voxels)) <= MOST_LABELS:
        return True
    raise EndoctError(
        f"{name} may hold Hounsfield units, or labels",
        found=f"values from {least:g} to {float(ct.voxels.max()):g}",
        expected=f"less than {LEAST_HU:g} somewhere, or at most {MOST_LABELS} whole numbers from 0 on",
        remedy=remedy,
    )


def meaning_of(ct: CtVolume, stated: Convention | None, name: str) -> Convention:
    """Return what coordinates in a volume, called ``name``, mean: what is ``stated``, else what its file says.

    Raises :class:`EndoctError` where neither does.
    """
    meaning = stated or ct.coordinates
    if meaning is None:
        raise _unsaid(name)
    return meaning


def in_world(place_mm: Point, coordinates: Convention) -> Point:
    """Return a place of LPS in ``coordinates``, or one of these in LPS: the same signs both ways."""
    return as_point(np.array(SIGNS[coordinates]) * place_mm)


def corners_of(ct: CtVolume) -> Coordinates:
    """Return the middles of the corner voxels, (8, 3) LPS."""
    last = np.array(ct.voxels.shape) - 1.0
    return np.array([ct.origin_mm + (np.array(corner) * last) @ ct.steps_mm for corner in np.ndindex(2, 2, 2)])


def check_within(ct: CtVolume, line: Trajectory, coordinates: Convention, name: str) -> None:
    """Raise :class:`EndoctError` where an end of ``line`` lies outside a volume, called ``name``.

    It gives the numbers in ``coordinates``.
    """
    size = np.array(ct.voxels.shape)
    for end, place in (("entry", line.entry_mm), ("target", line.target_mm)):
        index = (np.array(place) - ct.origin_mm) @ np.linalg.inv(ct.steps_mm)
        if np.all(index >= -0.5) and np.all(index <= size - 0.5):
            continue
        corners = corners_of(ct) * SIGNS[coordinates]
        extent = ", ".join(f"{axis.min():.1f} … {axis.max():.1f}" for axis in corners.T)
        raise EndoctError(
            f"the {end} lies outside {name}",
            found=", ".join(f"{value:g}" for value in in_world(place, coordinates)),
            expected=f"within {extent} mm ({coordinates.upper()})",
            remedy="check the numbers, and --coordinates",
        )


def _check_names_bone(segments: Sequence[Segment], name: str) -> None:
    """Refuse labels by whose names 0 is not air, or what is not air is no bone."""
    air = [segment for segment in segments if "air" in segment.name.lower().replace("_", " ").split()]
    if air or not any("bone" in segment.name.lower() for segment in segments):
        raise EndoctError(
            f"{name} does not have air as 0 and bone as its labels",
            found=", ".join(f"{segment.label} {segment.name}" for segment in (air or segments))[:120],
            expected="a segmentation that names bone, and air as 0",
            remedy="give the CT itself, or a segmentation of its bone",
        )


def _read_file(path: Path) -> CtVolume:
    with open_regular(path):  # a pipe, or what may not be read, is said before anything else is
        pass
    for is_format, read in _FORMATS:
        if is_format(path):
            return read(path)
    found = "no DICOM, NIfTI, NRRD or MetaImage by its content"
    raise EndoctError(f"{path} is no volume", found=found, expected=EXPECTED)


def _check_geometry(stored: CtVolume, path: Path) -> None:
    """Refuse voxels without a size or a place, of an impossible size, and axes that are not at right angles."""
    sizes = np.linalg.norm(stored.steps_mm, axis=1)
    whole = np.all(np.isfinite(stored.steps_mm)) and np.all(np.isfinite(stored.origin_mm))
    if not whole or not np.all(sizes > 0):
        raise EndoctError(
            f"{path} does not say where its voxels lie",
            found=f"steps of {' × '.join(f'{size:g}' for size in sizes)} mm",
        )
    if not VOXELS_MM[0] <= sizes.min() <= sizes.max() <= VOXELS_MM[1]:
        raise EndoctError(
            f"{path} has voxels of a size that cannot be",
            found=" × ".join(f"{size:.3g}" for size in sizes[::-1]) + " mm",
            expected=f"{VOXELS_MM[0]:g} to {VOXELS_MM[1]:g} mm",
            remedy="check its unit of length",
        )
    if stored.is_sheared and not stored.tilted:
        raise EndoctError(
            f"the voxels of {path} do not lie at right angles",
            found=f"axes with a cosine of {stored.shear:.3g} between them",
            remedy="resample it, as 3D Slicer's Resample Scalar Volume does",
        )


def _unsaid(name: str) -> EndoctError:
    return EndoctError(
        f"{name} does not say whether its coordinates are RAS or LPS",
        expected="a 'space' of right-anterior-superior or left-posterior-superior, or a qform or sform code",
        remedy="state --coordinates ras or --coordinates lps",
    )
