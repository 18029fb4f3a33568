"""How probably each sample of a side is a cell, as the learned eye of its modality sees it."""

from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from endoct.base.arrays import Image
from endoct.base.errors import EndoctError
from endoct.fusion.evidence.evidence import Evidence
from endoct.fusion.evidence.parallax import ParallaxRelief
from endoct.fusion.segmentation.learned.inputs import Inputs, inputs_of, on_own_samples

if TYPE_CHECKING:
    from endoct.fusion.segmentation.learned.network import Eye

PIECE_ROWS, OVERLAP_ROWS = 512, 128
"""A long bore is looked at in pieces, which fade into each other where they overlap."""
COARSEST_MM = 0.06
"""With samples farther apart than this an eye that was trained on finer ones is not asked."""


@dataclass(frozen=True, eq=False)
class Probability:
    """How probably each sample is a cell, float32 (n_z, n_theta), by brightness and depth, and by brightness alone."""

    of_cell: Image
    without_depth: Image


def has_eye(modality: str) -> bool:
    """Say whether an eye was trained for panoramas of ``modality``."""
    return _weights(modality).is_file()


def look(modality: str, darkness: Evidence, relief: ParallaxRelief | None) -> Probability:
    """Return what the eye for ``modality`` says of a side, of its ``darkness`` and ``relief`` on the same samples.

    Computed by one thread, so that sums have one order. Raises :class:`EndoctError` where the weights are damaged.
    """
    inputs = inputs_of(darkness, relief)
    eye = _eye(modality)
    of_cell = without = _probability(eye, inputs)
    if relief is not None:
        bare = inputs.channels.copy()
        bare[1:3] = 0
        without = _probability(eye, Inputs(bare, inputs.z_mm))
    return Probability(on_own_samples(of_cell, inputs, darkness), on_own_samples(without, inputs, darkness))


def card_of(modality: str) -> dict[str, Any]:
    """Return on what the eye for ``modality`` was trained. Raises as :func:`look`."""
    return _loaded(modality)[1]


def _eye(modality: str) -> "Eye":
    return _loaded(modality)[0]


def _weights(modality: str) -> Path:
    return Path(str(files(__package__))) / f"{modality}.safetensors"


@lru_cache(maxsize=2)
def _loaded(modality: str) -> "tuple[Eye, dict[str, Any]]":
    from endoct.fusion.segmentation.learned.network import load_eye  # which loads torch

    path = _weights(modality)
    try:
        return load_eye(path)
    except (OSError, ValueError) as error:
        raise EndoctError(
            f"the learned eye {path} cannot be read", found=str(error), remedy="install endoct again"
        ) from error


def _probability(eye: "Eye", inputs: Inputs) -> Image:
    """Return the probability at the samples of ``inputs``, float32 (n_z, n_theta)."""
    import torch

    n_z = inputs.channels.shape[1]
    total, weight = np.zeros(inputs.channels.shape[1:], np.float32), np.zeros((n_z, 1), np.float32)
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        for first in range(0, max(1, n_z - OVERLAP_ROWS), PIECE_ROWS - OVERLAP_ROWS):
            piece = slice(first, min(first + PIECE_ROWS, n_z))
            with torch.inference_mode():
                logits = eye(torch.from_numpy(np.ascontiguousarray(inputs.channels[None, :, piece])))
                found = torch.sigmoid(logits)[0].numpy()
            fade = _fade(len(found))
            total[piece] += fade * found
            weight[piece] += fade
    finally:
        torch.set_num_threads(before)
    return total / weight


def _fade(n: int) -> Image:
    """Return weights of the rows of a piece, float32 (n, 1), which rise and fall over ``OVERLAP_ROWS``."""
    to_end = np.minimum(np.arange(n), np.arange(n)[::-1]) + 1
    return np.asarray(np.minimum(to_end, OVERLAP_ROWS)[:, None] / OVERLAP_ROWS, np.float32)
