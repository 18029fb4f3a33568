"""Cells of one side: thresholded evidence, cleaned on the circle."""

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field
from scipy import ndimage, sparse
from scipy.sparse.csgraph import connected_components

from endoct.fusion.evidence import Evidence, Polarity
from endoct.fusion.prepare import prepare
from endoct.fusion.threshold import li_threshold
from endoct.stitching.arrays import Mask
from endoct.stitching.circle import masked_gaussian
from endoct.stitching.errors import EndoctError
from endoct.stitching.panorama import Panorama


class SegmentParameters(BaseModel):
    """How cells are told from wall. Lengths in mm on the wall, areas in mm²."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    segment: Literal["relief", "intensity"] = Field(
        default="relief", description="what a side with depth is thresholded on; a side without has its intensity only"
    )
    relief_floor_mm: float = Field(default=0.0, description="relief below this counts as this")
    relief_cap_mm: float = Field(default=0.2, gt=0, description="relief above this counts as this")
    contrast_cap: float = Field(
        default=1.5, gt=0, description="|log| of intensity relative to the wall's above this counts as this"
    )
    smooth_mm: float = Field(default=0.015, ge=0, description="sigma of the smoothing before the threshold")
    open_mm: float = Field(default=0.03, ge=0, description="cells narrower than twice this are removed")
    close_mm: float = Field(default=0.03, ge=0, description="gaps in cells narrower than twice this are closed")
    smallest_mm2: float = Field(default=0.01, ge=0, description="smaller cells, and holes in cells, are removed")


MOST_NOISE = 0.04
"""Above this ``noise_share``, Jaccard indices against the truth were under 0.7, mostly under 0.5 (docs/bench.md)."""

MOST_CELLS = 0.6
"""A wall of which more than this is cells is taken for one that was not found: bores have 0.08 to 0.3."""


@dataclass(frozen=True, eq=False)
class Segmentation:
    """Cells of one side on its own samples.

    ``mask`` is bool (n_z, n_theta), False where nothing was observed; ``threshold`` is in ``unit`` of ``of``, None
    where the mask was given; ``polarity`` is None where depth or a mask says what is a cell.
    """

    mask: Mask
    threshold: float | None
    unit: str
    of: str
    polarity: Polarity | None
    noise_share: float = 0.0

    @property
    def doubt(self) -> str | None:
        """Why these are not to be trusted as cells, in a full sentence; None where nothing speaks against them."""
        if self.noise_share > MOST_NOISE:
            return (
                f"What was taken for cells may be noise: {self.noise_share:.0%} as many samples lie as far in front of "
                "the wall, where nothing can be."
            )
        share = float(self.mask.mean())
        return (
            f"The wall may not have been found: {share:.0%} of it was taken for cells." if share > MOST_CELLS else None
        )


def segment(panorama: Panorama, parameters: SegmentParameters | None = None, *, polarity: Polarity = "dark") -> Mask:
    """Return the cells of ``panorama`` on its own samples, bool (n_z, n_theta), False where it is not valid.

    ``polarity`` says whether cells are dark or bright where there is only intensity to tell them by. Raises
    :class:`EndoctError` where nothing is valid or the evidence is constant.
    """
    parameters = parameters or SegmentParameters()
    return find_cells(prepare(panorama, prefer=parameters.segment, polarity=polarity), parameters).mask


def find_cells(evidence: Evidence, parameters: SegmentParameters) -> Segmentation:
    """Return the cells that ``evidence`` shows: Li's threshold, then opening, closing, and small ones removed.

    Evidence that is a mask is taken as it is. Raises :class:`EndoctError` where all evidence is alike.
    """
    p = parameters
    polarity: Polarity | None = None
    if evidence.kind == "mask":
        return Segmentation(evidence.valid & (evidence.values > 0.5), None, "1", "mask as given", None)
    if evidence.kind == "relief":
        low, high, unit = p.relief_floor_mm, p.relief_cap_mm, "mm"
        of = f"relief behind the wall, floored at {low:g} and capped at {high:g} mm"
    else:
        polarity = "dark" if evidence.kind == "darkness" else "bright"
        low, high, unit = 0.0, p.contrast_cap, "1"
        sign = "−log" if polarity == "dark" else "log"
        of = f"{sign} of intensity relative to the wall's, floored at 0 and capped at {high:g}"
    smooth = masked_gaussian(
        evidence.values, evidence.valid, p.smooth_mm / evidence.dz_mm, p.smooth_mm / evidence.column_mm
    )
    prepared = np.clip(smooth, low, high)
    try:
        threshold = li_threshold(prepared[evidence.valid])
    except EndoctError as error:
        raise EndoctError(
            "a side shows no cells to threshold", found=error.found, expected="wall and cells that differ"
        ) from error
    mask = clean(evidence.valid & (prepared > threshold), evidence.dz_mm, evidence.column_mm, p) & evidence.valid
    behind, before = (int(np.count_nonzero(evidence.valid & (side > threshold))) for side in (smooth, -smooth))
    return Segmentation(mask, threshold, unit, of, polarity, before / max(behind, 1))


def clean(mask: Mask, dz_mm: float, column_mm: float, parameters: SegmentParameters) -> Mask:
    """Return ``mask`` opened, closed, and without cells and holes smaller than ``smallest_mm2``."""
    p = parameters
    mask = morphology(mask, "open", p.open_mm / dz_mm, p.open_mm / column_mm)
    mask = morphology(mask, "close", p.close_mm / dz_mm, p.close_mm / column_mm)
    smallest_px = p.smallest_mm2 / (dz_mm * column_mm)
    mask = remove_small(mask, smallest_px)
    return ~remove_small(~mask, smallest_px)


def morphology(mask: Mask, operation: Literal["open", "close"], rows_px: float, columns_px: float) -> Mask:
    """Return ``mask`` opened or closed with an ellipse of these radii (px): cyclic in θ, ending in z.

    Beyond the ends of z the wall goes on as neither cell nor wall: nothing is removed or added because of them.
    """
    up, across = int(rows_px), int(columns_px)
    if up == 0 and across == 0:
        return mask
    y, x = np.mgrid[-up : up + 1, -across : across + 1]
    ellipse = ((y / max(rows_px, 1e-9)) ** 2 + (x / max(columns_px, 1e-9)) ** 2 <= 1 + 1e-9).astype(np.uint8)
    pad = min(2 * across, mask.shape[1])
    padded = np.pad(mask.astype(np.uint8), ((0, 0), (pad, pad)), mode="wrap")
    kind = cv2.MORPH_OPEN if operation == "open" else cv2.MORPH_CLOSE
    done = cv2.morphologyEx(padded, kind, ellipse, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(done[:, pad : pad + mask.shape[1]] > 0)


def label(mask: Mask) -> tuple[NDArray[np.int32], int]:
    """Return (labels (n_z, n_theta), 0 outside, 1 … n; n) of connected cells, joined over the seam of θ.

    Samples that touch at a corner are connected.
    """
    labels, n = ndimage.label(mask, structure=np.ones((3, 3)))
    # columns −1 and 0 are neighbours: a row with itself and with the rows above and below
    last, first = np.pad(labels[:, -1], 1), labels[:, 0]
    left, right = np.stack([last[:-2], last[1:-1], last[2:]]), np.broadcast_to(first, (3, first.size))
    touch = (left > 0) & (right > 0)
    graph = sparse.coo_array((np.ones(touch.sum()), (left[touch], right[touch])), shape=(n + 1, n + 1))
    n_joined, component = connected_components(graph, directed=False)
    # the background, 0, is visited first and stays 0
    return component.astype(np.int32)[labels], int(n_joined) - 1


def remove_small(mask: Mask, smallest_px: float) -> Mask:
    """Return ``mask`` without connected cells of fewer than ``smallest_px`` samples."""
    if smallest_px <= 1:
        return mask
    labels, _ = label(mask)
    keep = np.bincount(labels.ravel()) >= smallest_px
    keep[0] = False
    return np.asarray(keep[labels])
