"""Where the batched parts of unrolling, and poses, are computed: on the CPU, or on a CUDA device by torch."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal

from endoct.base.errors import EndoctError

Device = Literal["cpu", "cuda"]
"""Devices are named as torch names them. "cpu" is the reference, which for unrolling does without torch."""


def check_device(device: Device) -> None:
    """Raise :class:`EndoctError` where there is no such device. Loads nothing for "cpu"."""
    if device == "cpu":
        return
    import torch

    if not torch.cuda.is_available():
        raise EndoctError("there is no CUDA device", found=device, expected="cpu", remedy="leave out device='cuda'")


@contextmanager
def memory_of(device: str) -> Iterator[None]:
    """Raise ``MemoryError`` where the memory of a ``device`` of torch's runs out. Loads torch."""
    import torch

    try:
        yield
    except torch.OutOfMemoryError as error:
        raise MemoryError(f"on the device {device}") from error
