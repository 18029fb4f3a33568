"""Turns in a stream of A-scans: after how many of them the beam points the same way again.

A probe does not turn evenly: one rig took 14 600 to 14 800 A-scans a turn within a series. Nothing in a file of raw
spectra says where turns end. But A-scans repeat after a turn, as capillary, sheath and most of the wall do. So every
part of the stream is compared with what follows about a turn later. The lag at which they agree best is followed along
the stream, on every few A-scans at first. Where turns meet it is then measured on all A-scans.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.ndimage import gaussian_filter1d

from endoct.base.arrays import Coordinates, Image
from endoct.base.errors import EndoctError
from endoct.base.numeric.least_squares import vertex
from endoct.modalities.oct.spectra.keys import LEAST_ASCANS

Levels = Callable[[NDArray[np.intp]], Image]
"""It returns A-scans of the stream as levels (A-scan, depth), by their ascending indices, at least LEAST_ASCANS."""

A_TURN = 800
"""Number of A-scans of a turn that are compared first."""
MOST_COMPARED = 100_000
"""Greatest number of A-scans in which the usual turn is looked for."""
SHORTEST, LONGEST = 256, 200_000
"""A turn has no fewer A-scans, and no more."""
OVERLAP = 0.12
"""A stream must be longer than one turn by this part of it, so that it repeats."""
SMOOTH = 8.0
"""Where the usual turn is looked for, noise is averaged first over this standard deviation, in A-scans compared."""
APART = 0.3
"""With a smaller correlation, A-scans are another part of the turn."""
ALIKE = 0.35
"""Turns are seen where the correlation a turn later is at least this."""
FIRST = 0.8
"""The shortest lag with this part of the best correlation is one turn, and not several."""
SPREAD = 0.1
"""Turns differ from the usual one by at most this part of it."""
AROUND = 1 / 30
"""Parts of the stream are compared in a window of this standard deviation, in turns."""
STEPS_A_TURN = 48
"""Number of places in a turn at which the lag is followed."""
COLUMN_COST, MOST_COLUMN_COST = 0.02, 0.2
"""A change of the lag by one step, from place to place, costs this correlation. Any change costs at most the second:
blocks of A-scans get lost."""
NEAR = 1 / 80
"""Length that is compared on either side of where turns meet, in turns."""
ROWS = 64
"""Number of depths at which A-scans are compared."""
TOGETHER = 4096
"""Number of A-scans that are read at once, as many as a small slice has."""


@dataclass(frozen=True, eq=False)
class Turns:
    """Where the turns of a stream begin: ``starts`` float64 (n + 1,), in A-scans; the last is where the last one ends.

    ``alike`` float64 (n,): correlation of what lies around the start of each turn with the same around its end.
    """

    starts: Coordinates
    alike: Coordinates

    @property
    def lengths(self) -> Coordinates:
        """A-scans of each turn, float64 (n,)."""
        return np.diff(self.starts)


def find_turns(levels: Levels, n_ascans: int, usual: float, most: int | None = None) -> Turns:
    """Return the turns of about ``usual`` A-scans in a stream of ``n_ascans``, the first beginning with it.

    Not more than ``most`` are looked for. Raises :class:`EndoctError` where nothing repeats.
    """
    step = max(1, int(usual / A_TURN))
    coarse = _compared(levels, np.arange(0, n_ascans, step, dtype=np.intp))
    period = usual / step
    at, lag, close = _followed(coarse, period)
    starts, alike = [0.0], list[float]()
    while most is None or len(alike) < most:
        begin = starts[-1]
        end = begin + step * float(np.interp(begin / step, at, lag))
        if begin / step > at[-1] + period / STEPS_A_TURN or end > n_ascans:
            break
        end = _refined(levels, n_ascans, begin, end, step, usual)
        if end > n_ascans:
            break
        starts.append(end)
        alike.append(float(np.interp(begin / step, at, close)))
    if not alike:
        raise nothing_repeats()
    return Turns(np.array(starts), np.array(alike))


def usual_turn(levels: Levels, n_ascans: int) -> float:
    """Return after how many A-scans a stream of ``n_ascans`` repeats as a whole.

    Raises :class:`EndoctError` where it does not.
    """
    step = math.ceil(n_ascans / MOST_COMPARED)
    stream = _compared(levels, np.arange(0, n_ascans, step, dtype=np.intp))
    stream = gaussian_filter1d(stream, SMOOTH, axis=0)
    lags = np.arange(int(min(LONGEST / step, len(stream) / (1 + OVERLAP))) + 1)
    size = next_fast_len(2 * len(stream), real=True)
    product = irfft((np.abs(rfft(stream, size, axis=0)) ** 2).sum(axis=1), size)[: lags.size]
    summed = np.concatenate([[0.0], np.cumsum((stream.astype(np.float64) ** 2).sum(axis=1))])
    energy = np.sqrt(summed[len(stream) - lags] * (summed[-1] - summed[lags]))
    alike = product / np.maximum(energy, np.finfo(float).tiny)
    apart = np.flatnonzero(alike < APART)
    begin = max(SHORTEST // step, int(apart[0]) if apart.size else alike.size)
    inner = alike[1:-1]
    peaks = 1 + np.flatnonzero((inner >= alike[:-2]) & (inner >= alike[2:]))
    peaks = peaks[peaks >= begin]
    if not peaks.size or alike[peaks].max() < ALIKE:
        raise nothing_repeats()
    return float(step * peaks[np.argmax(alike[peaks] >= FIRST * alike[peaks].max())])


def nothing_repeats() -> EndoctError:
    """Return what to raise where no turns are seen."""
    return EndoctError(
        "no turns can be seen in the stream of A-scans",
        found="nothing that repeats",
        expected=f"at least {1 + OVERLAP:.2f} turns of {SHORTEST} to {LONGEST} A-scans",
        remedy="state how many A-scans a turn has, as 'ascans' in the sidecar's table 'spectra'",
    )


def _compared(levels: Levels, indices: NDArray[np.intp]) -> Image:
    """Return A-scans in :data:`ROWS` parts of depth, each less its mean over all of them, float32 (A-scan, row)."""
    parts = [_in_rows(levels(some)) for some in np.array_split(indices, max(1, indices.size // TOGETHER))]
    rows = np.concatenate(parts)
    return np.asarray(rows - rows.mean(axis=0), np.float32)


def _in_rows(levels: Image) -> Image:
    rows = min(ROWS, levels.shape[1])
    parts = levels[:, : levels.shape[1] // rows * rows].reshape(len(levels), rows, -1)
    return np.asarray(parts.mean(axis=2, dtype=np.float32))


def _followed(stream: Image, period: float) -> tuple[Coordinates, Coordinates, Coordinates]:
    """Return places along ``stream`` (A-scan, row), after how many A-scans each repeats, and how well, float64."""
    lags = np.arange(max(1, int(period * (1 - SPREAD))), math.ceil(period * (1 + SPREAD)) + 1)
    lags = lags[lags < len(stream)]
    places = np.arange(0, len(stream) - lags[0], max(1, round(period / STEPS_A_TURN)))
    sigma = AROUND * period
    energy = (stream**2).sum(axis=1)
    alike = np.full((places.size, lags.size), -1.0)
    for k, lag in enumerate(lags):
        product = np.einsum("td,td->t", stream[:-lag], stream[lag:])
        both = np.sqrt(
            gaussian_filter1d(energy[:-lag], sigma, mode="constant")
            * gaussian_filter1d(energy[lag:], sigma, mode="constant")
        )
        reached = places < product.size
        close = gaussian_filter1d(product, sigma, mode="constant") / np.maximum(both, np.finfo(np.float32).tiny)
        alike[reached, k] = close[places[reached]]
    path = _best_path(alike)
    followed = np.asarray(lags[path] + _between(alike, path), np.float64)
    return np.asarray(places, np.float64), followed, np.asarray(alike[np.arange(path.size), path], np.float64)


def _best_path(alike: Coordinates) -> NDArray[np.intp]:
    """Return for each row of ``alike`` (place, lag) the column of the path that is most alike in all, (place,)."""
    columns = np.arange(alike.shape[1])
    cost = np.minimum(COLUMN_COST * np.abs(columns[:, None] - columns), MOST_COLUMN_COST)
    came_from = np.zeros(alike.shape, np.intp)
    total = alike[0]
    for row in range(1, len(alike)):
        through = total[:, None] - cost
        came_from[row] = through.argmax(axis=0)
        total = through[came_from[row], columns] + alike[row]
    path = np.empty(len(alike), np.intp)
    path[-1] = total.argmax()
    for row in range(len(alike) - 1, 0, -1):
        path[row - 1] = came_from[row, path[row]]
    return path


def _between(alike: Coordinates, path: NDArray[np.intp]) -> Coordinates:
    """Return how far off the columns of ``path`` parabolas through ``alike`` (place, lag) peak, (place,)."""
    rows, inner = np.arange(len(path)), np.clip(path, 1, alike.shape[1] - 2)
    before, at, after = (alike[rows, inner + k] for k in (-1, 0, 1))
    peaks = (path == inner) & (before > -1) & (after > -1)
    return np.where(peaks, np.clip(vertex(before, at, after), -0.5, 0.5), 0.0)


def _refined(levels: Levels, n_ascans: int, begin: float, end: float, step: int, usual: float) -> float:
    """Return where the turn that begins at ``begin`` and ends about ``end`` ends, by all A-scans there.

    It is ``end`` where the stream ends too soon for that, or nothing there agrees best.
    """
    half, search = max(LEAST_ASCANS // 2, round(NEAR * usual)), 2 * step + 2
    first, lag = max(0, round(begin) - half), round(end) - round(begin)
    last = min(first + 2 * half, n_ascans - lag - search)
    if last - first < LEAST_ASCANS:
        return end
    here = _compared(levels, np.arange(first, last, dtype=np.intp))
    low = max(0, first + lag - search)
    there = _compared(levels, np.arange(low, last + lag + search, dtype=np.intp))
    n = len(here)
    alike = np.array([_correlation(here, there[k : k + n]) for k in range(len(there) - n + 1)])[None]
    best = np.array([int(alike.argmax())])
    if best[0] in (0, alike.shape[1] - 1):
        return end
    return begin + low - first + float(best[0] + _between(alike, best)[0])


def _correlation(a: Image, b: Image) -> float:
    both = math.sqrt(float((a**2).sum()) * float((b**2).sum()))
    return float((a * b).sum()) / both if both else -1.0
