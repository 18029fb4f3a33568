"""Edges of strips without what all of them show alike, made a few strips at a time and kept on disk."""

from contextlib import ExitStack
from math import prod
from typing import Protocol

import numpy as np

from endoct.base.arrays import Image, Mask
from endoct.base.compute.spool import Kept
from endoct.base.numeric.circle import gaussian

FEWEST_FOR_FIXED_PATTERN = 8
AT_A_TIME = 2**20  # samples: of a few whole strips, or of one part of all
LEAST_PART = 256  # samples: with smaller ones than that, reading them takes longer than what is done with them

Texture = tuple[Image, Mask]
"""Edges in a strip, float32 (n_rows, n_theta), 0 where not observed, and a mask of the observed samples."""


class Strips(Protocol):
    """Strips, float32 (n_rows, n_theta), all of one shape: an array of them, or what reads or makes each anew."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int, /) -> Image: ...


def keep_textures(
    textures: Kept[Texture], strips: Strips, valid: Mask | None, sigma_rows: float, sigma_columns: float
) -> None:
    """Append to ``textures`` the edges in every strip without what every row or every strip shows alike.

    Samples that are NaN or not ``valid``, bool (n, n_rows, n_theta), are not seen. Edges, not areas, say where a
    strip lies: otherwise a trace of the median frame, which the cells themselves leave in it, would pull every feed
    towards zero.
    """

    def visible_part(k: int) -> Image:
        sees = np.isfinite(strip := strips[k])
        return np.where(sees if valid is None else sees & valid[k], strip, np.nan).astype(np.float32)

    n, shape = len(strips), strips[0].shape
    group, part = max(1, AT_A_TIME // prod(shape)), max(LEAST_PART, AT_A_TIME // n)
    groups = [range(k, min(k + group, n)) for k in range(0, n, group)]
    parts = [slice(k, k + part) for k in range(0, prod(shape), part)]

    def put_away(blocks: Kept[Image], whole: bool) -> bool:
        """Return False if strips marked ``whole`` have gaps."""
        for those in groups:
            images = np.stack([_without_rows(visible_part(k), whole).ravel() for k in those])
            if whole and np.isnan(images).any():
                return False
            for part_of_all in parts:
                blocks.append(np.ascontiguousarray(images[:, part_of_all]))
        return True

    with ExitStack() as stack:  # every part of the first strips, then every part of the next
        blocks = stack.enter_context(Kept[Image]())
        whole = not np.isnan(visible_part(0)).any()
        if not put_away(blocks, whole):
            whole, blocks = False, stack.enter_context(Kept[Image]())
            put_away(blocks, whole)
        fixed = None
        if n >= FEWEST_FOR_FIXED_PATTERN:
            columns = (
                np.concatenate([blocks[at] for at in range(k, len(blocks), len(parts))]) for k in range(len(parts))
            )
            fixed = np.concatenate([_nanmedians(column.T, whole) for column in columns])
        blur = _Blur(sigma_rows, sigma_columns)
        for first in range(0, len(blocks), len(parts)):
            images = np.concatenate([blocks[first + k] for k in range(len(parts))], axis=1)
            if fixed is not None:
                images -= fixed
            for image in images.reshape(-1, *shape):
                textures.append(blur.edges(image))


def _without_rows(image: Image, whole: bool) -> Image:
    return image - _nanmedians(image, whole)[:, None]


class _Blur:
    """A blur over the samples that are seen, as far as strips see the same one after the other."""

    def __init__(self, sigma_rows: float, sigma_columns: float) -> None:
        self._sigmas = sigma_rows, sigma_columns
        self._seen: Mask | None = None
        self._share: Image

    def edges(self, image: Image) -> Texture:
        """Return ``image``, NaN where nothing is seen, without what is left of it when blurred."""
        seen = ~np.isnan(image)
        if self._seen is None or not np.array_equal(seen, self._seen):
            self._seen, self._share = seen, np.maximum(gaussian(seen.astype(np.float32), *self._sigmas), 0.01)
        edges = np.where(seen, image, np.float32(0))
        edges -= gaussian(edges, *self._sigmas) / self._share
        edges[~seen] = 0
        return edges, seen


def _nanmedians(values: Image, whole: bool) -> Image:
    """Median of every row without NaN, and 0 where there is nothing else.

    Of two in the middle the mean where the strips are ``whole``, without any NaN, else the lower.
    """
    ordered = np.array(values, order="C")
    ordered.sort(axis=1)
    if whole:
        n = ordered.shape[1]
        return np.asarray((ordered[:, (n - 1) // 2] + ordered[:, n // 2]) / 2, np.float32)
    count = np.count_nonzero(~np.isnan(ordered), axis=1)
    middle = ordered[np.arange(count.size), np.maximum((count - 1) // 2, 0)]
    return np.where(count > 0, middle, np.float32(0))
