"""What one recording of the endoscope has of light: worked out once, the same for all its frames."""

from dataclasses import dataclass, replace

import numpy as np

from endoct.base.arrays import Image
from endoct.synthetic.bone.maps import WallMaps
from endoct.synthetic.endoscope.bounces import bounced
from endoct.synthetic.endoscope.facets import Facets, facets_of, shade_of
from endoct.synthetic.endoscope.light import Surface, light, surface
from endoct.synthetic.endoscope.sight import Visible, follow, view, visible
from endoct.synthetic.sample.parameters import Sample

METERED_FRAMES = 3
METERED_EVERY = 3
"""Rows of the image to one in which the light is measured."""


@dataclass(frozen=True, eq=False)
class Lighting:
    """``shade`` and ``facets`` of the wall, and the camera's ``gain``: saturation over light."""

    shade: Image
    facets: Facets
    gain: float


def lighting_of(sample: Sample, wall: WallMaps) -> Lighting:
    """Return the lighting of a recording, with the gain that a person would set on its first frames.

    That is the one at which ``saturated`` of the annulus saturates, times ``exposure``.
    """
    unset = Lighting(shade_of(wall), facets_of(wall), 1.0)
    brightest = [_metered(sample, wall, unset, k) for k in range(min(METERED_FRAMES, len(sample.endoscope.z_mm)))]
    level = float(np.quantile(np.concatenate(brightest), 1 - sample.endoscope.saturated))
    return replace(unset, gain=sample.endoscope.exposure / level)


def lit_frame(sample: Sample, wall: WallMaps, lighting: Lighting, frame_index: int) -> tuple[Visible, Surface]:
    """Return the rows of the wall that a frame can see, and what its light falls on there."""
    camera = sample.endoscope
    reached = visible(wall, camera, frame_index)
    bounces = bounced(camera, frame_index, wall, lighting.facets, lighting.shade)
    return reached, surface(camera, wall, lighting.shade, bounces, reached)


def _metered(sample: Sample, wall: WallMaps, lighting: Lighting, frame_index: int) -> Image:
    """Return the light of the brightest colour in some of a frame's pixels."""
    camera = sample.endoscope
    reached, lit = lit_frame(sample, wall, lighting, frame_index)
    pixels = view(camera, frame_index, slice(None, None, METERED_EVERY))
    found = light(sample, frame_index, lit, pixels, follow(reached, camera, frame_index, pixels))
    return np.asarray(found.max(axis=0), dtype=np.float32)
