"""The user's own bone: a CT or a segmentation, where the bore lies in it, and distances and chambers of its air.

World coordinates are LPS in here, as :mod:`endoct.modalities.ct.ct_volume` reads them.
"""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.errors import EndoctError
from endoct.base.files.files import sha256_of
from endoct.modalities.ct.ct_volume import (
    LABEL_SIGMA_VOXELS,
    CtVolume,
    check_within,
    holds_labels,
    in_world,
    meaning_of,
    read_ct,
    upright,
)
from endoct.modalities.ct.label_names import TABLE_SUFFIXES
from endoct.modalities.ct.stored import SIGNS, Convention
from endoct.modalities.ct.trajectory import Trajectory, axes_at
from endoct.synthetic.bone.lattice import Lattice
from endoct.synthetic.sample.parameters import Volume

BONE_HU = 300.0
"""Half way from air (−1000) to dense cortical bone (1600), where a blurred surface between them lies."""
MARGIN_MM = 1.5
"""Bone is read this much beyond the part asked for, so that distances there are right."""
CHAMBER_MM = 1.2
"""Two chambers are at least this far apart along an axis."""
LEAST_BONE = 0.3
"""At least this part of the bore's wall must be bone."""


Point = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Bone:
    """Air around a bore on the voxels of a volume.

    ``lattice`` (k, j, i) in LPS; ``distance_mm``: to the nearest surface, > 0 in air.
    """

    lattice: Lattice
    distance_mm: Image

    @cached_property
    def cell(self) -> NDArray[np.int32]:
        """The chamber of every voxel, 1, 2, … in air and in the bone near by, int32."""
        of, spacing = chambers(self.distance_mm, self.lattice.spacing_mm, CHAMBER_MM), self.lattice.spacing_mm
        if not of.any():
            return of
        nearest = ndimage.distance_transform_edt(of == 0, spacing, return_distances=False, return_indices=True)
        return np.asarray(of[tuple(nearest)], np.int32)


def volume_digest(path: Path, also: Sequence[Path] = ()) -> str:
    """Return the sha256 of a file, or that over the lines "name sha256" of the files in a folder.

    ``also``: files that belong to that file, such as the voxels that a header names; they are lines then as well.
    """
    if path.is_dir():
        files = sorted(file for file in path.iterdir() if file.is_file() and not file.name.startswith("."))
    elif also:
        files = [path, *also]
    else:
        return sha256_of(path)
    lines = "".join(f"{file.name} {sha256_of(file)}\n" for file in files)
    return hashlib.sha256(lines.encode("utf-8", "backslashreplace")).hexdigest()


def stated_volume(
    path: Path,
    ends_mm: tuple[Point, Point],
    *,
    coordinates: Convention | None = None,
    bone_hu: float | None = None,
    bone_label: int | None = None,
    detail_mm: float = 0.0,
    on_read: Callable[[CtVolume], None] | None = None,
) -> Volume:
    """Return the volume to drill into, once it is clear that this can be done.

    ``ends_mm``: where the drill enters and where it ends; ``coordinates``: what these numbers mean, as the file says
    where not stated.
    ``bone_hu``, ``bone_label``: what is bone; where neither is stated, from 300 HU on, or every label but 0.
    ``on_read`` is called with the volume, which says what was mended in it and what is doubted.

    Raises :class:`EndoctError` where the volume cannot be read, does not say what its numbers mean, or holds neither.
    So it does where the trajectory lies outside it, or where it holds no bone.
    """
    ct = read_ct(path, coordinates)
    if on_read is not None:
        on_read(ct)
    meaning = meaning_of(ct, coordinates, str(path))
    remedy = f"state what is bone: --bone-hu {BONE_HU:g}, or --bone-label 1"
    if bone_hu is None and bone_label is None and not holds_labels(ct, str(path), remedy):
        bone_hu = BONE_HU
    volume = Volume(
        path=str(path.resolve()),
        sha256=volume_digest(path, _voxel_files(path, ct)),
        coordinates=meaning,
        entry_mm=ends_mm[0],
        target_mm=ends_mm[1],
        bone_hu=bone_hu,
        bone_label=bone_label,
        detail_mm=detail_mm,
    )
    line = Trajectory(*(in_world(end_mm, meaning) for end_mm in ends_mm))
    check_within(ct, line, meaning, "the volume")
    if not np.any(_is_bone(ct.voxels, volume)):
        raise EndoctError(f"there is no bone in {path}", found=_bone_words(volume), remedy="check what is bone")
    return volume


