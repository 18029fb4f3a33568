"""Recordings of any length and size, made of a small simulated one: its frames resized and repeated, with noise."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tifffile
from numpy.typing import NDArray

from endoct.modalities.reading.recording import open_stack

Frames = Callable[[int], NDArray[Any]]
"""Returns one frame by its index."""


def recording_file(specimen: Path, side: str) -> Path:
    """Return what holds the frames of ``side`` in a simulated specimen."""
    return specimen / side / "pullback.tif" if side == "oct" else specimen / side


def resized(specimen: Path, side: str, width: int) -> tuple[int, Frames]:
    """Return how many frames a simulated recording has, and what reads one at ``width`` A-scans or columns.

    A B-scan keeps its depth samples, an image its shape.
    """
    stack = open_stack(recording_file(specimen, side))

    def frame(index: int) -> NDArray[Any]:
        image = np.ascontiguousarray(stack[index])
        rows = image.shape[0] if side == "oct" else round(width * image.shape[0] / image.shape[1])
        how = cv2.INTER_AREA if width < image.shape[1] else cv2.INTER_LINEAR
        return np.asarray(cv2.resize(image, (width, rows), interpolation=how))

    return len(stack), frame


def place_of(k: int, n: int, *, forth_and_back: bool) -> int:
    """Return which of ``n`` frames is the ``k``-th of a recording that repeats them."""
    turn, place = divmod(k, n)
    return n - 1 - place if forth_and_back and turn % 2 else place


def repeated(n: int, frame: Frames, count: int, *, forth_and_back: bool) -> Iterator[NDArray[Any]]:
    """Yield ``count`` frames of ``n``, each with noise of its own, one count up or down."""
    for k in range(count):
        image = frame(place_of(k, n, forth_and_back=forth_and_back))
        noise = np.random.default_rng(k).integers(-1, 2, image.shape)
        top = np.iinfo(image.dtype).max if image.dtype.kind == "u" else np.inf
        yield np.clip(image + noise, 0, top).astype(image.dtype)


def write_recording(specimen: Path, side: str, count: int, width: int, folder: Path, dtype: str | None = None) -> int:
    """Write a recording of ``count`` frames with its sidecar into a new ``folder``; return the bytes of its samples.

    Slices go forth and back, so that neighbours stay alike, frames from the start again. ``dtype``: of the samples;
    default: as simulated.
    """
    n, frame = resized(specimen, side, width)
    first = frame(0)
    kind = np.dtype(dtype or first.dtype)
    frames = repeated(n, frame, count, forth_and_back=side == "oct")
    n_bytes = count * first.size * kind.itemsize
    folder.mkdir(parents=True)
    shutil.copy(specimen / side / "acquisition.toml", folder)
    tifffile.imwrite(
        folder / "recording.tif",
        (one.astype(kind, copy=False) for one in frames),
        shape=(count, *first.shape),
        dtype=kind,
        photometric="rgb" if first.ndim == 3 else "minisblack",
        bigtiff=n_bytes > 2**31,
    )
    return n_bytes
