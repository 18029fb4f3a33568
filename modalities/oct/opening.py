"""Pullbacks on disk: the stream of their B-scans."""

from pathlib import Path

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.modalities.contract import Frame, inward_positions_mm
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.spectra.keys import COUNTS_PER_DB, LEAST_ASCANS, LEAST_SAMPLES, SpectraKeys
from endoct.modalities.oct.spectra.recognising import seems_spectra
from endoct.modalities.reading.numbering import positions_along
from endoct.modalities.reading.recording import ImageStack, open_stack
from endoct.modalities.reading.remarks import NONE, Remarks
from endoct.modalities.stated import on_stated

LEAST_DEPTH = LEAST_SAMPLES // 2
FARTHEST_WALL = 10.0  # from the capillary, in depths of a B-scan; beyond that, nothing could be seen of the bore


class UnstatedSpectra(EndoctError):
    """A recording of raw spectra, as it seems, which its sidecar does not say."""


def open_pages(path: Path, spectra: SpectraKeys | None, device: str | None = None) -> ImageStack:
    """Open a stack of B-scans (depth, A-scan), or one that is made of raw ``spectra`` page by page, on ``device``.

    Raises :class:`EndoctError` where there is nothing to read.
    """
    if spectra is not None:
        from endoct.modalities.oct.spectra.reading import open_spectra  # which loads a compiler

        return open_spectra(path, spectra, device)
    try:
        return open_stack(path).grey()
    except EndoctError:
        if (why := seems_spectra(path)) is None:
            raise
        remedy = "state them in a table 'spectra' of the sidecar"
        raise UnstatedSpectra(f"{path} holds no B-scans", found=why, remedy=remedy) from None


class Pullback:
    """A pullback as a stream: sized, indexable, picklable; ``stream[i].samples`` is one B-scan (A-scan, depth).

    Of raw spectra it is made on ``device``, as torch names it; None: on the CPU, without torch.
    Raises :class:`EndoctError` where the file holds no stack of B-scans.
    """

    def __init__(self, path: Path, acquisition: OctAcquisition, device: str | None = None) -> None:
        self._stack: ImageStack = open_pages(path, acquisition.spectra, device)
        self._on_stated = on_stated(path, acquisition)
        if acquisition.spectra is not None:
            acquisition = acquisition.model_copy(update={"intensity": "log", "db_per_count": 1 / COUNTS_PER_DB})
        self._on_places = NONE
        if acquisition.positions_mm is None:
            along_mm, self._on_places = positions_along(self._stack.along, acquisition.pullback_pitch_mm)
            acquisition = acquisition.model_copy(update={"positions_mm": along_mm})
        self._acquisition = acquisition
        shape = self._stack.frame_shape
        if len(shape) != 2 or shape[0] < LEAST_DEPTH or shape[1] < LEAST_ASCANS:
            raise EndoctError(
                f"{path} holds no B-scans",
                found=f"pages of {' × '.join(map(str, shape))} samples",
                expected=f"grey pages of (depth, A-scan), at least {LEAST_DEPTH} × {LEAST_ASCANS}",
                remedy="export the pullback as one page a slice, depth downward, one turn from left to right",
            )
        gap_mm = (acquisition.bore_diameter_mm - acquisition.capillary_outer_diameter_mm) / 2
        depth_mm = shape[0] * acquisition.mm_per_px
        if gap_mm > FARTHEST_WALL * depth_mm:
            raise EndoctError(
                f"the bore's wall lies far beyond what the B-scans of {path} show",
                found=f"{gap_mm:.3g} mm from capillary to wall, B-scans {depth_mm:.3g} mm deep",
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
    def acquisition(self) -> OctAcquisition:
        """The checked sidecar."""
        return self._acquisition

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
