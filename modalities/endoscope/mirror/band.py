"""The band of wall that one frame shows between the rims of the annulus, and its samples along circles.

The circles are those of constant z: one interpolation leads from the image to the rows of z and columns of θ that
are surveyed.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image
from endoct.base.compute.compiled import compiled
from endoct.base.compute.memory import Room
from endoct.base.errors import EndoctError
from endoct.modalities.endoscope.manifest import EndoscopeAcquisition
from endoct.modalities.endoscope.mirror.annulus import Annulus
from endoct.modalities.endoscope.mirror.optics import ConeOptics, assumed_cone, stated_optics
from endoct.modalities.endoscope.mirror.ring_search import Reference

LEAST_ROWS, MOST_ROWS = 8, 96
RIM_PX = 2.0


@dataclass(frozen=True, eq=False)
class Band:
    """``optics`` between the rims; ``outward_mm``, float64 (n_rows,), ascending: rows from the band's middle.

    Outward means towards the outer rim: z where that rim looks ahead, −z where it looks behind.
    """

    optics: ConeOptics
    outward_mm: Coordinates

    @property
    def half_mm(self) -> float:
        """From the middle to the last row, mm."""
        return float(self.outward_mm[-1])

    @property
    def row_mm(self) -> float:
        """From row to row, mm."""
        return float(self.outward_mm[1] - self.outward_mm[0])

    @property
    def r_px(self) -> Coordinates:
        """Image radius of every row, float64 (n_rows,), in pixels of the files."""
        return self.optics.r_px(self.optics.rim_sign * self.outward_mm)

    def rescaled(self, ratio: float) -> "Band":
        """Return the band ``ratio`` times as long, by a cone that is assumed."""
        o = self.optics
        cone = assumed_cone(o.inner_px, o.outer_px, ratio * o.visible_length_mm, o.bore_radius_mm, o.rim_sign)
        return Band(cone, self.outward_mm * ratio)


def stated_band(acquisition: EndoscopeAcquisition, reference: Reference) -> tuple[Band, tuple[str, ...]]:
    """Return the band as the sidecar has its optics, and notes where it contradicts itself.

    Raises :class:`EndoctError` where the annulus is too narrow, or the sidecar gives no scale.
    """
    annulus = reference.annulus.scaled(reference.factor)
    optics, notes = stated_optics(acquisition, annulus.inner_px, annulus.outer_px)
    width_px, margin_px = annulus.outer_px - annulus.inner_px, RIM_PX * reference.factor
    half_mm = optics.visible_length_mm / 2 - margin_px * optics.mm_per_px
    if half_mm <= 0:
        raise EndoctError(
            "the annulus is too narrow to be unrolled",
            found=f"{width_px:.0f} px from its inner to its outer rim",
            expected=f"more than {2 * margin_px:.0f} px",
            remedy="check 'annulus' in the sidecar",
        )
    n_rows = int(np.clip(round(width_px / reference.factor), LEAST_ROWS, MOST_ROWS))
    return Band(optics, np.linspace(-half_mm, half_mm, n_rows)), notes


@dataclass(frozen=True, eq=False)
class Circles:
    """Circles of constant z in an image: their radii ``r_px``, float64 (n_rows,), and centres by an annulus."""

    annulus: Annulus
    r_px: Coordinates

    def pixel_map(self, angle_rad: Coordinates, room: Room | None = None) -> tuple[Image, Image]:
        """Return column and row of the image, float32 (n_rows, n_theta), at angles (n_theta,) of every circle.

        Both are arrays of ``room``, of one of their own without it.
        """
        x, y = self.annulus.centre_at(self.r_px)
        room, shape = room or Room(), (self.r_px.size, angle_rad.size)
        columns, rows = room.array("columns", shape), room.array("rows", shape)
        _around(self.annulus.columns(x), self.annulus.pixels * np.cos(angle_rad), self.r_px, columns)
        _around(y, np.sin(angle_rad), self.r_px, rows)
        return columns, rows


@compiled
def _around(centre: Coordinates, direction: Coordinates, r_px: Coordinates, places: Image) -> None:
    """Write a coordinate of every place on circles, (n_circles, n_directions)."""
    for i in range(r_px.size):
        for j in range(direction.size):
            places[i, j] = centre[i] + r_px[i] * direction[j]


def recentred(logs: NDArray[np.float16], old: Circles, new: Circles) -> NDArray[np.float16]:
    """Return strips (n, n_rows, n_theta) of the circles ``old`` as strips of the circles ``new``.

    Their radii are evenly spaced or nearly so; NaN where a circle leaves the strip.
    """
    angle = np.linspace(0, 2 * np.pi, logs.shape[2], endpoint=False)
    r_px = new.r_px
    (x, y), (old_x, old_y) = new.annulus.centre_at(r_px), old.annulus.centre_at(r_px)
    dx, dy = (x - old_x)[:, None], (y - old_y)[:, None]
    outward = dx * np.cos(angle) + dy * np.sin(angle)
    around = (dy * np.cos(angle) - dx * np.sin(angle)) / r_px[:, None]
    place = np.interp(r_px, old.r_px, np.arange(r_px.size))[:, None]
    rows = (place + outward / np.gradient(old.r_px)[:, None]).astype(np.float32)
    columns = np.mod(np.arange(logs.shape[2]) + around / angle[1], logs.shape[2]).astype(np.float32)
    outside = (rows < 0) | (rows > r_px.size - 1)
    moved = np.empty_like(logs)
    for k, strip in enumerate(logs):
        whole = np.concatenate([strip, strip[:, :1]], axis=1).astype(np.float32)
        samples = cv2.remap(whole, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        moved[k] = np.where(outside, np.nan, samples)
    return moved
