"""How probably each sample of a side is a cell, as the learned eye of its modality sees it.

The eye looks at the evidence of the side on even samples. What it says is brought back to the side's own.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.compute.parallel import thread_map
from endoct.base.errors import EndoctError
from endoct.base.numeric.ranks import robust_sigma
from endoct.fusion.evidence.evidence import Evidence, on_grid
from endoct.fusion.evidence.relief import ParallaxRelief
from endoct.fusion.geometry.placement import column_weights, resample, row_weights
from endoct.fusion.segmentation.parameters import NO_EYE, OUR_EYE

if TYPE_CHECKING:
    from endoct.fusion.segmentation.learned.network import Eye

TRAINED_MM = 0.016
"""Distance of two samples in training."""
LOOK_MM = 0.01
"""Distance of two samples in use: the eye sees cells larger then, and so the small ones too. With a second look, at
0.012 mm, the Jaccard index of 14 bores of tuning seeds differed by at most 0.005."""
COARSE_MM = 0.02
"""What brightness alone shows is looked for on samples so far apart."""
FINEST_COLUMNS = 8
"""The number of columns is a multiple of this, since the network halves them three times."""
DARKEST, BRIGHTEST = 1.5, -0.75
DEEPEST_MM, NEAREST_MM = 0.6, -0.2
ERROR_MM = 0.1
"""A standard error of depth of this size halves the trust in it."""
CHANNELS = 4
MOST_OF_WALL = 0.1
"""A sample that is darker may be a cell."""
PIECE_ROWS, OVERLAP_ROWS = 256, 32
"""A bore is looked at in pieces, which fade into each other where they overlap. The network judges a sample by the
whole piece: where pieces were half as long, it missed much of a large cell. In longer ones, what it makes of them no
longer stays in memory that is at hand."""
COARSEST_MM = 0.06
"""An eye that was trained on finer samples is not asked where samples lie farther apart than this."""


@dataclass(frozen=True, eq=False)
class Inputs:
    """What the eye looks at, on evenly spaced rows at ``z_mm`` and columns from θ = 0.

    ``channels``, float32 (``CHANNELS``, n_z, n_theta): darkness, relief over ``DEEPEST_MM``, trust in that, valid.
    """

    channels: NDArray[np.float32]
    z_mm: Coordinates


def inputs_of(darkness: Evidence, relief: ParallaxRelief | None, step_mm: float = TRAINED_MM) -> Inputs:
    """Return the inputs of the network for a side, from its ``darkness`` and ``relief`` on the same samples."""
    n_theta = FINEST_COLUMNS * max(1, round(2 * np.pi * darkness.radius_mm / step_mm / FINEST_COLUMNS))
    z_mm = np.arange(darkness.z_mm[0], darkness.z_mm[-1] + step_mm / 2, step_mm)
    even = on_grid(darkness, z_mm, n_theta)
    channels = np.zeros((CHANNELS, *even.values.shape), np.float32)
    channels[0] = np.where(even.valid, np.clip(even.values, BRIGHTEST, DARKEST), 0)
    channels[3] = even.valid
    if relief is not None:
        known = relief.known & darkness.valid

        def placed(image: Image) -> Evidence:
            values = np.where(known, image, np.float32(0))
            return on_grid(replace(darkness, values=values, valid=known), z_mm, n_theta)

        behind, error = placed(relief.relief_mm), placed(relief.error_mm)
        channels[1] = np.where(behind.valid, np.clip(behind.values, NEAREST_MM, DEEPEST_MM) / DEEPEST_MM, 0)
        channels[2] = np.where(behind.valid, ERROR_MM / (ERROR_MM + error.values), 0)
    return Inputs(channels, z_mm)


def grain(inputs: Inputs) -> float:
    """Return how much the darkness of neighbouring samples on the wall differs, as a robust standard deviation."""
    darkness, valid = inputs.channels[0], inputs.channels[3] > 0
    wall = valid & (darkness < MOST_OF_WALL)
    both = wall[:, 1:] & wall[:, :-1]
    return robust_sigma(np.diff(darkness, axis=1)[both]) if both.any() else 0.0


def on_own_samples(probable: Image, inputs: Inputs, darkness: Evidence) -> Image:
    """Return ``probable``, float32 (n_z, n_theta) at the samples of ``inputs``, at those of ``darkness``."""
    n_theta, n_own = probable.shape[1], darkness.values.shape[1]
    theta_rad = darkness.theta0_rad + 2 * np.pi / n_own * np.arange(n_own)
    step_mm = float(inputs.z_mm[1] - inputs.z_mm[0]) if inputs.z_mm.size > 1 else darkness.dz_mm
    rows = row_weights(inputs.z_mm, step_mm, darkness.z_mm, 0.0)
    columns = column_weights(n_theta, theta_rad * n_theta / (2 * np.pi), 0.0)
    whole: Mask = np.ones(probable.shape, np.bool_)
    return resample(probable, whole, rows, columns)[0]


@dataclass(frozen=True, eq=False)
class Probability:
    """How probably each sample is a cell, float32 (n_z, n_theta).

    ``without_depth`` is by a coarse look at brightness alone; None where there is no depth.
    """

    of_cell: Image
    without_depth: Image | None = None


def weights_for(modality: str, eye: str) -> Path | None:
    """Return the weights of the learned eye for panoramas of ``modality``, None where there is none.

    ``eye``: ours, none, or the path of weights, which must be for ``modality`` to be used. Raises :class:`EndoctError`
    where that is no file of weights.
    """
    if eye == NO_EYE:
        return None
    if eye == OUR_EYE:
        ours = Path(str(files(__package__))) / f"{modality}.safetensors"
        return ours if ours.is_file() else None
    path = Path(eye)
    return path if eye_of(path)[1].get("modality") == modality else None


def look(weights: Path, darkness: Evidence, relief: ParallaxRelief | None, inputs: Inputs) -> Probability:
    """Return what the eye with ``weights`` says of a side, from its ``darkness`` and ``relief`` on the same samples.

    ``inputs`` are those of both. Each piece of a look is computed by one thread, so that sums have one order. Raises
    :class:`EndoctError` where the weights are damaged.
    """
    eye = eye_of(weights)[0]
    views = [inputs] if relief is None else [inputs, inputs_of(darkness, None, COARSE_MM)]
    with _one_thread():
        return Probability(*(on_own_samples(_probability(eye, view), view, darkness) for view in views))


@contextmanager
def _one_thread() -> Iterator[None]:
    """Have torch add up in one order on any machine: each piece by one thread."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def eye_of(weights: Path) -> "tuple[Eye, dict[str, Any]]":
    """Return the eye with ``weights``, and its card. Raises :class:`EndoctError` where they cannot be read."""
    try:
        of = weights.stat()
        return _loaded(weights, (of.st_ino, of.st_size, of.st_mtime_ns))
    except (OSError, ValueError) as error:
        raise EndoctError(
            f"the learned eye {weights} cannot be read",
            found=str(error),
            expected="weights that `endoct train` made",
            remedy=f"name others, or '{OUR_EYE}' or '{NO_EYE}'",
        ) from error


