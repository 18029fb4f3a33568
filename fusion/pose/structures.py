"""What the drill must miss or reach: labelled structures near a bore, and how far its envelope stays from them."""

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from skimage.measure import marching_cubes

from endoct.base.arrays import Coordinates
from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError
from endoct.fusion.pose.pose import LEVEL, BorePose, Estimate, sampled_axes
from endoct.modalities.ct.ct_volume import CtVolume, part_around
from endoct.modalities.ct.stored import Segment
from endoct.modalities.ct.trajectory import Trajectory

FACIAL_NERVE = re.compile(r"facial.*nerve|nerv(us|e)?.*facial(is)?|\bcn ?(vii|7)\b", re.IGNORECASE)
"""Names of the facial nerve, for which the facial recess is named."""
NO_STRUCTURES = frozenset(("air", "bone", "bones", "background", "exterior", "skull", "temporalbone"))
OF_THESE = frozenset(("cell", "cells", "temporal", "mastoid", "petrous", "cortical", "left", "right", "l", "r"))
"""A name is that of no structure where one word of it is among the first, and all others are among these."""
MOST_LABELS = 256
"""A segmentation has so many labels at most; a volume with more values is none."""
LONGEST_NAME = 80
NEAR_MM = 15.0
"""Structures farther away from the plan than this do not concern the bore."""
LIKELY_AXES, AXES_AT_A_TIME = 2000, 64
NEAREST_MM = 3.0
"""A point of a structure that lies farther away than its nearest one by this is nearest to no likely axis."""


@dataclass(frozen=True, eq=False)
class Structure:
    """A labelled structure: ``points_mm`` (n, 3) LPS on its surface, about a voxel of ``voxel_mm`` apart.

    ``name`` is as the segmentation has it, or says that it is unknown.
    """

    label: int
    points_mm: Coordinates
    voxel_mm: float
    name: str

    @property
    def is_facial_nerve(self) -> bool:
        """Whether its name is one of the facial nerve's."""
        return FACIAL_NERVE.search(_words(self.name)) is not None


@dataclass(frozen=True)
class Clearance:
    """How far the bore's envelope stays from a structure; below 0 the bore cuts it.

    It stays ``margin_mm`` away at least, with 97.5 % confidence.
    """

    label: int
    name: str
    distance_mm: Estimate
    margin_mm: float


def segments_in(labels: CtVolume) -> tuple[Segment, ...]:
    """Return the segments of a segmentation that may be structures: all that it has but bone and air.

    Those that it does not name have an empty name. Raises :class:`EndoctError` where the volume holds no labels.
    """
    least = float(labels.voxels.min())
    if least < 0 or (labels.voxels.dtype.kind == "f" and np.any(labels.voxels != np.rint(labels.voxels))):
        values = f"{least:g} among its values" if least < 0 else "numbers that are not whole"
        raise EndoctError("the labels are none", found=values, expected="a segmentation, whole numbers from 0 on")
    there = {int(value) for value in np.unique(labels.voxels)} - {0}
    if len(there) > MOST_LABELS:
        raise EndoctError("the labels are none", found=f"{len(there)} values", expected=f"at most {MOST_LABELS} labels")
    named = labels.segments or ()
    known = {value for segment in named for value in segment.values}
    unknown = tuple(Segment(value, "", (value,)) for value in sorted(there - known))
    return tuple(
        segment for segment in (*named, *unknown) if not _is_none(segment.name) and there & set(segment.values)
    )


def name_of(segment: Segment) -> str:
    """Return what a segment is called, or that it is unknown."""
    return " ".join(segment.name.split())[:LONGEST_NAME] or f"unknown label {segment.label}"


def label_doubts(labels: CtVolume) -> tuple[Doubt, ...]:
    """Return a doubt where labels of a segmentation have no name."""
    unknown = [segment.label for segment in segments_in(labels) if not segment.name]
    if not unknown:
        return ()
    numbers = ", ".join(map(str, unknown[:8])) + (" and more" if len(unknown) > 8 else "")
    said = (
        f"Labels without a name: {numbers}. Nothing says which structures they are; name them by --label-names: a "
        "table of 3D Slicer or ITK-SNAP, or 'endoct' for 1 bone, 2 facial nerve, 3 chorda tympani, 4 cochlea."
    )
    return (Doubt("labels-unnamed", said, value=float(len(unknown)), unit="labels", expected=0.0),)


def mask_of(voxels: NDArray[np.generic], segment: Segment) -> NDArray[np.bool_]:
    """Return where voxels belong to a segment."""
    return np.isin(voxels, segment.values)


