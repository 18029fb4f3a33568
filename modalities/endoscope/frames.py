"""The pass over all frames: the annulus in each, and its strip, small and in logarithms."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Mask
from endoct.base.compute.memory import Kept, Room
from endoct.base.compute.parallel import thread_map
from endoct.modalities.contract import Frame, FrameStream
from endoct.modalities.endoscope.light import log_light, reduced_light
from endoct.modalities.endoscope.mirror.annulus import LEAST_SUPPORT, Annulus, Followed, follow
from endoct.modalities.endoscope.mirror.band import Band, Circles, sample
from endoct.modalities.endoscope.mirror.ring_search import Reference, settle_annuli, squared

STRIP_COLUMNS = 1024
_ROOM = Room()

BY_MOVEMENT = (
    "The mirror's rims are no clear edges of light; they were found where what is seen begins to change from frame to "
    "frame."
)

LogStrip = NDArray[np.float16]
"""Logarithm of a frame's brightness, float16 (n_rows, ``STRIP_COLUMNS``), image angles; NaN outside the image and
under an overlay."""


@dataclass(frozen=True, eq=False)
class Frames:
    """What was measured in every frame.

    Attributes: ``annuli`` in pixels of the files; ``annulus_found``, bool (n,), whether it was measured there or taken
    from the frames around; ``own_radii_px``, float64 (n, 2), of its inner and outer rim by that frame alone, NaN where
    they are not clear; ``saturated_fraction``, float64 (n,), of its strip.
    """

    annuli: tuple[Annulus, ...]
    annulus_found: Mask
    own_radii_px: Coordinates
    saturated_fraction: Coordinates


def examine_frames(
    stream: FrameStream, reference: Reference, band: Band, strips: Kept[LogStrip]
) -> tuple[Frames, tuple[str, ...]]:
    """Append the strip of every frame to ``strips``; return what was measured, and notes on it."""
    examine = partial(_examine, reference=reference, r_px=np.divide(band.r_px, reference.factor))
    followed, alone, saturated_fraction = [], [], []
    for of_frame, by_itself, fraction, strip in thread_map(examine, stream):
        followed.append(of_frame)
        alone.append(by_itself)
        saturated_fraction.append(fraction)
        strips.append(strip)
    annuli, found = settle_annuli(followed, reference.annulus, given=True)
    clear = np.array([of.support >= 2 * LEAST_SUPPORT for of in alone])
    radii = [(of.annulus.inner_px, of.annulus.outer_px) for of in alone]
    frames = Frames(
        tuple(replace(a.scaled(reference.factor), pixels=reference.annulus.pixels) for a in annuli),
        found,
        np.where(clear[:, None], np.multiply(radii, reference.factor), np.nan),
        np.array(saturated_fraction),
    )
    by_movement = (BY_MOVEMENT,) if reference.handle else ()
    if found.all():
        return frames, by_movement
    return frames, (
        *by_movement,
        f"The annulus could not be measured in {np.sum(~found)} of {len(found)} frames; "
        "its place there is that of the frames around.",
    )


def brightness_of_rows(logs: LogStrip) -> Coordinates:
    """Return how bright most of every row of a strip is, natural logarithm, float64 (n_rows,), NaN where none is seen.

    That is its upper quartile: cells seldom fill three quarters of the way around.
    """
    ordered = np.sort(logs.astype(np.float32), axis=1)  # NaN last
    count = np.isfinite(ordered).sum(axis=1)
    at = np.floor(0.75 * np.maximum(count - 1, 0)).astype(np.intp)
    return np.where(count > 0, ordered[np.arange(len(ordered)), at], np.nan)


def _examine(frame: Frame, *, reference: Reference, r_px: Coordinates) -> tuple[Followed, Followed, float, LogStrip]:
    """Return a frame's annulus, that by its own rims, its saturated share, and its strip at radii ``r_px``."""
    pixels = reference.annulus.pixels
    light, clipped = reduced_light(frame.samples, reference.full_scale, reference.factor, _ROOM)
    image = squared(light, pixels)
    followed = follow(image, reference.annulus, reference.handle)
    alone = follow(image, reference.annulus) if reference.handle else followed
    place = replace(settle_annuli([followed], reference.annulus, given=True)[0][0], pixels=1.0)
    angle = np.linspace(0, 2 * np.pi, STRIP_COLUMNS, endpoint=False)
    columns, rows = Circles(place, r_px).pixel_map(angle, _ROOM)
    strip, inside = sample(image, columns, rows)
    seen = inside
    if reference.overlay is not None:
        covered, _ = sample(reference.overlay.astype(np.float32), columns, rows)
        seen = inside & (covered == 0)
    logs = np.where(seen, log_light(strip), np.nan).astype(np.float16)
    fraction = 0.0
    if clipped is not None and seen.any():
        share, _ = sample(squared(clipped, pixels), columns, rows)
        fraction = float(share[seen].mean())
    return followed, alone, fraction, logs
