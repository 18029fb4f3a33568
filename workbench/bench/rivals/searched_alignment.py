"""How one would align two panoramas by mutual information, with as good a start as a search of all places gives.

SimpleITK tries all places of coarse images in all orientations that are open, which takes no polarity for granted.
From the best of them an affine map is refined (Mattes et al. 2003). A is seen continued around by half a turn at either
end, so that θ is a circle.
"""

import contextlib

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.fusion.evidence.evidence import clipped, prepare
from endoct.fusion.geometry.alignment import Alignment, NotAligned
from endoct.stitching.panorama import Panorama
from endoct.workbench.bench.rivals.alignment import Flat, by_information, descended, flat_of, one_itk_thread
from endoct.workbench.bench.tasks.alignment import orientations_between

SEARCHED_PX, SEARCHED_STEPS = 16, 2
"""Pixels of the search, in samples of A, and how many of them lie between two places that are tried."""
LEAST_SHARED = 0.4
"""In the search, A and B share at least this part of B's rows."""
REFINED_PX = (4, 2)


@one_itk_thread()
def simpleitk_searched(a: Panorama, b: Panorama) -> Alignment | NotAligned:
    """SimpleITK: an exhaustive search by Mattes' mutual information, refined by gradient descent at finer pixels."""
    sides = clipped(prepare(a)), clipped(prepare(b))
    found = []
    for orientation in orientations_between(a, b):
        information, x, y = _best_place(flat_of(*sides, orientation, SEARCHED_PX))
        found.append((information, x, y, orientation))
    information, x, y, orientation = max(found)
    if not np.isfinite(information):
        return NotAligned("It found nothing.")
    matrix, before = np.array([[1, 0, x], [0, 1, y]]), SEARCHED_PX
    for px in REFINED_PX:
        matrix[:, 2] *= before / px
        before, flat = px, flat_of(*sides, orientation, px)
        matrix = _refined(flat, matrix)
    return flat.place(matrix)


def _best_place(flat: Flat) -> tuple[float, float, float]:
    """Return the mutual information at the place of B that has most of it, and that place, (x, y) in A, pixels."""
    import SimpleITK as sitk

    rows, columns = flat.b.shape
    method = by_information()
    method.SetMetricSamplingStrategy(method.NONE)
    reach = round((1 - LEAST_SHARED) * max(rows, flat.a.shape[0]) / SEARCHED_STEPS)
    method.SetOptimizerAsExhaustive([columns // (2 * SEARCHED_STEPS), reach], float(SEARCHED_STEPS))
    method.SetInitialTransform(sitk.TranslationTransform(2, (columns / 2, 0.0)))
    tried = [(-np.inf, 0.0, 0.0)]

    def note() -> None:
        information = -float(method.GetMetricValue())
        if np.isfinite(information) and information < 10:  # a place where nothing overlaps has a huge value
            x, y = method.GetOptimizerPosition()
            tried.append((information, float(x), float(y)))

    method.AddCommand(sitk.sitkIterationEvent, note)
    with contextlib.suppress(RuntimeError):  # where too little overlaps in the end
        method.Execute(sitk.GetImageFromArray(flat.b), sitk.GetImageFromArray(flat.a))
    return max(tried)


def _refined(flat: Flat, start: Coordinates) -> Coordinates:
    """Return a better matrix, (2, 3), from (x, y) of B to (x, y) of A, pixels, than ``start``."""
    import SimpleITK as sitk

    transform = sitk.AffineTransform(2)
    transform.SetMatrix(start[:, :2].ravel().tolist())
    transform.SetTranslation(start[:, 2].tolist())
    better = descended(flat, transform, "REGULAR", 0.25)
    return start if better is None else better
