"""How one would align two panoramas by mutual information, with as good a start as a search of all places gives.

SimpleITK tries all places of coarse images in all orientations that are open, which takes no polarity for granted.
From the best of them an affine map is refined, by SimpleITK (Mattes et al. 2003) or by elastix (Klein et al. 2010).
Both see A continued around by half a turn at either end, so that θ is a circle.
"""

import contextlib
import warnings
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

from endoct.base.arrays import Coordinates
from endoct.fusion.evidence.evidence import clipped, prepare
from endoct.fusion.geometry.alignment import Alignment, NotAligned
from endoct.fusion.registration.align import orientations_of
from endoct.stitching.panorama import Panorama
from endoct.workbench.bench.rivals.alignment import Flat, by_information, descended, flat_of, one_itk_thread
from endoct.workbench.bench.task import NotInstalled

SEARCHED_PX, SEARCHED_STEPS = 16, 2
"""Pixels of the search, in samples of A, and how many of them lie between two places that are tried."""
LEAST_SHARED = 0.4
"""In the search, A and B share at least this part of B's rows."""
REFINED_PX = (4, 2)
ELASTIX_LEVELS, ELASTIX_STEPS = 4, 500

Refine = Callable[[Flat, Coordinates], Coordinates]
"""(images, a matrix near the truth) → a better one; both (2, 3), from (x, y) of B to (x, y) of A, pixels."""
MARGIN = 0.25
"""Elastix sees more of A than lies under B, by this share of B's size."""


def simpleitk_searched(a: Panorama, b: Panorama) -> Alignment | NotAligned:
    """SimpleITK: an exhaustive search by Mattes' mutual information, refined by gradient descent."""
    with one_itk_thread():
        return _searched(a, b, _by_simpleitk)


def elastix_searched(a: Panorama, b: Panorama) -> Alignment | NotAligned:
    """The same search, refined by elastix' affine registration: four resolutions, stochastic gradient descent."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # ITK loads its modules as they are asked for; as errors these end the process
        try:
            import itk
        except ImportError as error:
            raise NotInstalled("itk-elastix") from error
        if not hasattr(itk, "elastix_registration_method"):  # ITK without the module
            raise NotInstalled("itk-elastix")
        with one_itk_thread():
            return _searched(a, b, lambda flat, start: _by_elastix(itk, flat, start))


def _searched(a: Panorama, b: Panorama, refine: Refine) -> Alignment | NotAligned:
    """Return the place that ``refine`` makes of the best one found in any orientation, at finer and finer pixels."""
    sides = clipped(prepare(a)), clipped(prepare(b))
    found = []
    for orientation in orientations_of(a, b):
        information, x, y = _best_place(flat_of(*sides, orientation, SEARCHED_PX))
        found.append((information, x, y, orientation))
    information, x, y, orientation = max(found)
    if not np.isfinite(information):
        return NotAligned("It found nothing.")
    matrix, before = np.array([[1, 0, x], [0, 1, y]]), SEARCHED_PX
    for px in REFINED_PX:
        matrix[:, 2] *= before / px
        before, flat = px, flat_of(*sides, orientation, px)
        matrix = refine(flat, matrix)
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


def _by_simpleitk(flat: Flat, start: Coordinates) -> Coordinates:
    import SimpleITK as sitk

    transform = sitk.AffineTransform(2)
    transform.SetMatrix(start[:, :2].ravel().tolist())
    transform.SetTranslation(start[:, 2].tolist())
    better = descended(flat, transform, "REGULAR", 0.25)
    return start if better is None else better


def _by_elastix(itk: Any, flat: Flat, start: Coordinates) -> Coordinates:
    rows, columns = flat.b.shape
    before = round(MARGIN * rows), round(MARGIN * columns)
    corner = np.array([-before[1], -before[0]], np.float64)
    shifted = np.column_stack([start[:, :2], start[:, 2] + start[:, :2] @ corner])
    size = columns + 2 * before[1], rows + 2 * before[0]
    a_there = cv2.warpAffine(flat.a, shifted, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
    moving = itk.image_view_from_array(np.ascontiguousarray(a_there))
    moving.SetOrigin(corner.tolist())
    parameters = itk.ParameterObject.New()
    affine = parameters.GetDefaultParameterMap("affine", ELASTIX_LEVELS)
    affine["RandomSeed"], affine["MaximumNumberOfIterations"] = ["121212"], [str(ELASTIX_STEPS)]
    affine["WriteResultImage"], affine["AutomaticTransformInitialization"] = ["false"], ["false"]
    parameters.AddParameterMap(affine)
    fixed = itk.image_view_from_array(np.ascontiguousarray(flat.b))
    try:
        _, found = itk.elastix_registration_method(
            fixed, moving, parameter_object=parameters, number_of_threads=1, log_to_console=False
        )
    except RuntimeError:  # where too few samples meet
        return start
    map_ = found.GetParameterMap(0)
    numbers = np.array([float(number) for number in map_["TransformParameters"]])
    centre = np.array([float(number) for number in map_["CenterOfRotationPoint"]])
    linear, moved = numbers[:4].reshape(2, 2), numbers[4:] + centre
    turned = np.column_stack([linear, moved - linear @ centre])
    return np.column_stack([start[:, :2] @ turned[:, :2], start[:, :2] @ turned[:, 2] + start[:, 2]])
