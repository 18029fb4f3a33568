"""The network of the learned eye: a small U-Net on a circle. Loads torch."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import torch
from safetensors import SafetensorError
from safetensors.torch import load, save_file
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, gelu, interpolate, pad

from endoct.base.files.files import read_small

MOST_BYTES = 16_000_000
"""Weights have a megabyte."""
CHANNELS = 4
WIDTHS = (24, 48, 72, 96)
GROUPS = 8
HALVED = 2 ** (len(WIDTHS) - 1)
"""Rows and columns must divide by this, as often as the network halves them."""


class Convolution(nn.Module):
    """3 × 3 samples, around the circle of θ and, at the ends of z, with the last row once more."""

    def __init__(self, given: int, made: int) -> None:
        super().__init__()
        self.kernel = nn.Conv2d(given, made, 3)
        self.norm = nn.GroupNorm(GROUPS, made)

    def forward(self, *images: Tensor) -> Tensor:
        """Return (batch, made, n_z, n_theta) of images (batch, …, n_z, n_theta), whose channels together are given."""
        return gelu(self.norm(self.kernel(bordered(images))))


class Eye(nn.Module):
    """The logit of how probably each sample is a cell."""

    def __init__(self) -> None:
        super().__init__()
        given = (CHANNELS, *WIDTHS[:-1])
        self.down = nn.ModuleList(_twice(a, b) for a, b in zip(given, WIDTHS, strict=True))
        self.up = nn.ModuleList(_twice(WIDTHS[k + 1] + WIDTHS[k], WIDTHS[k]) for k in reversed(range(len(WIDTHS) - 1)))
        self.out = nn.Conv2d(WIDTHS[0], 1, 1)

    def forward(self, images: Tensor) -> Tensor:
        """Return logits (batch, n_z, n_theta) of (batch, channels, n_z, n_theta), n_theta a multiple of ``HALVED``."""
        n_z, finer_images = images.shape[2], []
        images = images.contiguous(memory_format=torch.channels_last)  # convolutions take half the time
        images = pad(images, (0, 0, 0, -n_z % HALVED), mode="replicate")
        for level, finer in enumerate(self.down):
            images = finer(avg_pool2d(images, 2) if level else images)
            finer_images.append(images)
        for coarser, beside in zip(self.up, finer_images[-2::-1], strict=True):
            first, second = cast(nn.Sequential, coarser)
            images = second(first(interpolate(images, scale_factor=2, mode="nearest"), beside))
        logits: Tensor = self.out(images)[:, 0, :n_z]
        return logits


def bordered(images: Sequence[Tensor]) -> Tensor:
    """Return the channels of all ``images``, (batch, …, n_z, n_theta), with a border of one sample.

    Around, it is the other end of the circle; along z, the first and the last row once more. This is one copy, where
    joining them and two paddings would be four.
    """
    batch, _, n_z, n_theta = images[0].shape
    size, like = (batch, sum(image.shape[1] for image in images), n_z + 2, n_theta + 2), images[0]
    whole = torch.empty(size, dtype=like.dtype, device=like.device, memory_format=torch.channels_last)
    first = 0
    for image in images:
        whole[:, first : first + image.shape[1], 1:-1, 1:-1] = image
        first += image.shape[1]
    whole[:, :, :, 0], whole[:, :, :, -1] = whole[:, :, :, -2], whole[:, :, :, 1]
    whole[:, :, 0], whole[:, :, -1] = whole[:, :, 1], whole[:, :, -2]
    return whole


def _twice(given: int, made: int) -> nn.Sequential:
    return nn.Sequential(Convolution(given, made), Convolution(made, made))


def save_eye(eye: Eye, path: Path, card: dict[str, Any]) -> None:
    """Write weights, as float16, and ``card``, what they were trained on, JSON-serialisable."""
    state = {name: weights.detach().half().cpu().contiguous() for name, weights in eye.state_dict().items()}
    save_file(state, path, metadata={"card": json.dumps(card)})


def load_eye(path: Path) -> tuple[Eye, dict[str, Any]]:
    """Return the network that :func:`save_eye` wrote, ready to look, and its card.

    Raises ``ValueError`` where the file holds something else, and :class:`EndoctError` where it cannot be read.
    """
    data = read_small(path, MOST_BYTES)
    try:
        state = load(data)
        header = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])
        card = json.loads(header.get("__metadata__", {}).get("card", "{}"))
        eye = Eye()
        eye.load_state_dict(state)  # copied as float32
    except (SafetensorError, RuntimeError, RecursionError) as error:
        raise ValueError(str(error).splitlines()[0]) from error
    if not isinstance(card, dict):
        raise ValueError("its card is no table")
    # as halves they are too small for sums to overflow
    if any(weights.dtype != torch.float16 or not weights.isfinite().all() for weights in state.values()):
        raise ValueError("some of its weights are no finite half floats")
    return eye.eval(), card
