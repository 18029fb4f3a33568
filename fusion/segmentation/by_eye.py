"""Cells of an image as the learned eye of its modality sees them, and how sure it is.

Its probabilities are calibrated. So they say what Jaccard index to expect: what is surely cell, over what may be.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from endoct.base.arrays import Image, Mask
from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError
from endoct.base.numeric.regions import within
from endoct.fusion.evidence.evidence import Evidence
from endoct.fusion.evidence.relief import ParallaxRelief
from endoct.fusion.evidence.side import Side
from endoct.fusion.segmentation.cleaning import clean
from endoct.fusion.segmentation.learned.looking import COARSEST_MM, LOOK_MM, Inputs, grain, inputs_of, look, weights_for
from endoct.fusion.segmentation.parameters import NO_EYE, OUR_EYE, SegmentParameters
from endoct.fusion.segmentation.segment import Segmentation, decided_by_depth, doubts_of_share

LEAST_PROBABILITY = 0.4
"""A sample is a cell from this probability on. On the simulator 0.4 to 0.5 do alike; the eye rather misses what it does
not know."""
LEAST_EXPECTED = 0.75
"""The eye doubts its own cells where it expects a lower Jaccard index."""
SURE_EXPECTED = 0.91
"""Where it expects a lower one, its cells are held against those by threshold, outlines and depth. Of 60 recordings of
two generators, 19 of tuning seeds, it expected this or more of 39, looking at pieces half as long; their indices were
0.73 and more."""
LEAST_LIKE_SOUND = 0.75
"""An eye that is not sure has at least this Jaccard index with cells by threshold and outlines that nothing speaks
against, or is not believed. On tuning seeds it had 0.80 to 0.89 with those in bores of tiny cells, where it was mostly
the better; of four bores with a few specks among stains 0.91 where it was better, 0.41 to 0.71 where it was worse."""
LEAST_AGREEMENT = 0.5
"""Where both are doubtful, they have at least this Jaccard index with each other, or the eye's cells are doubted: with
floors as bright as the wall it was 0.1 to 0.45, else 0.6 and more."""
MOST_GRAIN = 0.035
"""A wall whose neighbouring samples differ by more is unlike those that an eye was trained on. 41 recordings of two
generators have 0.009 to 0.022. Walls with noise in every sample have 0.05 and more: the eye took nearly all of them for
cells."""
EDGE_MM = 0.05
"""What depth added or dropped lies farther than this from what brightness alone shows; edges of a coarse look are less
exact."""


@dataclass(frozen=True, eq=False)
class EyeView:
    """What a learned eye, with its ``weights``, has before it to find the cells of a side, which are dark."""

    modality: str
    weights: Path
    darkness: Evidence
    relief: ParallaxRelief | None
    inputs: Inputs

    @property
    def is_familiar(self) -> bool:
        """Whether the wall looks like those that an eye was trained on."""
        return grain(self.inputs) <= MOST_GRAIN


def check_eye(parameters: SegmentParameters, *sides: Side) -> None:
    """Raise :class:`EndoctError` where the user's own weights are for no side whose cells its intensity shows."""
    if parameters.eye in (OUR_EYE, NO_EYE):
        return
    seen = {
        one.panorama.modality for one in sides if not one.in_reference.cell_evidence(parameters.segment).knows_cells
    }
    if all(weights_for(modality, parameters.eye) is None for modality in seen):
        raise EndoctError(
            f"the learned eye {parameters.eye} has nothing to look at",
            found=", ".join(sorted(seen)) or "sides with depth and masks alone",
            expected="a side of the modality in its card whose cells show by intensity",
            remedy="name other weights, or leave the setting 'eye' out",
        )


def view_of(side: Side, parameters: SegmentParameters) -> EyeView | None:
    """Return what a learned eye has before it; None where none was trained for ``side``, or its samples are coarse.

    Raises :class:`EndoctError` where the intensity is constant.
    """
    modality, grid = side.panorama.modality, side.grid
    if max(grid.dz_mm, grid.dtheta_mm) > COARSEST_MM or (weights := weights_for(modality, parameters.eye)) is None:
        return None
    darkness, relief = side.contrast("dark"), side.parallax if parameters.by_depth else None
    return EyeView(modality, weights, darkness, relief, inputs_of(darkness, relief, LOOK_MM))


