"""The small motion between two strips, to a fraction of a sample, by least squares on the strips themselves."""

from dataclasses import dataclass

import numpy as np

from endoct.stitching.arrays import Coordinates, Image, Mask
from endoct.stitching.compiled import compiled
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
    middle = (n_rows - 1) / 2
    # what moves from row k to k − rows does so on average at the row between them
    from_middle = ((np.arange(n_rows) - start.rows[0] / 2 - middle) / middle).astype(np.float32)
    layers = np.dstack([b, _slope(b, 0), _slope(b, 1), (~seen_b).astype(np.float32)])
    first = np.concatenate([start.rows, start.columns, [start.stretch]])
    motion = first
    off, fits = np.empty((n_rows, n_theta), np.float32), np.empty((n_rows, n_theta), np.bool_)
    gradients = np.empty((2, n_rows, n_theta), np.float32)
    for _ in range(MOST_ITERATIONS):
        rows, columns = (motion[:3] @ waves).astype(np.float32), (motion[3:6] @ waves).astype(np.float32)
        _compare(a, seen_a, layers, rows, columns, np.float32(motion[6]) * from_middle, off, fits, gradients)
        if fits.sum() < 0.02 * fits.size:
            return start
        scale = max(1e-6, robust_sigma(off[fits][::4]))
        # every wave depends on the column alone, so sums over rows are taken first
        of_pairs, of_off = _sums(off, fits, gradients, from_middle, 1 / (2 * scale))
        effects = [waves, waves, waves[:1]]
        normal = np.block(
            [[(left * of_pairs[i, j]) @ right.T for j, right in enumerate(effects)] for i, left in enumerate(effects)]
        )
        pull = np.concatenate([wave @ sums for wave, sums in zip(effects, of_off, strict=True)])
        if not np.trace(normal) > 0:  # nothing in view shows a motion
            return start
        change = np.linalg.solve(normal + 1e-6 * np.trace(normal) * np.eye(7), pull)
        motion = motion + change
        if np.abs(motion - first).max() > 0.05 * max(n_rows, n_theta / 4):
            return start
        if np.abs(change).max() < CONVERGED:
            break
    return Motion(motion[:3], motion[3:6], float(motion[6]))


@compiled
def _compare(
    a: Image,
    seen_a: Mask,
    layers: Image,
    rows: Image,
    columns: Image,
    stretched: Image,
    off: Image,
    fits: Mask,
    gradients: Image,
) -> None:
    """Write by how much ``a`` differs from what is moved onto it, where both are seen, and how that would change.

    ``layers`` (n_rows, n_theta, 4): what is moved, its slopes along rows and columns, and where it is not seen.
    """
    n_rows, n_theta = a.shape
    left, beside, share = np.empty(n_theta, np.int64), np.empty(n_theta, np.int64), np.empty(n_theta, np.float32)
    for j in range(n_theta):
        column = np.float32(j) - columns[j]
        whole = np.floor(column)
        left[j], share[j] = int(whole) % n_theta, column - whole
        beside[j] = (left[j] + 1) % n_theta
    for k in range(n_rows):
        for j in range(n_theta):
            fits[k, j] = False
            off[k, j] = 0.0
            gradients[0, k, j] = 0.0
            gradients[1, k, j] = 0.0
            row = np.float32(k) - rows[j] - stretched[k]
            if not (seen_a[k, j] and 0 <= row <= n_rows - 1):
                continue
            top = int(row)
            below = min(top + 1, n_rows - 1)
            down, right = row - np.float32(top), share[j]
            up, close = np.float32(1) - down, np.float32(1) - right
            w00, w01, w10, w11 = up * close, up * right, down * close, down * right
            one, two = layers[top, left[j]], layers[top, beside[j]]
            three, four = layers[below, left[j]], layers[below, beside[j]]
            if w00 * one[3] + w01 * two[3] + w10 * three[3] + w11 * four[3] > 0:
                continue
            fits[k, j] = True
            off[k, j] = a[k, j] - (w00 * one[0] + w01 * two[0] + w10 * three[0] + w11 * four[0])
            for slope in range(2):
                m = slope + 1
                gradients[slope, k, j] = -(w00 * one[m] + w01 * two[m] + w10 * three[m] + w11 * four[m])


@compiled
def _sums(
    off: Image, fits: Mask, gradients: Image, from_middle: Image, per_scale: float
) -> tuple[Coordinates, Coordinates]:
    """Return sums over rows, with Cauchy weights: of gradients in pairs (3, 3, n_theta), and with ``off`` (3, n_theta).

    The third gradient is that of a stretch along the rows.
    """
    n_rows, n_theta = off.shape
    of_pairs, of_off = np.zeros((3, 3, n_theta)), np.zeros((3, n_theta))
    for k in range(n_rows):
        share = from_middle[k]
        for j in range(n_theta):
            if not fits[k, j]:
                continue
            weight = 1 / (1 + (off[k, j] * per_scale) ** 2)
            along, across = gradients[0, k, j], gradients[1, k, j]
            of_pairs[0, 0, j] += weight * along * along
            of_pairs[0, 1, j] += weight * along * across
            of_pairs[0, 2, j] += weight * along * along * share
            of_pairs[1, 1, j] += weight * across * across
            of_pairs[1, 2, j] += weight * across * along * share
            of_pairs[2, 2, j] += weight * along * along * share * share
            of_off[0, j] += weight * along * off[k, j]
            of_off[1, j] += weight * across * off[k, j]
            of_off[2, j] += weight * along * share * off[k, j]
    for j in range(n_theta):
        of_pairs[1, 0, j], of_pairs[2, 0, j] = of_pairs[0, 1, j], of_pairs[0, 2, j]
        of_pairs[2, 1, j] = of_pairs[1, 2, j]
    return of_pairs, of_off


def _slope(image: Image, axis: int) -> Image:
    if axis == 1:
        return np.asarray((np.roll(image, -1, axis=1) - np.roll(image, 1, axis=1)) / 2, dtype=np.float32)
    return np.asarray(np.gradient(image, axis=0), dtype=np.float32)
