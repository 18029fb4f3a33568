"""Where to begin: the wall that the CT predicts along many axes, correlated with what a side shows.

For every axis around the plan the CT is unrolled once. A correlation over (θ, z) by Fourier transforms then tries every
turn and every depth at one go.

Control patterns are made of a side's own pieces, as they cannot be in the bone. Turned ones have every piece of the
bore where it is, but turned about the axis. So how much air there is along the bore stays as it is. Shuffled ones have
the pieces in another order as well.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage
from scipy.fft import next_fast_len

from endoct.base.arrays import Coordinates, Image
from endoct.fusion.pose.air import AirAround
from endoct.fusion.pose.observation import Observation
from endoct.fusion.pose.wall import Sense

ASIDE_MM, TILT_RAD, DEPTH_MM = 2.0, float(np.radians(4.0)), 2.0
"""How far off the plan a bore is searched for: its axis at the middle of its length, its tilt, and its ends."""
AXES_MM = 0.5
"""Distance of two axes, at their middle and at their ends."""
ROWS_MM, COLUMNS = 0.3, 48
AXES_AT_A_TIME = 32
LEAST_VARIANCE = 1e-3
SETTLED = 0.1
"""By how much one sense of θ has to correlate better than the other to settle which is right."""
PIECE_MM = 4.0
"""Mean length of the pieces of a control pattern."""
LEAST_HELD = 0.02
"""What bare rows count for when pieces are cut, as a share of the mean."""
OF_EACH_KIND = 10
SEED = 17


@dataclass(frozen=True)
class Candidate:
    """A place to begin at: ``axis`` (x, y in mm; tilt about x, y in rad), depth and turn of the side, its sense."""

    score: float
    axis: tuple[float, float, float, float]
    depth_mm: float
    turn_rad: float
    sense: Sense


@dataclass(frozen=True, eq=False)
class Pattern:
    """Air on the wall of one side in one sense, on the grid of the search: ``air`` of mean 0, and ``weight``."""

    air: torch.Tensor
    weight: torch.Tensor
    sense: Sense


def senses_of(side: Observation) -> tuple[Sense, ...]:
    """Return the senses in which a side may run."""
    return tuple(
        Sense(turning, inward)
        for turning in ((1,) if side.handed else (1, -1))
        for inward in ((1,) if side.directed else (1, -1))
    )


def pattern_of(side: Observation, sense: Sense, device: str = "cpu") -> Pattern:
    """Return the pattern of ``side`` for the search, from its outermost layer."""
    layer = side.layers[0]
    n_from = layer.air.shape[1]
    step = float(side.z_mm[1] - side.z_mm[0])
    blur = 0.6 * ROWS_MM / step, 0.6 * n_from / COLUMNS
    rows, columns = np.arange(0, side.length_mm + 1e-9, ROWS_MM) / step, np.arange(COLUMNS) * n_from / COLUMNS
    at = np.meshgrid(rows, columns, indexing="ij")

    def coarse(values: Image) -> Image:
        blurred = ndimage.gaussian_filter(values, blur, mode=("nearest", "wrap"))
        return np.asarray(ndimage.map_coordinates(blurred, at, order=1, mode="grid-wrap"), dtype=np.float32)

    weight = coarse(layer.weight)
    air = coarse(layer.air * layer.weight) / np.maximum(weight, 1e-3)
    if sense.turning < 0:
        back = -np.arange(COLUMNS) % COLUMNS
        air, weight = air[:, back], weight[:, back]
    if sense.inward < 0:
        air, weight = air[::-1], weight[::-1]
    air = np.asarray(air - (weight * air).sum() / weight.sum(), dtype=np.float32)
    return Pattern(torch.tensor(air.copy(), device=device), torch.tensor(weight.copy(), device=device), sense)


def axes_around(length_mm: float) -> Coordinates:
    """Return the axes to look along, (n, 4): x, y at the middle in mm, tilt about x and y in rad."""
    aside = _disc(ASIDE_MM, AXES_MM)
    tilts = _disc(TILT_RAD, AXES_MM / (length_mm / 2))
    return np.concatenate([np.repeat(aside, len(tilts), axis=0), np.tile(tilts, (len(aside), 1))], axis=1)


def candidates_along(
    air: AirAround, side: Observation, patterns: Sequence[Pattern], axes: Coordinates
) -> list[list[Candidate]]:
    """Return for every pattern of ``side`` the best candidate along each of ``axes`` (n, 4), best first."""
    rows = np.arange(-DEPTH_MM, air.length_mm + DEPTH_MM + ROWS_MM / 2, ROWS_MM)
    spare = patterns[0].air.shape[0] - rows.size
    if spare >= 0:  # a side as long as the plan or longer may reach beyond both its ends
        rows = np.concatenate([rows, rows[-1] + ROWS_MM * np.arange(1, spare + 2)]) - ROWS_MM * (spare + 1) / 2
    scores = np.empty((len(patterns), len(axes)))
    places = np.empty((len(patterns), len(axes)), dtype=np.intp)
    for first in range(0, len(axes), AXES_AT_A_TIME):
        some = slice(first, first + AXES_AT_A_TIME)
        wall = unrolled(air, axes[some], rows, side.radius_mm + side.layers[0].behind_mm)
        for number, like in enumerate(correlations(wall, patterns)):
            best = like.flatten(1).max(dim=1)
            scores[number, some], places[number, some] = best.values.cpu().numpy(), best.indices.cpu().numpy()
    found = []
    for number, pattern in enumerate(patterns):
        order = np.argsort(-scores[number], kind="stable")
        found.append(
            [
                Candidate(
                    float(scores[number, index]),
                    (float(axes[index, 0]), float(axes[index, 1]), float(axes[index, 2]), float(axes[index, 3])),
                    float(rows[places[number, index] // COLUMNS] + side.length_mm / 2),
                    float(places[number, index] % COLUMNS * 2 * np.pi / COLUMNS),
                    pattern.sense,
                )
                for index in order
            ]
        )
    return found


def correlations(wall: torch.Tensor, patterns: Sequence[Pattern]) -> Iterator[torch.Tensor]:
    """Yield how each pattern correlates with walls (n, n_z, n_theta) at every depth and turn, (n, depths, n_theta)."""
    n_z, n_theta = wall.shape[1:]
    size = next_fast_len(n_z, real=True), n_theta
    wall = wall - wall.mean(dim=(1, 2), keepdim=True)

    def spectrum(image: torch.Tensor) -> torch.Tensor:
        """Return a spectrum by θ and z, (…, n_theta / 2 + 1, n_z): so rows are transformed back fastest."""
        found: torch.Tensor = torch.fft.rfft2(image, s=size)
        return found.transpose(-1, -2).contiguous()

    def at_depths(product: torch.Tensor, depths: int) -> torch.Tensor:
        along = torch.fft.ifft(product)[..., :depths]  # around only at depths where all of a pattern lies on the wall
        found: torch.Tensor = torch.fft.irfft(along.transpose(-1, -2), n=n_theta)
        return found

    of_wall, of_square = spectrum(wall), spectrum(wall * wall)
    for pattern in patterns:
        depths = n_z - pattern.air.shape[0] + 1
        weight, total = spectrum(pattern.weight).conj(), float(pattern.weight.sum())
        products = [of_wall * spectrum(pattern.weight * pattern.air).conj(), of_wall * weight, of_square * weight]
        common, mean, square = (at_depths(one, depths) for one in products)
        # a wall that is all bone, or all air, is like nothing
        of_walls = (square - mean * mean / total).clamp_min(LEAST_VARIANCE * total)
        yield common / torch.sqrt(of_walls * (pattern.weight * pattern.air**2).sum().clamp_min(1e-9))


def unrolled(air: AirAround, axes: Coordinates, rows: Coordinates, radius_mm: float) -> torch.Tensor:
    """Return the share of air on cylinders about ``axes``, (n, n_z, n_theta)."""
    x, y, about_x, about_y = air.values.new_tensor(axes).T[..., None]
    from_pivot = air.values.new_tensor(rows - air.length_mm / 2)
    theta = air.values.new_tensor(2 * np.pi / COLUMNS * np.arange(COLUMNS))
    # tilts are small here: second order is 0.03 mm at the ends, less than the grid
    depth = (from_pivot + air.length_mm / 2).expand(len(axes), -1)
    middle = torch.stack([x + about_y * from_pivot, y - about_x * from_pivot, depth], dim=-1)
    ring = radius_mm * torch.stack([torch.cos(theta), torch.sin(theta), torch.zeros_like(theta)], dim=-1)
    return air.share(middle[:, :, None] + ring)


def _disc(radius: float, step: float) -> Coordinates:
    """Return the points (n, 2) of a square grid within a disc about the origin, and a little beyond."""
    line = step * np.arange(-int(radius / step) - 1, int(radius / step) + 2)
    first, second = np.meshgrid(line, line)
    inside = np.hypot(first, second) <= radius + 0.3 * step
    return np.stack([first[inside], second[inside]], axis=1)


def favours_mirror(air: AirAround, side: Observation, axis: Coordinates) -> bool | None:
    """Return whether ``side``, whose sense of θ is known, fits the mirror image along ``axis`` (4,); None if open."""
    known = {sense.turning for sense in senses_of(side)}
    senses = senses_of(replace(side, handed=False))
    patterns = [pattern_of(side, sense, str(air.values.device)) for sense in senses]
    scores = [some[0].score for some in candidates_along(air, side, patterns, axis[np.newaxis])]
    right = max(score for score, sense in zip(scores, senses, strict=True) if sense.turning in known)
    wrong = max(score for score, sense in zip(scores, senses, strict=True) if sense.turning not in known)
    return wrong > right if abs(wrong - right) >= SETTLED else None


def turned_patterns(pattern: Pattern) -> list[Pattern]:
    """Return patterns whose pieces are turned, the same ones for the same pattern."""
    rng = np.random.default_rng(SEED)
    n_pieces = _n_pieces(pattern)
    return [_rearranged(pattern, range(n_pieces), _turns(rng, pattern, n_pieces)) for _ in range(OF_EACH_KIND)]


def shuffled_patterns(pattern: Pattern) -> list[Pattern]:
    """Return patterns whose pieces are in another order and turned, the same ones for the same pattern."""
    rng = np.random.default_rng(SEED)
    n_pieces = _n_pieces(pattern)
    return [
        _rearranged(pattern, _without_neighbours(rng, n_pieces), _turns(rng, pattern, n_pieces))
        for _ in range(OF_EACH_KIND)
    ]


def _n_pieces(pattern: Pattern) -> int:
    return max(2, round(pattern.air.shape[0] * ROWS_MM / PIECE_MM))


def _turns(rng: np.random.Generator, pattern: Pattern, n_pieces: int) -> Sequence[int]:
    return [int(turn) for turn in rng.integers(pattern.air.shape[1], size=n_pieces)]


def _without_neighbours(rng: np.random.Generator, n_pieces: int) -> Sequence[int]:
    order = rng.permutation(n_pieces)
    while n_pieces > 3 and (np.diff(order) == 1).any():
        order = rng.permutation(n_pieces)
    return [int(piece) for piece in order]


def _pieces(pattern: Pattern, count: int) -> list[NDArray[np.intp]]:
    """Return the rows of ``count`` pieces, each of which holds as much of the pattern."""
    held = (pattern.weight * pattern.air**2).sum(dim=1).cpu().numpy().astype(np.float64)
    held += LEAST_HELD * held.mean() + 1e-12
    cuts = np.searchsorted(np.cumsum(held), held.sum() * np.arange(1, count) / count) + 1
    return np.split(np.arange(held.size), cuts)


def _rearranged(pattern: Pattern, order: Sequence[int], turns: Sequence[int]) -> Pattern:
    rows = _pieces(pattern, len(order))
    air, weight = (
        torch.cat([torch.roll(image[rows[piece]], turn, dims=1) for piece, turn in zip(order, turns, strict=True)])
        for image in (pattern.air, pattern.weight)
    )
    return Pattern(air, weight, pattern.sense)
