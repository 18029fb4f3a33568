"""What is measured on some frames before the pass over all of them: full scale, and where the annulus lies."""

from dataclasses import dataclass, replace

import numpy as np

from endoct.modalities.contract import FrameStream
from endoct.modalities.endoscope.green import full_scale_of
from endoct.modalities.endoscope.light import reduced_light
from endoct.modalities.endoscope.manifest import EndoscopeAcquisition
from endoct.modalities.endoscope.mirror.annulus import Annulus, follow
from endoct.modalities.endoscope.mirror.finding import FoundRing, find_ring, ring_at
from endoct.modalities.endoscope.mirror.rings import Ring
from endoct.modalities.endoscope.mirror.roundness import squared
from endoct.modalities.endoscope.mirror.settling import settle_annuli
from endoct.stitching.parallel import thread_map

SURVEY_SIDE_PX = 480
REFERENCE_FRAMES = 12


@dataclass(frozen=True)
class Reference:
    """How every frame is looked at: fixed before the pass, so that the order of the frames does not matter.

    ``full_scale``: value of a saturated sample. The survey reduces frames by ``factor``; ``annulus``, in pixels of
    the reduced frames, is where it is looked for first, and ``handle`` the circle that it is followed by, None for its
    own rims. ``ring``: what it was found by.
    """

    full_scale: float
    factor: int
    annulus: Annulus
    handle: Ring | None
    ring: FoundRing


def find_reference(stream: FrameStream, acquisition: EndoscopeAcquisition) -> Reference:
    """Return the reference by frames spread over the whole recording.

    Raises :class:`NotSeen` where they show no annulus and the sidecar gives none.
    """
    chosen = np.unique(np.linspace(0, len(stream) - 1, min(len(stream), REFERENCE_FRAMES)).round().astype(int))
    frames = list(thread_map(lambda k: stream[int(k)], chosen))
    scale = max(map(full_scale_of, frames))
    factor = max(1, min(frames[0].samples.shape[:2]) // SURVEY_SIDE_PX)
    images = list(thread_map(lambda frame: reduced_light(frame.samples, scale, factor)[0], frames))
    given = acquisition.annulus
    if given is not None:
        stated = Annulus(given.x, given.y, given.inner_px, given.x, given.y, given.outer_px)
        ring = ring_at(images, stated.scaled(1 / factor))
    else:
        ring = find_ring(images)
    pixels = ring.roundness.pixels if ring.corrected else 1.0
    followed = list(thread_map(lambda image: follow(squared(image, pixels), ring.annulus, ring.handle), images))
    annuli, _ = settle_annuli(followed, ring.annulus, given is not None)
    x, y = np.median([(a.outer_x_px, a.outer_y_px) for a in annuli], axis=0)
    annulus = annuli[0].moved(float(x) - annuli[0].outer_x_px, float(y) - annuli[0].outer_y_px)
    handle = ring.handle
    if handle:
        dx_px, dy_px = annulus.outer_x_px - ring.annulus.outer_x_px, annulus.outer_y_px - ring.annulus.outer_y_px
        handle = replace(handle, x_px=handle.x_px + dx_px, y_px=handle.y_px + dy_px)
    return Reference(scale, factor, replace(annulus, pixels=pixels), handle, ring)
