"""The sides of a comparison, or one recording by itself, for their figures: loads nothing that compares."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from endoct.fusion.evidence.drawn_mask import MASK_MODALITY
from endoct.modalities.contract import Picture
from endoct.stitching.arrays import Coordinates, Image, Mask
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.workbench.report.pictures import PICTURES, load_pictures


@dataclass(frozen=True, eq=False)
class SideFindings:
    """One side of a comparison.

    ``intensity``, ``depth_mm`` (None where the side has no depth), ``mask`` (cells) and ``valid`` lie on the
    comparison's grid, (n_z, n_theta); ``panorama`` is the side on its own rows; ``pictures`` of single
    frames by the frame's place in the order of ascending z.
    """

    name: str
    intensity: Image
    depth_mm: Image | None
    mask: Mask
    valid: Mask
    panorama: Panorama
    pictures: Mapping[int, tuple[Picture, ...]]

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
