"""How probably each sample of a side is a cell, as the learned eye of its modality sees it."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from endoct.base.arrays import Image
from endoct.base.compute.parallel import thread_map
from endoct.base.errors import EndoctError
from endoct.fusion.evidence.evidence import Evidence
from endoct.fusion.evidence.parallax import ParallaxRelief
from endoct.fusion.segmentation.learned.inputs import LOOKS_MM, Inputs, inputs_of, on_own_samples
from endoct.fusion.segmentation.parameters import NO_EYE, OUR_EYE

if TYPE_CHECKING:
    from endoct.fusion.segmentation.learned.network import Eye

PIECE_ROWS, OVERLAP_ROWS = 512, 128
"""A long bore is looked at in pieces, which fade into each other where they overlap."""
COARSEST_MM = 0.06
"""With samples farther apart than this an eye that was trained on finer ones is not asked."""


@dataclass(frozen=True, eq=False)
class Probability:
    """How probably each sample is a cell, float32 (n_z, n_theta).

    ``of_cell``: by all looks. ``first``: by the first of them, and ``without_depth`` by that at brightness alone; the
    same array where there is no depth.
    """

    of_cell: Image
    first: Image
    without_depth: Image


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
    return path if _loaded(path)[1].get("modality") == modality else None


def look(weights: Path, darkness: Evidence, relief: ParallaxRelief | None) -> Probability:
    """Return what the eye with ``weights`` says of a side, of its ``darkness`` and ``relief`` on the same samples.

    Each look is computed by one thread, so that sums have one order. Raises :class:`EndoctError` where the weights are
    damaged.
    """
    eye = _loaded(weights)[0]
    views = [inputs_of(darkness, relief, step_mm) for step_mm in LOOKS_MM]

    given = views if relief is None else [*views, _bare(views[0])]

    def look_at(one: Inputs) -> Image:
        return on_own_samples(_probability(eye, one), one, darkness)

    with _one_thread():
        looks = list(thread_map(look_at, given))
    of_cell = np.asarray(np.mean(looks[: len(views)], axis=0), dtype=np.float32)
    return Probability(of_cell, looks[0], looks[-1] if relief is not None else looks[0])


@contextmanager
def _one_thread() -> Iterator[None]:
    """Have torch add up in one order on any machine: each look by one thread."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def _bare(inputs: Inputs) -> Inputs:
    """Return ``inputs`` without depth."""
    channels = inputs.channels.copy()
    channels[1:3] = 0
    return Inputs(channels, inputs.z_mm)


@lru_cache(maxsize=2)
def _loaded(weights: Path) -> "tuple[Eye, dict[str, Any]]":
    from endoct.fusion.segmentation.learned.network import load_eye  # which loads torch

    try:
        return load_eye(weights)
    except (OSError, ValueError) as error:
        raise EndoctError(
            f"the learned eye {weights} cannot be read",
            found=str(error),
            expected="weights that `endoct train` made",
            remedy=f"name others, or '{OUR_EYE}' or '{NO_EYE}'",
        ) from error


def _probability(eye: "Eye", inputs: Inputs) -> Image:
    """Return the probability at the samples of ``inputs``, float32 (n_z, n_theta)."""
    import torch

    n_z = inputs.channels.shape[1]
    total, weight = np.zeros(inputs.channels.shape[1:], np.float32), np.zeros((n_z, 1), np.float32)
    for first in range(0, max(1, n_z - OVERLAP_ROWS), PIECE_ROWS - OVERLAP_ROWS):
        piece = slice(first, min(first + PIECE_ROWS, n_z))
        with torch.inference_mode():
            logits = eye(torch.from_numpy(np.ascontiguousarray(inputs.channels[None, :, piece])))
            probable = torch.sigmoid(logits)[0].numpy()
        fade = _fade(len(probable))
        total[piece] += fade * probable
        weight[piece] += fade
    return total / weight


def _fade(n: int) -> Image:
    """Return weights of the rows of a piece, float32 (n, 1), which rise and fall over ``OVERLAP_ROWS``."""
    to_end = np.minimum(np.arange(n), np.arange(n)[::-1]) + 1
    return np.asarray(np.minimum(to_end, OVERLAP_ROWS)[:, None] / OVERLAP_ROWS, np.float32)
