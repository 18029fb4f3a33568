"""The small motion between two strips, to a fraction of a sample, by least squares on the strips themselves."""

from dataclasses import dataclass

import cv2
import numpy as np

from endoct.stitching.arrays import Coordinates, Image, Mask
from endoct.stitching.robust import robust_sigma

MOST_ITERATIONS = 8
CONVERGED = 0.01


@dataclass(frozen=True, eq=False)
class Motion:
    """By how many rows and columns a strip sees the wall earlier than the strip before it does.

    ``rows`` and ``columns``, float64 (3,) each: mean, and the parts that go with cos θ and sin θ. ``stretch``: by how
    many rows more the last row moves than the middle one, and the first less.
    """

    rows: Coordinates
    columns: Coordinates
    stretch: float = 0.0

    @classmethod
    def even(cls, rows: float, columns: float) -> "Motion":
        """Return the motion that is the same all around."""
        return cls(np.array([rows, 0.0, 0.0]), np.array([columns, 0.0, 0.0]))


def refine_motion(a: Image, b: Image, seen_a: Mask, seen_b: Mask, start: Motion) -> Motion:
    """Return the motion that makes ``b`` fit ``a``, float32 (n_rows, n_theta), cyclic in θ, starting near it.

    What ``a`` shows at row k, column j, ``b`` shows at row k − rows(θ), column j − columns(θ). Gauss-Newton with
    Cauchy weights on the differences, so that what only one of them sees (a floor behind a cell's edge) counts
    little. Samples not seen in both are left out. Falls back on ``start`` where the answer runs away.
    """
    n_rows, n_theta = a.shape
    theta = 2 * np.pi / n_theta * np.arange(n_theta)
    waves = np.stack([np.ones(n_theta), np.cos(theta), np.sin(theta)])
    grid_rows, grid_columns = np.mgrid[:n_rows, :n_theta].astype(np.float32)
    middle = (n_rows - 1) / 2
    # what moves from row k to k − rows does so on average at the row between them
    from_middle = ((grid_rows[:, :1] - start.rows[0] / 2 - middle) / middle).astype(np.float32)
    layers = _wrapped(np.dstack([b, _slope(b, 0), _slope(b, 1), (~seen_b).astype(np.float32)]))
    first = np.concatenate([start.rows, start.columns, [start.stretch]])
    motion = first
    for _ in range(MOST_ITERATIONS):
        rows = grid_rows - (motion[:3] @ waves).astype(np.float32) - np.float32(motion[6]) * from_middle
        columns = np.mod(grid_columns - (motion[3:6] @ waves).astype(np.float32), n_theta)
        # all four layers at once; what lies outside the strip is masked below
        moved = cv2.remap(layers, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        both = seen_a & (rows >= 0) & (rows <= n_rows - 1) & (moved[..., 3] == 0)
        if both.sum() < 0.02 * both.size:
            return start
        off = np.where(both, a - moved[..., 0], 0.0)
        scale = max(1e-6, robust_sigma(off[both][::4]))
        weight = np.where(both, 1 / (1 + (off / (2 * scale)) ** 2), 0.0)
        gradients = [-moved[..., 1], -moved[..., 2], -moved[..., 1] * from_middle]
        # every wave depends on the column alone, so sums over rows are taken first
        effects = [waves, waves, waves[:1]]
        weighted = [weight * gradient for gradient in gradients]
        normal = np.block(
            [
                [
                    (left * np.einsum("kj,kj->j", of_left, gradient)) @ right.T
                    for right, gradient in zip(effects, gradients, strict=True)
                ]
                for left, of_left in zip(effects, weighted, strict=True)
            ]
        )
        pull = np.concatenate(
            [wave @ np.einsum("kj,kj->j", of, off) for wave, of in zip(effects, weighted, strict=True)]
        )
        if not np.trace(normal) > 0:  # nothing in view shows a motion
            return start
        change = np.linalg.solve(normal + 1e-6 * np.trace(normal) * np.eye(7), pull)
        motion = motion + change
        if np.abs(motion - first).max() > 0.05 * max(n_rows, n_theta / 4):
            return start
        if np.abs(change).max() < CONVERGED:
            break
    return Motion(motion[:3], motion[3:6], float(motion[6]))


def _slope(image: Image, axis: int) -> Image:
    if axis == 1:
        return np.asarray((np.roll(image, -1, axis=1) - np.roll(image, 1, axis=1)) / 2, dtype=np.float32)
    return np.asarray(np.gradient(image, axis=0), dtype=np.float32)


def _wrapped(image: Image) -> Image:
    return np.concatenate([image, image[:, :1]], axis=1)
