"""Where poses are searched and eyes trained: on the CPU, or on a CUDA device by torch."""

from typing import Literal

from endoct.base.errors import EndoctError

Device = Literal["cpu", "cuda"]
"""Devices are named as torch names them. "cpu" is the reference."""


def check_device(device: Device) -> None:
    """Raise :class:`EndoctError` where there is no such device. Loads nothing for "cpu"."""
    if device == "cpu":
        return
    import torch

    if not torch.cuda.is_available():
        raise EndoctError("there is no CUDA device", found=device, expected="cpu", remedy="leave out device='cuda'")
