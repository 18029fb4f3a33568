"""The mirror's ring in a recording: by its light, and by what moves, which decides where the two disagree."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from endoct.modalities.endoscope.mirror.annulus import (
    Annulus,
    find_annulus,
    find_outer_rims,
    follow,
    locate_outer_rim,
)
from endoct.modalities.endoscope.mirror.moving import Movement, inner_rim_of, movement, outer_rim_of
from endoct.modalities.endoscope.mirror.rings import Ring
from endoct.modalities.endoscope.mirror.roundness import ROUND, Roundness, measure_roundness, squared
from endoct.modalities.endoscope.mirror.settling import settle_annuli
from endoct.stitching.arrays import Image
from endoct.stitching.errors import NotSeen
from endoct.stitching.parallel import thread_map

SAME_RIM = 0.03
"""Of the outer rim's radius: within this the edges of light and of movement are one rim."""


@dataclass(frozen=True, eq=False)
class FoundRing:
    """``annulus`` in square pixels of the images; ``handle``: the circle that it is followed by, None for its own rims.

    ``moving``: what moves in the images, None for a single one; ``moving_rim``: where it begins to, None if unclear.
    ``roundness`` of the outer rim in the images, before :func:`squared` by what is ``corrected`` of it.
    """

    annulus: Annulus
    handle: Ring | None
    moving: Movement | None
    moving_rim: Ring | None
    roundness: Roundness
    corrected: bool


def find_ring(images: Sequence[Image]) -> FoundRing:
    """Return the ring in grey images, spread over the recording. Raises :class:`NotSeen` where there is none.

    Rims of light have the radii of the mean image; frames are to be followed for better ones.
    """
    outers = find_outer_rims(_mean(images))
    roundness = measure_roundness(images, outers[0]) if outers else ROUND
    if corrected := roundness.pixels != 1:
        images = [squared(image, roundness.pixels) for image in images]
        outers = find_outer_rims(_mean(images))
    by_light, refusal = _by_light(_mean(images), outers)
    if not outers:
        raise refusal or NotSeen("no annulus in the frames")
    outer = by_light.rings[1] if by_light else outers[0]
    places = list(thread_map(lambda image: locate_outer_rim(image, outer)[0], images))
    moving = movement(images, places, outer)
    inner = inner_rim_of(moving) if moving else None
    if moving is None or inner is None:
        if by_light is None:
            raise refusal or NotSeen("no annulus in the frames")
        return FoundRing(by_light, None, moving, None, roundness, corrected)
    # what is followed may be a reflection inside the rim: fixed to the probe, too, and of another radius
    handle = replace(outer, radius_px=float(np.median([place.radius_px for place in places])))
    limit = outer_rim_of(moving, inner)
    if limit is None or limit.radius_px < (1 + SAME_RIM) * handle.radius_px:
        limit = handle  # where nothing moves inside the rim, the bore may be at its end
    if by_light and limit is handle and _same(by_light.rings[0], inner, outer):
        return FoundRing(by_light, None, moving, inner, roundness, corrected)
    found = Annulus(inner.x_px, inner.y_px, inner.radius_px, limit.x_px, limit.y_px, limit.radius_px)
    return FoundRing(found, handle, moving, inner, roundness, corrected)


def _by_light(mean: Image, outers: Sequence[Ring]) -> tuple[Annulus | None, NotSeen | None]:
    try:
        return find_annulus(mean, outers), None
    except NotSeen as error:
        return None, error


def ring_at(images: Sequence[Image], given: Annulus) -> FoundRing:
    """Return the ``given`` ring with what moves in the images."""
    annuli, _ = settle_annuli([follow(image, given) for image in images], given, True)
    outer = given.rings[1]
    moving = movement(images, [annulus.rings[1] for annulus in annuli], outer)
    inner = inner_rim_of(moving) if moving else None
    return FoundRing(given, None, moving, inner, measure_roundness(images, outer), corrected=False)


def _mean(images: Sequence[Image]) -> Image:
    return np.asarray(np.mean(images, axis=0, dtype=np.float32))


def _same(one: Ring, other: Ring, outer: Ring) -> bool:
    apart_px = float(np.hypot(one.x_px - other.x_px, one.y_px - other.y_px))
    return max(apart_px, abs(one.radius_px - other.radius_px)) <= SAME_RIM * outer.radius_px