def cells_by_eye(
    view: EyeView, parameters: SegmentParameters, polarity_from: str | None = None
) -> tuple[Segmentation, float]:
    """Return the cells that a learned eye sees, cleaned on the circle, and the Jaccard index that it expects of them.

    Raises :class:`EndoctError` where the eye's weights are damaged.
    """
    darkness, relief, valid = view.darkness, view.relief, view.darkness.valid
    probability = look(view.weights, darkness, relief, view.inputs)

    def cells_of(image: Image) -> Mask:
        probable = valid & (image > LEAST_PROBABILITY)
        return clean(probable, darkness.dz_mm, darkness.column_mm, parameters) & valid

    mask = cells_of(probability.of_cell)
    by_depth = None
    if relief is not None and probability.without_depth is not None:
        without = cells_of(probability.without_depth)
        moved = _beyond(mask, without, darkness), _beyond(without, mask, darkness)
        by_depth = decided_by_depth(valid, relief.known, *moved)
    of = f"probability of a cell, by the learned eye for {view.modality} panoramas"
    expected = expected_jaccard(probability.of_cell, mask, valid)
    doubts = tuple(_doubts(float(mask[valid].mean()), expected))
    found = Segmentation(mask, LEAST_PROBABILITY, "1", of, "dark", "eye", polarity_from, by_depth, doubts)
    return replace(found, probability=probability.of_cell), expected


def _beyond(mask: Mask, other: Mask, darkness: Evidence) -> Mask:
    """Return what of ``mask`` lies farther than an edge may move from all of ``other``."""
    return mask & ~within(other, EDGE_MM / darkness.dz_mm, EDGE_MM / darkness.column_mm)


def is_sure(cells: Segmentation, expected: float) -> bool:
    """Return whether a learned eye is sure of the ``cells`` that it found; where it found none, it may be blind."""
    return bool(cells.mask.any()) and expected >= SURE_EXPECTED


def held_against(by_eye: Segmentation, by_rules: Segmentation) -> Segmentation:
    """Return the cells of an eye that is not sure, or those by threshold and outlines where these speak against it."""
    shared, either = (
        int(np.count_nonzero(mask)) for mask in (by_eye.mask & by_rules.mask, by_eye.mask | by_rules.mask)
    )
    agreement = shared / max(either, 1)
    if not by_rules.doubts:
        believed = agreement >= LEAST_LIKE_SOUND or not by_rules.mask.any()
        return by_eye if believed else replace(by_rules, eye_declined="the learned eye is not sure of this wall")
    if agreement >= LEAST_AGREEMENT:
        return by_eye
    what = (
        f"The cells rest on the learned eye alone: those by threshold and outlines are doubtful as well, and the two "
        f"have a Jaccard index of {agreement:.2f} with each other."
    )
    doubt = Doubt("cells-by-eye-alone", what, value=agreement, unit="1", expected=(LEAST_AGREEMENT, 1.0))
    return replace(by_eye, doubts=(*by_eye.doubts, doubt))


def expected_jaccard(probability: Image, mask: Mask, valid: Mask) -> float:
    """Return the Jaccard index of ``mask`` to expect against the truth, if ``probability`` is right; 1 without cells.

    It is the expected intersection over the expected union, over ``valid`` samples; all are (n_z, n_theta).
    """
    cells, rest = probability[mask & valid], probability[valid & ~mask]
    union = cells.size + float(rest.sum(dtype=np.float64))
    return float(cells.sum(dtype=np.float64)) / union if cells.size else 1.0


def _doubts(share: float, expected: float) -> Iterator[Doubt]:
    yield from doubts_of_share(share)
    if expected < LEAST_EXPECTED:
        what = (
            f"The learned eye is not sure of the cells: by its own probabilities they would reach a Jaccard index of "
            f"{expected:.2f} against the truth. Some may be missed, and some may be none."
        )
        yield Doubt("cells-unsure", what, value=expected, unit="1", expected=(LEAST_EXPECTED, 1.0))