def check_bone_share(share: float, volume: Volume) -> None:
    """Raise :class:`EndoctError` where ``share`` of the bore's wall is bone and that is too little."""
    if share < LEAST_BONE:
        raise EndoctError(
            "the trajectory does not run through bone",
            found=f"bone ({_bone_words(volume)}) on {share:.0%} of its wall",
            expected=f"{LEAST_BONE:.0%} at least",
            remedy="check entry, target, --coordinates and what is bone",
        )


def _bone_words(volume: Volume) -> str:
    if volume.bone_hu is not None:
        return f"{volume.bone_hu:g} HU or more"
    return "labels other than 0" if volume.bone_label is None else f"label {volume.bone_label}"


def _is_bone(voxels: NDArray[Any], volume: Volume) -> NDArray[np.bool_]:
    if volume.bone_hu is not None:
        return np.asarray(voxels >= volume.bone_hu)
    return np.asarray(voxels != 0 if volume.bone_label is None else voxels == volume.bone_label)


def bore_to_lps(volume: Volume) -> Coordinates:
    """Return the transform (4, 4) of the bore frame to LPS: z from entry to target, θ = 0 towards the head.

    Where the bore runs within 10° of that, θ = 0 is to the front.
    """
    signs = np.array(SIGNS[volume.coordinates])
    entry, target = signs * volume.entry_mm, signs * volume.target_mm
    return axes_at(entry, target - entry)


@lru_cache(maxsize=2)
def bone_around(volume: Volume, reach_mm: float) -> Bone:
    """Return the bone within ``reach_mm`` of the bore's axis. Raises where the volume is not the one stated."""
    path = Path(volume.path)
    try:
        ct = read_ct(path, volume.coordinates)
    except EndoctError as error:
        if volume_digest(path) != volume.sha256:
            raise _other_volume(path, volume) from error
        raise
    if volume_digest(path, _voxel_files(path, ct)) != volume.sha256:
        raise _other_volume(path, volume)
    ct = upright(ct)
    whole = Lattice(ct.origin_mm, ct.steps_mm, _shape(ct))
    to_world, length = bore_to_lps(volume), volume.length_mm
    ends = to_world[:3, 3] + np.array([[0.0], [length]]) * to_world[:3, 2]
    boxes = [whole.box(end, reach_mm + MARGIN_MM) for end in ends]
    box = tuple(slice(min(a.start, b.start), max(a.stop, b.stop)) for a, b in zip(*boxes, strict=True))
    part = whole.part((box[0], box[1], box[2]))
    voxels = ct.voxels[box]
    if volume.bone_hu is not None:
        level = np.asarray(volume.bone_hu - voxels.astype(np.float32))
    else:
        blurred = ndimage.gaussian_filter(_is_bone(voxels, volume).astype(np.float32), LABEL_SIGMA_VOXELS)
        level = np.asarray(0.5 - blurred, dtype=np.float32)
    return Bone(part, signed_distance(level, part.spacing_mm))


def _other_volume(path: Path, volume: Volume) -> EndoctError:
    return EndoctError(
        f"{path} is not the volume that was drilled into",
        found="another sha256",
        expected=volume.sha256[:12] + "…",
        remedy="replay with that very file",
    )


def _voxel_files(path: Path, ct: CtVolume) -> list[Path]:
    """Return the files besides ``path`` that hold voxels of it: names of labels are not what is drilled into."""
    return [file for file in ct.files if file != path and not path.is_dir() and file.suffix not in TABLE_SUFFIXES]


def _shape(ct: CtVolume) -> tuple[int, int, int]:
    k, j, i = ct.voxels.shape
    return int(k), int(j), int(i)


