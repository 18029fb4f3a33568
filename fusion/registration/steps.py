"""A step along the bore, as where a slice was lost: all beyond it belongs farther along than what lies before.

A rigid alignment puts either side half a step off, and its scale takes a part of the rest. No band is then far out of
place, but all of them together follow two lines that are the same but for the step, and not one.
"""

from dataclasses import dataclass

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.numeric.ranks import robust_sigma
from endoct.fusion.evidence.evidence import Evidence, clipped
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.registration.rigidity import FARTHEST_MM, Look, bands, in_one_frame

BANDS = Look(tall_mm=1.0, reach_mm=0.5, reach_rad=0.2, clear=0.55, better=0.0, dense=4)
LEAST_STEP_MM = 0.12
"""Smaller steps are not looked for. In sound recordings steps up to 0.17 mm explain little."""
MOST_LEFT = 0.52
"""Two lines leave less than this of what one line leaves of the same bands. They left 0.91 and more of five sound
recordings (benchmarks/independent, sound 9300-9309), and 0.12 to 0.67 where a slice was lost in the middle: of four,
three were found. Other bores of 8 to 12 mm, of either generator, have too few bands, and none is looked for."""
FEWEST_BANDS = 12
"""Number of bands, four to the millimetre, on either side of a step. With 4, 7 of 30 sound recordings with few cells
were doubted (benchmarks/independent, few, sparse and sound, seeds 9200-9209); with 12, none."""
CLIP_MM = 0.15
"""A band that lies farther from its line fits there by chance."""
EXACT_MM = 0.005
"""How exactly a band can be placed at best."""


@dataclass(frozen=True)
class Step:
    """From ``at_mm`` on, in A's frame, side B fits best ``along_mm`` farther along the bore than before."""

    at_mm: float
    along_mm: float


def step_along(a: Evidence, b: Evidence, alignment: Alignment) -> Step | None:
    """Return where B, as placed by ``alignment``, steps along the bore; None where nothing speaks for it."""
    one, two = in_one_frame(clipped(a), clipped(b), alignment, FARTHEST_MM)
    sure = [band for band in bands(one, two, BANDS) if band.fit.correlation[0] >= BANDS.clear]
    z_mm = np.array([(band.first + band.last) / 2 for band in sure])
    return best_step(z_mm, np.array([band.fit.along_mm + band.fit.between_mm for band in sure]))


def best_step(z_mm: Coordinates, along_mm: Coordinates) -> Step | None:
    """Return the step between two parallel lines through ``along_mm`` at ``z_mm``, (n,) ascending, if there is one."""
    best, least, by_one_mm = None, np.inf, 0.0
    for at_mm in (z_mm[1:] + z_mm[:-1]) / 2:
        whole = np.abs(z_mm - at_mm) > BANDS.tall_mm / 2  # a band across the step fits neither
        beyond = z_mm[whole] > at_mm
        if min(np.count_nonzero(beyond), np.count_nonzero(~beyond)) < FEWEST_BANDS:
            continue
        factors, left_mm = _line(z_mm[whole], along_mm[whole], beyond.astype(np.float64))
        if left_mm < least:
            best, least = Step(float(at_mm), float(factors[-1])), left_mm
            by_one_mm = _line(z_mm[whole], along_mm[whole])[1]
    if best is None or abs(best.along_mm) < LEAST_STEP_MM:
        return None
    return best if least < MOST_LEFT * by_one_mm else None


def _line(z_mm: Coordinates, along_mm: Coordinates, *more: Coordinates) -> tuple[Coordinates, float]:
    """Return the factors of 1, z and ``more`` that fit best, and how far bands lie from that in the mean, mm.

    By iterated least squares with Huber's weights, since some bands fit elsewhere by chance.
    """
    design = np.stack([np.ones_like(z_mm), z_mm - z_mm.mean(), *more], axis=1)
    weight, factors = np.ones_like(z_mm), np.zeros(design.shape[1])
    for _ in range(3):
        root = np.sqrt(weight)
        factors = np.linalg.lstsq(design * root[:, None], along_mm * root, rcond=None)[0]
        off_mm = np.abs(along_mm - design @ factors)
        weight = 1 / np.maximum(1, off_mm / (1.5 * (robust_sigma(along_mm - design @ factors) + EXACT_MM)))
    return factors, float(np.minimum(off_mm, CLIP_MM).mean())
