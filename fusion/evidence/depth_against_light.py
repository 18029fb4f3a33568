"""Depth by parallax, held against the light: light falls with depth, so a dark place hardly lies at the wall.

A rim hides what lies behind it, and frames then agree on the rim. Through a mirror whose rays are all alike, they agree
on the wall everywhere. Neither shows in how well they agree.
"""

from dataclasses import replace

import numpy as np

from endoct.fusion.evidence.evidence import prepare
from endoct.stitching.panorama import Panorama

STAINED = 0.2
MM_PER_DARKNESS = 1.0
"""What is darker than ``STAINED``, −log of the intensity, is thought to lie so deep. In a path-traced cell 0.6 mm wide,
a floor at 0.15, 0.5, 1.2 mm is darker than the wall by 0.14, 0.63, 1.35. Wider cells are darker only where deeper."""
DEEPEST_MM = 1.5
MOST_APART_MM = 0.2
"""A depth that is less by more than that is not known."""
DARK = 0.5
MOST_CONTRADICTED, LEAST_DARK = 2 / 3, 0.01
"""Where more of what is darker than ``DARK`` contradicts it, frames do not show depth at all. In bores with floors as
bright as the wall too little is that dark to tell."""


def with_depth_against_light(panorama: Panorama) -> Panorama:
    """Return ``panorama`` with larger errors of depth by parallax where its light lets floors lie deeper.

    NaN where the two contradict each other; everywhere, if they do so nearly everywhere. As it is where it has no such
    depth.
    """
    depth_mm, error_mm = panorama.parallax_depth_mm, panorama.parallax_error_mm
    if depth_mm is None or error_mm is None:
        return panorama
    darkness = prepare(panorama, prefer="intensity").values
    by_light_mm = np.clip(MM_PER_DARKNESS * (darkness - STAINED), 0, DEEPEST_MM)
    short_mm = np.maximum(by_light_mm - depth_mm, 0)
    known, contradicts = np.isfinite(depth_mm), short_mm > MOST_APART_MM
    dark = known & (darkness > DARK)
    if dark.sum() > LEAST_DARK * known.sum() and contradicts[dark].mean() > MOST_CONTRADICTED:
        contradicts = known
    unknown = np.float32(np.nan)
    return replace(
        panorama,
        parallax_depth_mm=np.where(contradicts, unknown, depth_mm),
        parallax_error_mm=np.where(contradicts, unknown, np.hypot(error_mm, short_mm)),
    )
