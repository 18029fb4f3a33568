"""The network of the learned eye: a small U-Net on a circle. Loads torch."""

import json
from pathlib import Path
from typing import Any, cast

import torch
from safetensors import SafetensorError
from safetensors.torch import load, save_file
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, conv2d, gelu, pad

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

    def forward(self, image: Tensor, coarser: Tensor | None = None) -> Tensor:
        """Return (batch, made, n_z, n_theta) of an image of that size, which may have one of half the size beside it.

        The channels of both together are given, first those of ``coarser``, of which each sample counts as four.
        """
        own = self.kernel.weight[:, -image.shape[1] :]
        made = conv2d(bordered(image), own, self.kernel.bias)
        if coarser is not None:
            add_from_coarser(made, bordered(coarser), self.kernel.weight[:, : coarser.shape[1]])
        made = self.norm(made)  # and let go of what is not normalised
        return torch.ops.aten.gelu_(made) if torch.is_inference_mode_enabled() else gelu(made)


def add_from_coarser(made: Tensor, bordered_coarser: Tensor, kernels: Tensor) -> None:
    """Add to ``made`` what ``kernels``, (made, coarser, 3, 3), find in a coarser image, had its samples been doubled.

    Of nine doubled samples two or more are the same, so 2 × 2 kernels do, others for even and odd rows and columns.
    """
    n_made, (n_z, n_theta) = made.shape[1], bordered_coarser.shape[2:]
    sums = kernels.new_tensor([[[1, 0, 0], [0, 1, 1]], [[1, 1, 0], [0, 0, 1]]])  # of even and odd rows: two of three
    of_four = torch.einsum("pai,qbj,mcij->pqmcab", sums, sums, kernels).flatten(0, 2)
    found = conv2d(bordered_coarser, of_four.contiguous(memory_format=torch.channels_last))
    for k in range(4):
        row, column = divmod(k, 2)
        rows, columns = slice(row, row + n_z - 2), slice(column, column + n_theta - 2)
        made[:, :, row::2, column::2] += found[:, k * n_made : (k + 1) * n_made, rows, columns]


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
        finer_images.pop()
        for layers in self.up:
            first, second = cast(nn.Sequential, layers)
            images = second(first(finer_images.pop(), images))
        logits: Tensor = self.out(images)[:, 0, :n_z]
        return logits


def bordered(image: Tensor) -> Tensor:
    """Return ``image``, (batch, channels, n_z, n_theta), with a border of one sample, in one copy.

    Around, it is the other end of the circle; along z, the first and the last row once more.
    """
    batch, channels, n_z, n_theta = image.shape
    size = batch, channels, n_z + 2, n_theta + 2
    whole = torch.empty(size, dtype=image.dtype, device=image.device, memory_format=torch.channels_last)
    whole[:, :, 1:-1, 1:-1] = image
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
