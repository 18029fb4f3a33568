"""What looks like a pullback: grey pages layered along depth, whose last A-scan continues in the first."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.modalities.contract import Preview, Sniff
from endoct.modalities.oct.depth_order import UPSIDE_DOWN, share_brightening
from endoct.modalities.oct.opening import LEAST_ASCANS, LEAST_DEPTH
from endoct.modalities.recording import open_stack, some_frames
from endoct.stitching.arrays import Image
from endoct.stitching.errors import EndoctError

SIDE_PX = 512
"""Pages are judged at this size at most."""
SECTORS = 16
"""Of a turn, within which layers are straight enough."""
LAYERED = 1.25
"""How much more the rows of a sector (depth) differ among themselves than its columns (θ); photographs have 0.5–0.7."""
LAYERED_THROUGHOUT = 4.0
"""The same of whole pages, where nothing else speaks for B-scans."""
ENDS_ALIKE = 0.6
"""Correlation of the first and the last A-scans of a turn; those of photographs have 0.3 at most."""
ENDS_SHOW = 0.25
"""Contrast of these A-scans over that of the page, so that dark margins do not count."""


def sniff_pullback(path: Path) -> Sniff:
    """Claim a stack of grey pages that are layered along depth, and say whether they hold full turns."""
    try:
        stack = open_stack(path)
        if len(stack.frame_shape) != 2:
            return Sniff(False, "its pages are colour images")
        if len(stack) < 2:
            return Sniff(False, "it holds a single image, no pullback")
        rows, columns = stack.frame_shape
        if rows < LEAST_DEPTH or columns < LEAST_ASCANS:
            return Sniff(False, f"its pages of {rows} × {columns} are too small for B-scans")
        pages = some_frames(stack)
    except EndoctError as error:
        return Sniff(False, str(error))
    small = [_reduced(page) for page in pages]
    layered, turned = _layering(small), _layering([page.T for page in small])
    if max(layered, _layering_throughout(small) / LAYERED_THROUGHOUT * LAYERED) < LAYERED:
        if turned >= LAYERED and _ends_alike([page.T for page in small]):
            return Sniff(False, "its pages look like B-scans with depth from left to right; export them depth downward")
        return Sniff(False, "its pages are not layered along depth as B-scans are")
    preview = Preview(len(stack), size_in_words(columns, rows), str(stack.dtype), tuple(pages))
    up = " Depth seems to run upward in them." if np.mean([share_brightening(page.T) for page in small]) < UPSIDE_DOWN else ""
    if _ends_alike(small):
        what = "grey pages, layered along depth, whose last A-scan continues in the first, as in a full turn"
        return Sniff(True, f"{what}.{up}" if up else what, "likely", preview)
    what = "grey pages, layered along depth, but their last A-scan does not continue in the first"
    return Sniff(True, f"{what}.{up}" if up else what, "unsure", preview)


def size_in_words(n_ascans: int, n_depth: int) -> str:
    """Return the size of a B-scan with its axes named."""
    return f"{n_ascans} A-scans × {n_depth} depth samples"


def _reduced(page: NDArray[Any]) -> Image:
    rows, columns = (min(SIDE_PX, n) for n in page.shape)
    return np.asarray(cv2.resize(page.astype(np.float32), (columns, rows), interpolation=cv2.INTER_AREA), np.float32)


def _layering(pages: list[Image]) -> float:
    """Return how much more rows than columns differ within sectors; the median over the pages."""
    return float(np.median([_between_rows(page) / max(_between_rows(page.T), 1e-9) for page in pages]))


def _between_rows(page: Image) -> float:
    return float(np.mean([sector.mean(axis=1).var() for sector in np.array_split(page, SECTORS, axis=1)]))


def _layering_throughout(pages: list[Image]) -> float:
    ratios = [page.mean(axis=1).var() / max(page.mean(axis=0).var(), 1e-9) for page in pages]
    return float(np.median(ratios))


def _ends_alike(pages: list[Image]) -> bool:
    """Say whether the last columns show what the first ones do, and show something."""
    alike, shows = [], []
    for page in pages:
        width, smooth = max(2, page.shape[1] // 64), max(1, page.shape[0] // 128)
        ends = [
            cv2.blur(end.mean(axis=1, keepdims=True), (1, smooth)).ravel()
            for end in (page[:, :width], page[:, -width:])
        ]
        contrast = [float(end.std()) for end in ends]
        shows.append(min(contrast) / max(float(page.std()), 1e-9))
        alike.append(float(np.corrcoef(*ends)[0, 1]) if min(contrast) > 0 else 0.0)
    return float(np.median(alike)) >= ENDS_ALIKE and float(np.median(shows)) >= ENDS_SHOW
