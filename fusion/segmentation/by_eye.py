"""Cells of an image as the learned eye of its modality sees them, and how sure it is.

Its probabilities are calibrated. So they say what Jaccard index to expect: what is surely cell, over what may be.
"""

from collections.abc import Iterator

import numpy as np

from endoct.base.arrays import Image, Mask
from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError
from endoct.fusion.evidence.evidence import Evidence
from endoct.fusion.evidence.relief import ParallaxRelief
from endoct.fusion.evidence.side import Side
from endoct.fusion.segmentation.learned.looking import COARSEST_MM, LOOK_MM, Inputs, grain, inputs_of, look, weights_for
from endoct.fusion.segmentation.parameters import NO_EYE, OUR_EYE, SegmentParameters
from endoct.fusion.segmentation.regions import clean, within
from endoct.fusion.segmentation.segment import ByDepth, Segmentation, doubts_of_share

LEAST_PROBABILITY = 0.4
"""A sample is a cell from this probability on. On the simulator 0.4 to 0.5 do alike; the eye rather misses what it does
not know."""
LEAST_EXPECTED = 0.84
"""The eye is not sure where it expects a lower Jaccard index. Of 24 recordings, tuning seeds, it expected 0.64 to 0.74
for three, with two to five small cells on a stained wall. The others score 0.04 less than expected in the median, at
worst 0.17."""
MOST_GRAIN = 0.035
"""A wall whose neighbouring samples differ by more is unlike those that an eye was trained on. 41 recordings of two
generators have 0.009 to 0.022. Walls with noise in every sample have 0.05 and more: the eye took nearly all of them for
cells."""
TOO_GRAINY = "; the wall is too grainy for the learned eye"
NOT_SURE = "; the learned eye is not sure of this wall"
UNSURE = "cells-unsure"
EDGE_MM = 0.05
"""What depth added or dropped lies farther than this from what brightness alone shows; edges of a coarse look are less
exact."""


def inputs_for(side: Side, parameters: SegmentParameters) -> Inputs:
    """Return what an eye looks at to find the cells of ``side``, which are dark."""
    return inputs_of(side.contrast("dark"), _relief(side, parameters), LOOK_MM)


def is_familiar(inputs: Inputs) -> bool:
    """Return whether a wall looks like those that an eye was trained on."""
    return grain(inputs) <= MOST_GRAIN


def check_eye(parameters: SegmentParameters, *sides: Side) -> None:
    """Raise :class:`EndoctError` where the user's own weights are for no side whose cells its intensity shows."""
    if parameters.eye in (OUR_EYE, NO_EYE):
        return
    seen = {one.panorama.modality for one in sides if not one.cell_evidence(parameters.segment).knows_cells}
    if all(weights_for(modality, parameters.eye) is None for modality in seen):
        raise EndoctError(
            f"the learned eye {parameters.eye} has nothing to look at",
            found=", ".join(sorted(seen)) or "sides with depth and masks alone",
            expected="a side of the modality in its card whose cells show by intensity",
            remedy="name other weights, or leave the setting 'eye' out",
        )


def has_eye(side: Side, parameters: SegmentParameters) -> bool:
    """Return whether a learned eye finds the cells of ``side``: one was trained for it, and its samples are fine."""
    grid = side.grid
    fine = max(grid.dz_mm, grid.dtheta_mm) <= COARSEST_MM
    return fine and weights_for(side.panorama.modality, parameters.eye) is not None


def cells_by_eye(
    side: Side, parameters: SegmentParameters, inputs: Inputs, polarity_from: str | None = None
) -> Segmentation:
    """Return the cells of ``side``, which are dark, as the learned eye sees them in ``inputs``, cleaned on the circle.

    Raises :class:`EndoctError` where the intensity is constant, or the eye's weights are damaged.
    """
    darkness, relief = side.contrast("dark"), _relief(side, parameters)
    weights, valid = weights_for(side.panorama.modality, parameters.eye), darkness.valid
    if weights is None:
        raise EndoctError(f"no eye was trained for {side.panorama.modality} panoramas", remedy="set eye to 'off'")
    probability = look(weights, darkness, relief, inputs)

    def cells_of(image: Image) -> Mask:
        probable = valid & (image > LEAST_PROBABILITY)
        return clean(probable, darkness.dz_mm, darkness.column_mm, parameters) & valid

    mask = cells_of(probability.of_cell)
    by_depth = None
    if relief is not None and probability.without_depth is not None:
        without, n = cells_of(probability.without_depth), max(int(np.count_nonzero(valid)), 1)
        shares = (relief.known & valid, _beyond(mask, without, darkness), _beyond(without, mask, darkness))
        by_depth = ByDepth(*(int(np.count_nonzero(some)) / n for some in shares))
    of = f"probability of a cell, by the learned eye for {side.panorama.modality} panoramas"
    doubts = tuple(_doubts(probability.of_cell, mask, valid))
    return Segmentation(mask, LEAST_PROBABILITY, "1", of, "dark", polarity_from, by_depth, doubts)


def _beyond(mask: Mask, other: Mask, darkness: Evidence) -> Mask:
    """Return what of ``mask`` lies farther than an edge may move from all of ``other``."""
    return mask & ~within(other, EDGE_MM / darkness.dz_mm, EDGE_MM / darkness.column_mm)


def _relief(side: Side, parameters: SegmentParameters) -> ParallaxRelief | None:
    return side.parallax if parameters.by_depth else None


def is_sure(cells: Segmentation) -> bool:
    """Return whether a learned eye is sure of the ``cells`` that it found; where it found none, it may be blind."""
    return bool(cells.mask.any()) and all(doubt.code != UNSURE for doubt in cells.doubts)


def expected_jaccard(probability: Image, mask: Mask, valid: Mask) -> float:
    """Return the Jaccard index of ``mask`` to expect against the truth, if ``probability`` is right; 1 without cells.

    It is the expected intersection over the expected union, over ``valid`` samples; all are (n_z, n_theta).
    """
    cells, rest = probability[mask & valid], probability[valid & ~mask]
    union = cells.size + float(rest.sum(dtype=np.float64))
    return float(cells.sum(dtype=np.float64)) / union if cells.size else 1.0


def _doubts(probability: Image, mask: Mask, valid: Mask) -> Iterator[Doubt]:
    yield from doubts_of_share(float(mask[valid].mean()))
    expected = expected_jaccard(probability, mask, valid)
    if expected < LEAST_EXPECTED:
        what = (
            f"The learned eye is not sure of the cells: by its own probabilities they would reach a Jaccard index of "
            f"{expected:.2f} against the truth. Some may be missed, and some may be none."
        )
        yield Doubt(UNSURE, what, value=expected, unit="1", expected=(LEAST_EXPECTED, 1.0))
