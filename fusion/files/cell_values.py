"""Which samples of a drawn image are cell, by their values.

An image is a mask where its ground is known and the rest is of one kind: 0 and one other value, black and one colour,
or one colour on a transparent ground. Labels on a ground of 0 are cells as well. Everything else is refused with what
was found: grey values, probabilities, soft edges, pictures that were painted on, labels without a ground. Soft edges
are not cut at half, as nobody can tell them from probabilities.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from skimage.measure import label

from endoct.base.arrays import Mask
from endoct.base.errors import EndoctError

EXPECTED = "0 and one other value, or labels counted from 1 on a ground of 0"
REMEDY = "save cells as white on black, without soft edges; what lies in an overlay of Fiji, from its ROI manager"
SPARSE = 2
"""The highest of labels that were counted from 1 is at most so many times their number, as some were deleted."""
PIECES = 2
"""Other labels are names of regions: so many regions have one name at most, as the seam cuts some in two."""
WHITE = (255, 65535)
"""Nobody counts so far; this is paint."""
LEAST_REGION = 3
"""Samples of the median region, where labels touch: soft edges and grey values come in smaller ones."""
LEAST_ON_GROUND = 0.5
"""The share of its border that each label has with the ground: levels of votes or probabilities enclose each other."""


def cells_of(samples: NDArray[Any], subject: str) -> Mask:
    """Return where whole numbers, truth values or floats (n_z, n_theta) are cell.

    Raises :class:`EndoctError` where they are neither two values with 0 nor labels on a ground of 0.
    """
    if samples.dtype.kind == "f" and not np.isfinite(samples).all():
        raise _unclear(subject, "NaN or infinity")
    low, high = samples.min(), samples.max()
    if low == high:
        raise EndoctError(f"{subject} shows no cells", found=f"{low:g} everywhere", expected=EXPECTED)
    two = bool(((samples == low) | (samples == high)).all())
    if low != 0 or not (two or _are_labels(samples)):
        raise _unclear(subject, _listed(np.unique(samples)))
    return np.asarray(samples != 0)


def cells_in_colour(samples: NDArray[Any], subject: str) -> Mask:
    """Return where an image (n_z, n_theta, channel) is cell: grey or RGB, with opacity last where there are 2 or 4.

    Raises :class:`EndoctError` where it is neither one colour on a ground that is black or transparent, nor a grey
    image that :func:`cells_of` reads.
    """
    colours, opacity = (samples[..., :-1], samples[..., -1]) if samples.shape[2] in (2, 4) else (samples, None)
    if opacity is None or (opacity == opacity.max()).all():
        if opacity is not None and not opacity.any():
            raise EndoctError(f"{subject} shows no cells", found="all of it is transparent")
        if (colours == colours[..., :1]).all():
            return cells_of(colours[..., 0], subject)
        drawn = colours.any(axis=2)
        if drawn.all() or not _is_one_colour(colours[drawn]):
            kinds = np.unique(colours[drawn], axis=0)
            none = ", none of them black" if drawn.all() else ""
            raise _unclear(subject, f"{len(kinds) + (not none)} colours{none}")
        return np.asarray(drawn)
    opaque = opacity != 0
    levels = np.unique(opacity)
    if len(levels) != 2 or levels[0] != 0:
        raise _unclear(subject, f"{len(levels)} degrees of transparency")
    if not _is_one_colour(colours[opaque]):
        raise _unclear(subject, f"{len(np.unique(colours[opaque], axis=0))} colours on a transparent ground")
    return np.asarray(opaque)


def cells_by_palette(numbers: NDArray[Any], palette: NDArray[Any], subject: str) -> Mask:
    """Return where an image (n_z, n_theta) of numbers of colours is cell; ``palette``: (n, 3), or (n, 4) with opacity.

    0 is the ground, unless its colour contradicts. A palette with the colours of the image alone may have been sorted
    by a program that made the file smaller; there, what is black is the ground. Raises :class:`EndoctError` where
    nothing says which is the ground.
    """
    used = np.unique(numbers)
    ground = (palette[:, :3].max(axis=1) == 0) | (palette[:, 3:] == 0).any(axis=1)
    others = used[used > 0]
    if ground[0] and not ground[others].any():
        return cells_of(numbers, subject)
    if len(palette) > len(used) and not ground[used].any():
        return cells_of(numbers, subject)
    if len(palette) == len(used) == 2 and np.count_nonzero(ground) == 1:
        return minority(~ground[numbers], subject)
    if ground[0]:
        raise _unclear(subject, "a palette in which 0 is black or transparent, and another number is too")
    if ground[others].any():
        raise _unclear(subject, "a palette in which 0 is not black, and another number is")
    raise _unclear(subject, "a palette without black, whose order says nothing")


def minority(cells: Mask, subject: str) -> Mask:
    """Return ``cells``. Raises :class:`EndoctError` where most samples are: black and white may have changed places."""
    if cells.mean() > 0.5:
        raise _unclear(
            subject, f"{cells.mean():.0%} of it white, in a file that changes what black and white stand for"
        )
    return cells


def _are_labels(samples: NDArray[Any]) -> bool:
    """Say whether more than two values, the lowest 0, are labels of regions on that ground."""
    if samples.dtype.kind == "f" and (samples != np.rint(samples)).any():
        return False
    values, numbers = np.unique(samples, return_inverse=True)
    numbers = numbers.reshape(samples.shape).astype(np.int32)
    highest, n = values[-1], len(values) - 1
    regions, n_regions = label(numbers, connectivity=1, return_num=True)
    counted, beyond = highest <= SPARSE * n, highest > WHITE[1]
    if not (counted or beyond or (n_regions <= PIECES * n and highest not in WHITE)):
        return False
    one = np.concatenate([numbers[:-1].ravel(), numbers.ravel()])
    other = np.concatenate([numbers[1:].ravel(), np.roll(numbers, -1, axis=1).ravel()])
    differ = one != other
    one, other = one[differ], other[differ]
    border = np.bincount(np.concatenate([one, other]), minlength=n + 1)[1:]
    on_ground = np.bincount(np.concatenate([one[other == 0], other[one == 0]]), minlength=n + 1)[1:]
    if (on_ground == border).all():
        return True
    if np.median(np.bincount(regions.ravel())[1:]) < LEAST_REGION:
        return False
    return bool(beyond or (on_ground >= LEAST_ON_GROUND * border).all())  # no grey values or votes go as far as that


def _is_one_colour(colours: NDArray[Any]) -> bool:
    """Say whether all of ``colours`` (n, channel) are alike; there is one at least."""
    return bool((colours == colours[0]).all())


def _listed(values: NDArray[Any]) -> str:
    if len(values) > 4:
        return f"{len(values)} values from {values[0]:g} to {values[-1]:g}"
    return "values " + ", ".join(f"{value:g}" for value in values) + ("" if 0 in values else ", none of them 0")


def _unclear(subject: str, held: str) -> EndoctError:
    return EndoctError(f"{subject} does not say what is cell", found=held, expected=EXPECTED, remedy=REMEDY)