@lru_cache(maxsize=2)
def _loaded(weights: Path, _: tuple[int, int, int]) -> "tuple[Eye, dict[str, Any]]":
    """Return the eye with ``weights``, read again where others have taken their place."""
    from endoct.fusion.segmentation.learned.network import load_eye  # which loads torch

    return load_eye(weights)


def _probability(eye: "Eye", inputs: Inputs) -> Image:
    """Return the probability at the samples of ``inputs``, float32 (n_z, n_theta)."""
    import torch

    n_z = inputs.channels.shape[1]
    pieces = _pieces(n_z)

    def of_piece(piece: slice) -> Image:
        with torch.inference_mode():
            logits = eye(torch.from_numpy(np.ascontiguousarray(inputs.channels[None, :, piece])))
            return np.asarray(torch.sigmoid(logits)[0].numpy())

    total, weight = np.zeros(inputs.channels.shape[1:], np.float32), np.zeros((n_z, 1), np.float32)
    for piece, probable in zip(pieces, thread_map(of_piece, pieces), strict=True):
        fade = _fade(len(probable))
        total[piece] += fade * probable
        weight[piece] += fade
    return total / weight


def _pieces(n_z: int) -> list[slice]:
    """Return rows of pieces, all equally long, that overlap by at least ``OVERLAP_ROWS``."""
    n = max(1, -((OVERLAP_ROWS - n_z) // (PIECE_ROWS - OVERLAP_ROWS)))
    length = min(PIECE_ROWS, n_z)
    return [slice(first, first + length) for first in np.linspace(0, n_z - length, n).astype(int).tolist()]


def _fade(n: int) -> Image:
    """Return weights of the rows of a piece, float32 (n, 1), which rise and fall over ``OVERLAP_ROWS``."""
    to_end = np.minimum(np.arange(n), np.arange(n)[::-1]) + 1
    return np.asarray(np.minimum(to_end, OVERLAP_ROWS)[:, None] / OVERLAP_ROWS, np.float32)