def signed_distance(level: Image, spacing_mm: Coordinates) -> Image:
    """Return the distance to where ``level`` (k, j, i) is 0, mm, > 0 where it is; float32.

    Between two voxels of different sign the surface lies where a straight line between their levels is 0. For voxels
    next to it the distance follows from those places along the three axes (Chopp 2001, "Some improvements of the fast
    marching method"). For all others it follows from the nearest of these voxels and its piece of surface. Where there
    is no surface the distance is ±1000.
    """
    air = level > 0
    beside, own = _next_to_surface(level, spacing_mm)
    if not beside.any():
        return np.where(air, np.float32(1000), np.float32(-1000))
    normal = np.stack([np.gradient(level, float(step), axis=axis) for axis, step in enumerate(spacing_mm)])
    normal /= np.maximum(np.sqrt(np.sum(normal * normal, axis=0)), 1e-9)
    nearest = ndimage.distance_transform_edt(~beside, sampling=spacing_mm, return_distances=False, return_indices=True)
    places = np.indices(level.shape, np.float32) * spacing_mm.astype(np.float32)[:, None, None, None]
    surface = places - np.where(air, own, -own) * normal  # beside every voxel that has one beside it

    def to_surface(of: NDArray[np.int32]) -> Image:
        way = places - surface[(slice(None), *of)]
        along = np.abs(np.sum(way * normal[(slice(None), *of)], axis=0))
        aside = np.maximum(np.sum(way * way, axis=0) - along * along, 0)
        # a piece of surface is as wide as a voxel, beyond which the way to its edge counts
        beyond = np.maximum(np.sqrt(aside) - np.float32(spacing_mm.max() / 2), 0)
        return np.asarray(np.sqrt(along * along + beyond * beyond), dtype=np.float32)

    distance = to_surface(nearest)
    for axis in range(3):
        for way in (-1, 1):  # the nearest piece may be that of a neighbour
            np.minimum(distance, to_surface(np.roll(nearest, way, axis=1 + axis)), out=distance)
    distance[beside] = own[beside]
    return np.where(air, distance, -distance)


def _next_to_surface(level: Image, spacing_mm: Coordinates) -> tuple[Mask, Image]:
    """Return the voxels next to the surface, and their distances from it, mm."""
    beside, inverse_square = np.zeros(level.shape, np.bool_), np.zeros(level.shape, np.float32)
    for axis, step in enumerate(spacing_mm):
        to_crossing = np.full(level.shape, np.inf, np.float32)
        first, last = [slice(None)] * 3, [slice(None)] * 3
        first[axis], last[axis] = slice(None, -1), slice(1, None)
        a, b = level[tuple(first)], level[tuple(last)]
        differs = (a > 0) != (b > 0)
        share = np.where(differs, a / np.where(differs, a - b, 1), np.inf).astype(np.float32)
        for part, way in ((tuple(first), share), (tuple(last), np.where(differs, 1 - share, np.inf))):
            np.minimum(to_crossing[part], np.float32(step) * np.maximum(way, 1e-4), out=to_crossing[part])
        beside |= np.isfinite(to_crossing)
        inverse_square += 1 / (to_crossing * to_crossing)
    return beside, np.where(beside, 1 / np.sqrt(np.maximum(inverse_square, 1e-12)), 0).astype(np.float32)


def chambers(distance_mm: Image, spacing_mm: Coordinates, apart_mm: float) -> NDArray[np.int32]:
    """Return the chambers of air, 1, 2, …: basins around the places farthest from bone, int32 (k, j, i), 0 in bone.

    Air of a mastoid is connected nearly throughout; what is called a cell ends where it is narrow. Two places are two
    cells' where they are ``apart_mm`` from each other along an axis.
    """
    from skimage.segmentation import watershed  # takes a while to load

    air = distance_mm > 0
    smooth = ndimage.gaussian_filter(distance_mm, 1.0)
    window = np.maximum(3, 2 * np.rint(apart_mm / 2 / spacing_mm).astype(int) + 1)
    peaks = air & (smooth == ndimage.maximum_filter(smooth, size=tuple(window)))
    parts, n_parts = ndimage.label(air)
    peakless = np.ones(n_parts + 1, np.bool_)
    peakless[parts[peaks]] = peakless[0] = False
    markers, _ = ndimage.label(peaks | peakless[parts], structure=np.ones((3, 3, 3)))
    return np.asarray(watershed(-smooth, markers, mask=air), dtype=np.int32)
