"""What looks like a pullback: grey pages layered along depth, whose last A-scan continues in the first."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from endoct.base.arrays import Image
from endoct.base.errors import EndoctError
from endoct.modalities.acquisition import read_keys, sidecar_path, validate
from endoct.modalities.contract import Preview, Sniff
from endoct.modalities.oct.depth_order import UPSIDE_DOWN, share_brightening
from endoct.modalities.oct.opening import LEAST_DEPTH, UnstatedSpectra, open_pages
from endoct.modalities.oct.spectra.keys import LEAST_ASCANS, SpectraKeys, StatedSpectra
from endoct.modalities.reading.recording import some_frames, stated_by

SIDE_PX = 512
"""Pages are judged at this size at most."""
SECTORS = 16
"""Of a turn, within which layers are straight enough."""
LAYERED = 1.25
"""How much more depths differ among themselves than directions within a sector; photographs have 0.5 to 0.7."""
LAYERED_THROUGHOUT = 4.0
"""The same of whole B-scans, which off-axis catheters seldom reach."""
ENDS_ALIKE = 0.6
"""Correlation of the first and the last A-scans of a turn; photographs have 0.3 at most."""
ENDS_SHOW = 0.25
"""Contrast of these A-scans over that of the page, so that dark margins do not count."""


@np.errstate(over="ignore", invalid="ignore")  # of samples near the largest float
def sniff_pullback(path: Path) -> Sniff:
    """Claim a stack of grey pages that are layered along depth, and say whether they hold full turns."""
    try:
        spectra = _stated_spectra(path)
        stack = open_pages(path, spectra)
        if len(stack.frame_shape) != 2:
            return Sniff(False, "its pages are colour images")
        pages = some_frames(stack)
    except UnstatedSpectra as error:
        return Sniff(True, error.found, "likely", needs=("spectra",))
    except EndoctError as error:
        return Sniff(False, str(error))
    rows, columns = stack.frame_shape
    preview = Preview(
        len(stack), f"{columns} A-scans × {rows} depth samples", str(stack.dtype), tuple(pages), stack.remarks
    )
    if len(stack) < 2:
        return Sniff(False, "it holds a single image, no pullback", preview=preview)
    if rows < LEAST_DEPTH or columns < LEAST_ASCANS:
        return Sniff(False, f"its pages of {rows} × {columns} are too small for B-scans", preview=preview)
    bscans = [_reduced(page).T for page in pages]
    if not _is_layered(bscans):
        reason = "its pages are not layered along depth as B-scans are"
        turned = [bscan.T for bscan in bscans]
        if _is_layered(turned) and _ends_alike(turned):
            reason = "its pages look like B-scans with depth from left to right; export them with depth downward"
        return Sniff(False, reason, preview=preview)
    full_turn = _ends_alike(bscans)
    seen = "grey pages, layered along depth, whose last A-scan " + (
        "continues in the first, as in a full turn" if full_turn else "does not continue in the first"
    )
    if spectra is not None and _is_turned_around(path, spectra, pages[0]):
        seen += "; the chirp seems to be turned around: with the other chirp_gives they are sharper"
    if np.mean([share_brightening(bscan) for bscan in bscans]) < UPSIDE_DOWN:
        seen += "; they seem to be upside down: export them with depth downward"
    needs = () if spectra is None else ("spectra",)
    return Sniff(True, seen, "likely" if full_turn else "unsure", preview, needs)


def _stated_spectra(path: Path) -> SpectraKeys | None:
    """Return what the sidecar, or else the files, say of raw spectra, whether or not the rest of it is filled in."""
    keys = read_keys(path).get("spectra") or stated_by(path).keys.get("spectra")
    if keys is None:
        return None
    return validate(StatedSpectra, {"spectra": keys}, str(sidecar_path(path))).spectra


def _is_turned_around(path: Path, spectra: SpectraKeys, bscan: NDArray[Any]) -> bool:
    from endoct.modalities.oct.spectra.reading import is_sharper_turned_around

    try:
        return is_sharper_turned_around(path, spectra, bscan)
    except EndoctError:  # it is no chirp that way round
        return False


def _reduced(page: NDArray[Any]) -> Image:
    rows, columns = (min(SIDE_PX, n) for n in page.shape)
    return np.asarray(cv2.resize(page.astype(np.float32), (columns, rows), interpolation=cv2.INTER_AREA), np.float32)


def _is_layered(bscans: list[Image]) -> bool:
    """Say whether depths differ among themselves more than directions do, in sectors or in whole B-scans."""
    in_sectors = np.median([_along_depth(bscan, SECTORS) / _along_depth(bscan.T, SECTORS) for bscan in bscans])
    in_all = np.median([_along_depth(bscan, 1) / _along_depth(bscan.T, 1) for bscan in bscans])
    return bool(in_sectors >= LAYERED or in_all >= LAYERED_THROUGHOUT)


def _along_depth(bscan: Image, n_sectors: int) -> float:
    """Return the variance along depth of the means of ``n_sectors`` sectors."""
    return max(float(np.mean([sector.mean(axis=0).var() for sector in np.array_split(bscan, n_sectors)])), 1e-9)


def _ends_alike(bscans: list[Image]) -> bool:
    """Say whether the last A-scans show what the first ones do, and show something."""
    alike, contrast = [], []
    for bscan in bscans:
        n, smooth = max(2, bscan.shape[0] // 64), max(1, bscan.shape[1] // 128)
        ends = [uniform_filter1d(end.mean(axis=0), smooth) for end in (bscan[:n], bscan[-n:])]
        least = min(float(end.std()) for end in ends)
        alike.append(float(np.corrcoef(*ends)[0, 1]) if least > 0 else 0.0)
        contrast.append(least / max(float(bscan.std()), 1e-9))
    return bool(np.median(alike) >= ENDS_ALIKE and np.median(contrast) >= ENDS_SHOW)
