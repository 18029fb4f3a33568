"""The small motion between two strips, to a fraction of a sample, by least squares on the strips themselves."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.compute.compiled import compiled
from endoct.base.numeric.least_squares import solve
from endoct.base.numeric.ranks import robust_sigma

Texture = tuple[Image, Mask]
"""Edges in a strip, float32 (n_rows, n_theta), 0 where not observed, and a mask of the observed samples."""

MOST_ITERATIONS = 8
CONVERGED = 0.01
BLOCK = 16
"""Columns that are tested together for lying between the same two rows."""


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
    waves = _waves(n_theta)
    middle = (n_rows - 1) / 2
    # what moves from row k to k − rows does so on average at the row between them
    from_middle = ((np.arange(n_rows) - start.rows[0] / 2 - middle) / middle).astype(np.float32)
    n_layers = 3 if seen_b.all() else 4  # the last says what is not seen
    layers = np.empty((n_layers, n_rows, n_theta + 1), np.float32)
    turned = np.empty((n_layers, n_rows, n_theta), np.float32)
    _lay(b, seen_b, layers)
    first = np.concatenate([start.rows, start.columns, [start.stretch]])
    motion = first
    off, fits = np.empty((n_rows, n_theta), np.float32), np.empty((n_rows, n_theta), np.bool_)
    gradients, some = np.empty((2, n_rows, n_theta), np.float32), np.empty(off.size // 4 + 1, np.float32)
    for _ in range(MOST_ITERATIONS):
        rows, columns = (motion[:3] @ waves).astype(np.float32), (motion[3:6] @ waves).astype(np.float32)
        stretched = np.float32(motion[6]) * from_middle
        _turn(layers, columns, _reached(rows, stretched), turned)
        _compare((a, seen_a), turned, rows, stretched, off, fits, gradients)
        n_fitting = _some(off, fits, some)
        if n_fitting < 0.02 * fits.size:
            return start
        scale = max(1e-6, robust_sigma(some[: (n_fitting + 3) // 4]))
        normal, change = _equations(off, fits, gradients, from_middle, 1 / (2 * scale), waves)
        trace = np.trace(normal)
        if not trace > 0:  # nothing in view shows a motion
            return start
        normal.flat[:: len(normal) + 1] += 1e-6 * trace
        solve(normal, change)
        motion = motion + change
        if not np.abs(motion - first).max() <= 0.05 * max(n_rows, n_theta / 4):  # nor where it is not finite
            return start
        if np.abs(change).max() < CONVERGED:
            break
    return Motion(motion[:3], motion[3:6], float(motion[6]))


@compiled
def _reached(rows: Image, stretched: Image) -> tuple[int, int]:
    """Return the first and last row of the range that ``rows`` moves onto another strip."""
    least, most = _range(rows)
    first = last = -int(np.floor(most + stretched[0]))
    for k in range(stretched.size):
        first = min(first, int(np.floor(np.float32(k) - most - stretched[k])))
        last = max(last, int(np.floor(np.float32(k) - least - stretched[k])) + 1)
    return max(first, 0), min(last, stretched.size - 1)


@compiled
def _range(rows: Image) -> tuple[np.float32, np.float32]:
    least = most = rows[0]
    for j in range(1, rows.size):
        least, most = min(least, rows[j]), max(most, rows[j])
    return least, most


@compiled
def _turn(layers: Image, columns: Image, reached: tuple[int, int], turned: Image) -> None:
    """Write ``layers`` (n, n_rows, n_theta + 1) moved by ``columns`` (n_theta,); their last column is the first again.

    Only rows that are ``reached`` are. Columns that move by equally many whole ones are worked on together, as vectors.
    """
    n_theta = columns.size
    left, share = np.empty(n_theta, np.int64), np.empty(n_theta, np.float32)
    for j in range(n_theta):
        column = np.float32(j) - columns[j]
        whole = np.floor(column)
        left[j], share[j] = int(whole) % n_theta, column - whole
    first = 0
    while first < n_theta:
        last = first + 1
        while last < n_theta and left[last] == left[last - 1] + 1:
            last += 1
        begin, n, right = left[first], last - first, share[first:last]
        for m in range(layers.shape[0]):
            for k in range(reached[0], reached[1] + 1):
                line, beside = layers[m, k, begin : begin + n], layers[m, k, begin + 1 : begin + 1 + n]
                to = turned[m, k, first:last]
                for i in range(n):
                    to[i] = (np.float32(1) - right[i]) * line[i] + right[i] * beside[i]
        first = last


@compiled
def _compare(
    texture: Texture, turned: Image, rows: Image, stretched: Image, off: Image, fits: Mask, gradients: Image
) -> None:
    """Write by how much ``texture`` differs from what is moved onto it, and how that would change.

    ``turned`` (n, n_rows, n_theta) is moved by ``rows``. Its layers are an image, the slopes of that along rows and
    columns, and, unless all of it is observed, where it is not. ``fits`` says where both are observed; elsewhere zeros
    are written. Samples between the same two rows are worked on together.
    """
    a, seen_a = texture
    n_rows, n_theta = a.shape
    row, last_row = np.empty(n_theta, np.float32), np.float32(n_rows - 1)
    n_blocks = n_theta // BLOCK
    least, most = np.empty(n_blocks, np.float32), np.empty(n_blocks, np.float32)
    for block in range(n_blocks):
        of_block = rows[block * BLOCK : (block + 1) * BLOCK]
        least[block], most[block] = _range(of_block)
    for k in range(n_rows):
        for j in range(n_theta):
            row[j] = np.float32(k) - rows[j] - stretched[k]
        first = 0
        while first < n_theta:
            top = int(np.floor(row[first]))
            lowest, beyond = np.float32(top), np.float32(top + 1)
            last = first + 1
            while last < n_theta and lowest <= row[last] < beyond:
                last += 1
                while last % BLOCK == 0 and last // BLOCK < n_blocks:
                    block = last // BLOCK
                    if not lowest <= np.float32(k) - most[block] - stretched[k]:
                        break
                    if not np.float32(k) - least[block] - stretched[k] < beyond:
                        break
                    last += BLOCK
            here = slice(first, last)
            if 0 <= top < n_rows:
                # the last row is reached exactly, or not at all
                below, count = min(top + 1, n_rows - 1), fits[k, here]
                if turned.shape[0] > 3:
                    hidden = turned[3, top, here], turned[3, below, here]
                    _count(seen_a[k, here], hidden[0], hidden[1], row[here], top, last_row, count)
                else:
                    _count_reached(seen_a[k, here], row[here], last_row, count)
                _blend(turned[0, top, here], turned[0, below, here], row[here], top, count, off[k, here])
                _take_from(a[k, here], count, off[k, here])
                for m in range(2):
                    slope = gradients[m, k, here]
                    _blend(turned[1 + m, top, here], turned[1 + m, below, here], row[here], top, count, slope)
            else:
                off[k, here], fits[k, here], gradients[:, k, here] = 0, False, 0
            first = last


@compiled
def _count(
    observed: Mask, hidden: Image, hidden_below: Image, row: Image, top: int, last_row: np.float32, counts: Mask
) -> None:
    """Mark the observed samples that lie between two rows that are not hidden."""
    for i in range(row.size):
        down = row[i] - np.float32(top)
        share = (np.float32(1) - down) * hidden[i] + down * hidden_below[i]
        counts[i] = observed[i] & (row[i] <= last_row) & (share <= 0)


@compiled
def _count_reached(observed: Mask, row: Image, last_row: np.float32, counts: Mask) -> None:
    """Mark the observed samples that lie between two rows."""
    for i in range(row.size):
        counts[i] = observed[i] & (row[i] <= last_row)


@compiled
def _blend(above: Image, below: Image, row: Image, top: int, counts: Mask, blended: Image) -> None:
    """Write what lies between two rows, of which the first is ``top``; 0 where it does not count."""
    for i in range(row.size):
        down = row[i] - np.float32(top)
        between = (np.float32(1) - down) * above[i] + down * below[i]
        blended[i] = between if counts[i] else np.float32(0)


@compiled
def _take_from(whole: Image, counts: Mask, part: Image) -> None:
    """Replace ``part`` by what it leaves of ``whole``; 0 where it does not count."""
    for i in range(part.size):
        left = whole[i] - part[i]
        part[i] = left if counts[i] else np.float32(0)


@compiled
def _some(off: Image, fits: Mask, some: Image) -> int:
    """Write every fourth of the differences that fit to ``some``; return how many fit."""
    count = 0
    for k in range(off.shape[0]):
        n_fitting = 0
        for j in range(fits.shape[1]):
            n_fitting += fits[k, j]
        if n_fitting == fits.shape[1]:
            every = off[k, -count % 4 :: 4]
            begin = (count + 3) // 4
            for j in range(every.size):
                some[begin + j] = every[j]
            count += n_fitting
        elif n_fitting:
            for j in range(off.shape[1]):
                if fits[k, j]:
                    if count % 4 == 0:
                        some[count // 4] = off[k, j]
                    count += 1
    return count


@compiled
def _equations(
    off: Image, fits: Mask, gradients: Image, from_middle: Image, per_scale: float, waves: Coordinates
) -> tuple[Coordinates, Coordinates]:
    """Return the equations of a change of the motion, (7, 7) and (7,), with Cauchy weights.

    The third gradient is that of a stretch along the rows, the same all around. As every wave depends on the column
    alone, sums over rows are taken first.
    """
    n_rows, n_theta = off.shape
    of_pairs, of_off = np.zeros((3, 3, n_theta)), np.zeros((3, n_theta))
    for k in range(n_rows):
        if not fits[k].any():  # nothing would be added
            continue
        share = from_middle[k]
        for j in range(n_theta):
            weight = 1 / (1 + (off[k, j] * per_scale) ** 2)
            along, across = -gradients[0, k, j], -gradients[1, k, j]
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
    normal, pull = np.empty((7, 7)), np.empty(7)
    for m in range(7):
        of_m, off_m = waves[m % 3], of_off[m // 3]
        pull[m] = 0
        for j in range(n_theta):
            pull[m] += of_m[j] * off_m[j]
        for n in range(m + 1):
            of_n, pairs, total = waves[n % 3], of_pairs[m // 3, n // 3], 0.0
            for j in range(n_theta):
                total += of_m[j] * pairs[j] * of_n[j]
            normal[m, n] = normal[n, m] = total
    return normal, pull


@compiled
def _lay(image: Image, observed: Mask, layers: Image) -> None:
    """Write ``image``, its slopes along rows and columns, and where it is not ``observed`` if there is a layer for it.

    The first column is there again as the last.
    """
    n_rows, n_theta = image.shape
    for k in range(n_rows):
        before, after = max(k - 1, 0), min(k + 1, n_rows - 1)
        per_row = np.float32(1 / max(after - before, 1))
        for j in range(n_theta):
            layers[0, k, j] = image[k, j]
            layers[1, k, j] = (image[after, j] - image[before, j]) * per_row
        if layers.shape[0] > 3:
            for j in range(n_theta):
                layers[3, k, j] = np.float32(0) if observed[k, j] else np.float32(1)
        for j in range(n_theta):
            layers[2, k, j] = (image[k, (j + 1) % n_theta] - image[k, j - 1]) * np.float32(0.5)
        for m in range(layers.shape[0]):
            layers[m, k, n_theta] = layers[m, k, 0]


@cache
def _waves(n_theta: int) -> Coordinates:
    """Return 1, cos θ and sin θ of every column, (3, n_theta)."""
    theta = 2 * np.pi / n_theta * np.arange(n_theta)
    waves = np.stack([np.ones(n_theta), np.cos(theta), np.sin(theta)])
    waves.flags.writeable = False
    return waves