def structures_near(labels: CtVolume, plan: Trajectory) -> tuple[Structure, ...]:
    """Return the structures near ``plan``, by the names that the segmentation gives them.

    Surfaces lie half way between voxels of a structure and others. Raises :class:`EndoctError` where the volume holds
    no labels, or none near.
    """
    segments = segments_in(labels)
    ends = np.array([plan.entry_mm, plan.target_mm])
    near = part_around(labels, ends, NEAR_MM)
    masks = [(segment, mask_of(near.voxels, segment)) for segment in segments]
    found = [(segment, mask) for segment, mask in masks if mask.any()]
    if not found:
        there = np.unique(near.voxels)
        raise EndoctError(
            "there is no labelled structure near the plan",
            found=f"labels {', '.join(map(str, there[:8])) or 'nowhere near'} within {NEAR_MM:g} mm",
            expected="labels other than air and bone",
            remedy="check that the labels lie in the world of the CT",
        )
    voxel = float(np.linalg.norm(labels.steps_mm, axis=1).max())
    return tuple(Structure(segment.label, _surface(near, mask), voxel, name_of(segment)) for segment, mask in found)


def clearance(pose: BorePose, structure: Structure, radius_mm: float, generator: np.random.Generator) -> Clearance:
    """Return how far the bore's envelope, a cylinder from the entry to the depth of the target, stays from a structure.

    The interval is that of axes drawn from the pose's covariance. Surfaces may lie half a voxel from where the labels
    have them. Errors of the segmentation itself are not in it.
    """
    length = pose.plan.length_mm
    to_lps = pose.bore_to_lps
    best = to_lps[None, :3, 3], to_lps[None, :3, 2]
    points = structure.points_mm
    apart = _beyond(points, *best, radius_mm, length)[0]
    points = points[apart <= apart.min() + NEAREST_MM]
    entries, directions = sampled_axes(pose, LIKELY_AXES, generator)
    distances = np.concatenate(
        [
            _beyond(points, entries[some], directions[some], radius_mm, length).min(axis=1)
            for some in (slice(first, first + AXES_AT_A_TIME) for first in range(0, LIKELY_AXES, AXES_AT_A_TIME))
        ]
    )
    distances = distances + structure.voxel_mm * generator.uniform(-0.5, 0.5, LIKELY_AXES)
    low, high = (float(value) for value in np.quantile(distances, [(1 - LEVEL) / 2, (1 + LEVEL) / 2]))
    return Clearance(structure.label, structure.name, Estimate(float(apart.min()), low, high), low)


def depth_of_passing(pose: BorePose, structure: Structure) -> float:
    """Return the depth, mm from the entry, at which the bore's axis comes nearest to a structure."""
    to_lps, points = pose.bore_to_lps, structure.points_mm
    local = (points - to_lps[:3, 3]) @ to_lps[:3, :3]
    apart = np.hypot(local[:, 0], local[:, 1])
    return float(local[apart <= apart.min() + structure.voxel_mm / 2, 2].mean())  # steps of voxels are flat


def _beyond(
    points: Coordinates, entries: Coordinates, directions: Coordinates, radius_mm: float, length_mm: float
) -> Coordinates:
    """Return the distances (n_axes, n_points) of points (n_points, 3) to cylinders, < 0 inside."""
    from_entry = points[None] - entries[:, None]
    along = np.einsum("apk,ak->ap", from_entry, directions)
    aside = np.sqrt(np.maximum(np.einsum("apk,apk->ap", from_entry, from_entry) - along**2, 0)) - radius_mm
    past = np.maximum(-along, along - length_mm)
    outside = np.hypot(np.maximum(aside, 0), np.maximum(past, 0))
    return np.asarray(outside + np.minimum(np.maximum(aside, past), 0))


def _surface(labels: CtVolume, mask: NDArray[np.bool_]) -> Coordinates:
    """Return the surface of a structure."""
    index = marching_cubes(np.pad(mask, 1).astype(np.float32), 0.5)[0] - 1
    return np.asarray(index.astype(np.float64) @ labels.steps_mm + labels.origin_mm)


def _is_none(name: str) -> bool:
    words = set(_words(name).lower().split())
    return bool(words & NO_STRUCTURES) and words <= NO_STRUCTURES | OF_THESE


def _words(name: str) -> str:
    """Return a name with blanks in place of other separators, as in "Facial_Nerve_L"."""
    return re.sub(r"[\W_]+", " ", name).strip()
