"""Pullbacks on disk: what looks like one, and the stream of its B-scans.

Grey pages layered along depth, whose last A-scan continues in the first, look like a pullback.
"""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from endoct.base.arrays import Coordinates, Image
from endoct.base.errors import EndoctError
from endoct.modalities.acquisition import read_keys, sidecar_path, validate
from endoct.modalities.contract import Frame, Preview, Sniff, inward_positions_mm
from endoct.modalities.oct.bscan import UPSIDE_DOWN, share_brightening
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.spectra.keys import COUNTS_PER_DB, LEAST_ASCANS, LEAST_SAMPLES, SpectraKeys, StatedSpectra
from endoct.modalities.oct.spectra.reading import is_sharper_turned_around, open_spectra
from endoct.modalities.oct.spectra.vectors import seems_spectra
from endoct.modalities.reading.numbering import positions_along
from endoct.modalities.reading.recording import ImageStack, open_stack, some_frames, stated_by
from endoct.modalities.reading.remarks import NONE, Remarks
from endoct.modalities.stated import on_stated

LEAST_DEPTH = LEAST_SAMPLES // 2
FARTHEST_WALL = 10.0  # from the capillary, in depths of a B-scan; beyond that, nothing could be seen of the bore
SIDE_PX = 512
"""Pages are reduced to at most so many pixels a side to be judged."""
SECTORS = 16
"""In so many sectors of a turn, layers are straight enough."""
LAYERED = 1.25
"""Within a sector, depths differ among themselves by so much more than directions do; photographs have 0.5 to 0.7."""
LAYERED_THROUGHOUT = 4.0
"""In whole B-scans they differ by so much more, which off-axis catheters seldom reach."""
ENDS_ALIKE = 0.6
"""The first and the last A-scans of a turn correlate by at least this; those of photographs by 0.3 at most."""
ENDS_SHOW = 0.25
"""They must have this part of the page's contrast, so that dark margins do not count."""


class UnstatedSpectra(EndoctError):
    """A recording seems to hold raw spectra, which its sidecar does not say."""


def open_pages(path: Path, spectra: SpectraKeys | None) -> ImageStack:
    """Open a stack of B-scans (depth, A-scan), or one that is made of raw ``spectra`` page by page.

    Raises :class:`EndoctError` where there is nothing to read.
    """
    if spectra is not None:
        return open_spectra(path, spectra)
    try:
        return open_stack(path).grey()
    except EndoctError:
        if (why := seems_spectra(path)) is None:
            raise
        remedy = "state them in a table 'spectra' of the sidecar"
        raise UnstatedSpectra(f"{path} holds no B-scans", found=why, remedy=remedy) from None


class Pullback:
    """A pullback as a stream: sized, indexable, picklable; ``stream[i].samples`` is one B-scan (A-scan, depth).

    Raises :class:`EndoctError` where the file holds no stack of B-scans.
    """

    def __init__(self, path: Path, acquisition: OctAcquisition) -> None:
        self._stack: ImageStack = open_pages(path, acquisition.spectra)
        self._on_stated = on_stated(path, acquisition)
        if acquisition.spectra is not None:
            acquisition = acquisition.model_copy(update={"intensity": "log", "db_per_count": 1 / COUNTS_PER_DB})
        self._on_places = NONE
        if acquisition.positions_mm is None:
            along_mm, self._on_places = positions_along(self._stack.along, acquisition.pullback_pitch_mm)
            acquisition = acquisition.model_copy(update={"positions_mm": along_mm})
        self.acquisition: OctAcquisition = acquisition
        """The checked sidecar."""
        shape = self._stack.frame_shape
        if len(shape) != 2 or shape[0] < LEAST_DEPTH or shape[1] < LEAST_ASCANS:
            raise EndoctError(
                f"{path} holds no B-scans",
                found=f"pages of {' × '.join(map(str, shape))} samples",
                expected=f"grey pages of (depth, A-scan), at least {LEAST_DEPTH} × {LEAST_ASCANS}",
                remedy="export the pullback as one page a slice, depth downward, one turn from left to right",
            )
        depth_mm = shape[0] * acquisition.mm_per_px
        if acquisition.gap_mm > FARTHEST_WALL * depth_mm:
            raise EndoctError(
                f"the bore's wall lies far beyond what the B-scans of {path} show",
                found=f"{acquisition.gap_mm:.3g} mm from capillary to wall, B-scans {depth_mm:.3g} mm deep",
                remedy="check axial_pixel_mm and the diameters in the sidecar",
            )
        self.z_mm: Coordinates = inward_positions_mm(
            len(self._stack),
            pitch_mm=acquisition.pullback_pitch_mm,
            travel=acquisition.travel,
            positions_mm=acquisition.positions_mm,
        )
        places, counts = np.unique(self.z_mm, return_counts=True)
        if (counts > 1).any():
            together = np.flatnonzero(self.z_mm == places[counts > 1][0])
            raise EndoctError(
                "two slices of a pullback lie at one place",
                found=f"slices {together[0]} and {together[1]}, counted from 0",
                remedy="correct positions_mm",
            )

    @property
    def remarks(self) -> Remarks:
        """What is to be said of the files, and of the B-scans read so far."""
        return self._on_stated + self._stack.remarks + self._on_places

    @property
    def n_ascans(self) -> int:
        """A-scans of one turn."""
        return self._stack.frame_shape[1]

    @property
    def n_depth(self) -> int:
        """Samples of one A-scan."""
        return self._stack.frame_shape[0]

    def __len__(self) -> int:
        return len(self._stack)

    def __getitem__(self, index: int) -> Frame:
        return Frame(index=index, samples=self._stack[index].T, z_mm=float(self.z_mm[index]))


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
    try:
        return is_sharper_turned_around(path, spectra, bscan)
    except EndoctError:  # it is no chirp that way round
        return False


def _reduced(page: NDArray[Any]) -> Image:
    rows, columns = (min(SIDE_PX, n) for n in page.shape)
    return np.asarray(cv2.resize(page.astype(np.float32), (columns, rows), interpolation=cv2.INTER_AREA), np.float32)


def _is_layered(bscans: list[Image]) -> bool:
    """Say whether brightness differs more between depths than between directions, in sectors or in whole B-scans."""
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
