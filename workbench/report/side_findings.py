"""The sides of a comparison, or one recording by itself, for their figures: loads nothing that compares.

Frames that a panorama's flags speak against are named in words.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.fusion.evidence import MASK_MODALITY
from endoct.fusion.result import CuttingPlane
from endoct.modalities.contract import Picture
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.workbench.report.pictures import PICTURES, load_pictures


@dataclass(frozen=True, eq=False)
class SideFindings:
    """One side of a comparison.

    ``intensity``, ``depth_mm`` (None where the side has no depth), ``mask`` (cells) and ``valid`` lie on the
    comparison's grid, (n_z, n_theta), and so do ``planes`` that cut the bore. ``panorama`` is the side on its own rows;
    ``pictures`` of single frames by the frame's place in the order of ascending z.
    """

    name: str
    intensity: Image
    depth_mm: Image | None
    mask: Mask
    valid: Mask
    panorama: Panorama
    pictures: Mapping[int, tuple[Picture, ...]]
    planes: tuple[CuttingPlane, ...] = ()

    @property
    def is_drawn_mask(self) -> bool:
        """Whether the side is a mask drawn by hand: it has no intensity worth showing."""
        return self.panorama.modality == MASK_MODALITY

    @property
    def frame_z_mm(self) -> Coordinates:
        """Place of every frame, float64 (n_frames,), mm, in the side's own frame; empty where unknown."""
        places = self.panorama.per_frame.get(f"{self.panorama.frame_dim}_z_mm")
        return np.empty(0) if places is None else np.asarray(places.values, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class BothSides:
    """Both sides on the common ``grid`` in A's frame: what is known of a comparison before anything is scored.

    Where they are not ``aligned``, each lies in its own frame: nothing may be overlaid.
    """

    grid: SurfaceGrid
    sides: tuple[SideFindings, SideFindings]
    aligned: bool


def alone(panorama: Panorama, pictures: Mapping[int, tuple[Picture, ...]]) -> SideFindings:
    """Return one recording as a side of its own, on its own rows; nothing of it was segmented as cells."""
    no_cells = np.zeros(panorama.grid.shape, np.bool_)
    of = panorama.intensity, panorama.depth_mm, no_cells, panorama.valid
    return SideFindings(panorama.modality, *of, panorama=panorama, pictures=pictures)


def recording_in(store: Path, panorama: Panorama) -> SideFindings:
    """Return a recording :func:`alone`, with the pictures of single frames that lie in its panorama's ``store``."""
    return alone(panorama, load_pictures(store / PICTURES).get(panorama.modality, {}))


def flagged_frames(side: SideFindings) -> list[tuple[str, Mask]]:
    """Return what every flag says of the frames it speaks against ("bridged"), and these frames, bool (n_frames,)."""
    flags = (one for _, one in sorted(side.panorama.per_frame.items()) if one.trusted_when is not None)
    return [(flag.doubt, flag.doubted) for flag in flags]


def flag_rows(side: SideFindings) -> Iterator[list[str]]:
    """Yield ["bridged", "3 of 40", "3, 17–18", "0.60, 3.40–3.60 mm"] for every flag that speaks against a frame."""
    z_mm = side.frame_z_mm
    for what, frames in flagged_frames(side):
        if not frames.any():
            continue
        where = [(int(run[0]), int(run[-1])) for run in _runs(frames)]
        places = "–"
        if z_mm.size == frames.size:
            places = ", ".join(_span(f"{z_mm[a]:.2f}", f"{z_mm[b]:.2f}") for a, b in where) + " mm"
        numbers = ", ".join(_span(str(first), str(last)) for first, last in where)
        yield [what, f"{np.count_nonzero(frames)} of {frames.size}", numbers, places]


def _runs(frames: Mask) -> list[np.ndarray[tuple[int], np.dtype[np.intp]]]:
    indices = np.flatnonzero(frames)
    return np.split(indices, np.flatnonzero(np.diff(indices) > 1) + 1)


def _span(first: str, last: str) -> str:
    return first if first == last else f"{first}–{last}"
