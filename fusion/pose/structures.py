"""What the drill must miss or reach: labelled structures near a bore, and how far its envelope stays from them."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from skimage.measure import marching_cubes

from endoct.fusion.pose.clinical import LEVEL, Estimate, sampled_axes
from endoct.fusion.pose.pose import BorePose
from endoct.modalities.ct_volume import CtVolume, part_around
from endoct.modalities.trajectory import Trajectory
from endoct.stitching.arrays import Coordinates
from endoct.stitching.errors import EndoctError

FACIAL_NERVE = 2
NAMES: Mapping[int, str] = MappingProxyType({FACIAL_NERVE: "facial nerve", 3: "chorda tympani", 4: "cochlea"})
"""Of labels; those of any other label are its number."""
NO_STRUCTURES = (0, 1)
"""Labels of air and bone."""
NEAR_MM = 15.0
"""Of the plan: structures farther away are none of the bore's."""
LIKELY_AXES, AXES_AT_A_TIME = 2000, 64
NEAREST_MM = 3.0
"""Beyond the nearest point of a structure, no other is nearest for any axis that is likely."""


@dataclass(frozen=True, eq=False)
class Structure:
    """A labelled structure: ``points_mm`` (n, 3) LPS on its surface, about a voxel of ``voxel_mm`` apart."""

    label: int
    points_mm: Coordinates
    voxel_mm: float

    @property
    def name(self) -> str:
        """What the label stands for, else its number."""
        return name_of(self.label)


@dataclass(frozen=True)
class Clearance:
    """How far the bore's envelope stays from a structure; < 0: the bore cuts it. ``margin_mm``: at least, at 97.5 %."""

    label: int
    name: str
    distance_mm: Estimate
    margin_mm: float


def name_of(label: int) -> str:
    """Return what a label stands for, else its number."""
    return NAMES.get(label, f"label {label}")


def structures_near(labels: CtVolume, plan: Trajectory) -> tuple[Structure, ...]:
    """Return the structures near ``plan``. Raises :class:`EndoctError` where the volume holds no labels, or none near.

    Surfaces lie half way between voxels of a structure and others.
    """
    least = float(labels.voxels.min())
    if least < 0 or (labels.voxels.dtype.kind == "f" and np.any(labels.voxels != np.rint(labels.voxels))):
        values = f"{least:g} among its values" if least < 0 else "numbers that are not whole"
        raise EndoctError("the labels are none", found=values, expected="a segmentation, whole numbers from 0 on")
    ends = np.array([plan.entry_mm, plan.target_mm])
    near = part_around(labels, ends, NEAR_MM)
    there = np.unique(near.voxels)
    found = [int(label) for label in there if label not in NO_STRUCTURES]
    if not found:
        raise EndoctError(
            "there is no labelled structure near the plan",
            found=f"labels {', '.join(map(str, there[:8])) or 'nowhere near'} within {NEAR_MM:g} mm",
            expected="labels other than 0, air, and 1, bone",
            remedy="check that the labels lie in the world of the CT",
        )
    voxel = float(np.linalg.norm(labels.steps_mm, axis=1).max())
    return tuple(Structure(label, _surface(near, label), voxel) for label in found)


def clearance(pose: BorePose, structure: Structure, radius_mm: float, generator: np.random.Generator) -> Clearance:
    """Return how far the bore's envelope, a cylinder from the entry to the depth of the target, stays from a structure.

    The interval is that of axes drawn as the pose's covariance has them, with surfaces up to half a voxel from where
    the labels have them. What the segmentation itself gets wrong is not in it.
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


def depth_beside(pose: BorePose, structure: Structure) -> float:
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


def _surface(labels: CtVolume, label: int) -> Coordinates:
    """Return the surface of a structure."""
    index = marching_cubes(np.pad(labels.voxels == label, 1).astype(np.float32), 0.5)[0] - 1
    return np.asarray(index.astype(np.float64) @ labels.steps_mm + labels.origin_mm)
