"""A-scans of a whole pullback beside each other, to judge what stays at one depth."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from endoct.modalities.oct.face.faces import Faces
from endoct.modalities.oct.face.slices import SliceFeatures
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.stitching.arrays import Coordinates, Image
from endoct.stitching.ranks import ranked

POOLED_SLICES = 40  # whose worth of A-scans is enough to judge a recording by
SECTORS, PARTS = 12, 4  # of a turn and of the pullback
FEWEST_ASCANS = 6  # of one sector and part


@dataclass(frozen=True, eq=False)
class Pool:
    """A-scans (n, n_depth) of all slices, with the depths of face and nominal wall (n,), and their ``part`` (n,).

    A part is one sector of the turn in one part of the pullback: sector + ``SECTORS`` · part of the pullback.
    """

    ascans: Image
    face_mm: Coordinates
    wall_mm: Coordinates
    part: NDArray[np.intp]


def pooled(slices: Sequence[SliceFeatures], faces: Faces, acquisition: OctAcquisition) -> Pool:
    """Return every n-th of all the A-scans of slices that show the face, ``POOLED_SLICES`` slices' worth."""
    step = max(1, len(slices) // POOLED_SLICES)
    ascans, face_mm, wall_mm, part, first = [], [], [], [], 0
    for i, features in enumerate(slices):
        chosen = slice(first, None, step)
        first = (first - len(features.ascans)) % step
        if faces.bridged[i]:
            continue
        angle, circle = features.ascan_angle_rad[chosen], faces.capillary.circle(i)
        ascans.append(features.ascans[chosen].copy())  # a view would hold them all
        face_mm.append(circle.depth_mm(angle))
        wall_mm.append(replace(circle, radius_mm=acquisition.bore_radius_mm).depth_mm(angle))
        part.append((angle / (2 * np.pi) * SECTORS).astype(np.intp) % SECTORS + SECTORS * (i * PARTS // len(slices)))
    return Pool(np.concatenate(ascans), np.concatenate(face_mm), np.concatenate(wall_mm), np.concatenate(part))


def medians(samples: Image) -> Image:
    """Return the median of every column without NaN, float32 (n_columns,); columns of too few are interpolated."""
    finite = np.isfinite(samples)
    count = np.count_nonzero(finite, axis=0)
    middle = ranked(samples, finite, np.maximum((count - 1) // 2, 0))
    known = np.flatnonzero(count >= FEWEST_ASCANS)
    if not known.size:
        return np.zeros(samples.shape[1], np.float32)
    return np.asarray(np.interp(np.arange(count.size), known, middle[known]), dtype=np.float32)
