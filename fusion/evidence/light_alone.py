"""How deep cells are by what a side that sees light shows of them alone: parallax where frames tell it, and darkness.

Darkness is no code for depth: a floor is also dark where a rim shades it, or bright where a lamp meets it. So such a
depth is a guess, and its standard error says how good. It is the depth that such a side has of its dark cells; the wall
of both sides takes it where nobody measured any.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Image, Mask
from endoct.base.numeric.circle import gaussian
from endoct.base.numeric.distance import signed_distance
from endoct.base.numeric.regions import label, quantiles
from endoct.fusion.evidence.network import answers
from endoct.fusion.evidence.side import Side

FARTHEST_MM = 0.3
"""An outline farther off says no more than that it is far."""
TRUST_MM = 0.05
"""A standard error of depth by parallax of this size halves the trust in it."""
AROUND_MM, FARTHER_MM = 0.06, 0.15
"""Standard deviations of what counts around a sample."""
LEAST_WEIGHT = 0.01
"""With less of it known around, a mean is not known either."""
WIDEST_MM = 1.5
"""A wider cell is no deeper for that."""
DARKEST = 1.3
"""Of the cells that were learned hardly a sample is darker, so darker ones say no more."""
SHALLOWEST_MM, DEEPEST_MM = 0.01, 2.5
"""No cell is less deep, and no deeper floor was learned."""
ERRORS_MM = (0.03, 1.0)
"""No depth is known better or worse by light alone."""
OF_SCALE = 2.0
"""A standard error is so many scales of the Student's t, with 4 degrees of freedom, that the network learned: more than
the 1.14 of theory, since it errs alike in all cells of a bore."""


def depth_by_light(
    sample_mm: tuple[float, float], cells: Mask, darkness: Image, parallax_mm: Image, parallax_error_mm: Image
) -> tuple[Image, Image]:
    """Return how far the floors of ``cells`` lie behind the wall, and the standard error of that.

    ``sample_mm``: how far samples lie apart, (along z, along θ). Arrays (n_z, n_theta), mm, float32; darkness is −log
    of the intensity over the wall's. NaN means not known in what is given, and in what is returned: outside the cells,
    and where the darkness is not known.
    """
    relief_mm, error_mm = (np.full(cells.shape, np.nan, np.float32) for _ in range(2))
    told = cells & np.isfinite(darkness)
    if told.any():
        depth_mm, log_error = answers(
            "light", light_features(sample_mm, told, darkness, parallax_mm, parallax_error_mm)
        )
        relief_mm[told] = np.clip(depth_mm, SHALLOWEST_MM, DEEPEST_MM)
        error_mm[told] = np.clip(OF_SCALE * np.exp(log_error), *ERRORS_MM)
    return relief_mm, error_mm


def depth_of_side(side: Side, cells: Mask) -> tuple[Image, Image]:
    """Return the relief of a ``side`` without measured depth and its standard error, with its ``cells``, as above.

    Of the plain wall it is that by parallax. Nothing is known where the side observed nothing.
    """
    cells = cells & side.panorama.valid
    nowhere = np.full(cells.shape, np.nan, np.float32)
    plain = (nowhere, nowhere) if side.parallax is None else (side.parallax.relief_mm, side.parallax.error_mm)
    sample_mm = side.grid.dz_mm, side.grid.dtheta_mm
    of_cells = depth_by_light(sample_mm, cells, side.contrast("dark").values, *plain)
    relief_mm, error_mm = (np.where(cells, *of) for of in zip(of_cells, plain, strict=True))
    return relief_mm, error_mm


def light_features(
    sample_mm: tuple[float, float], cells: Mask, darkness: Image, parallax_mm: Image, parallax_error_mm: Image
) -> NDArray[np.float32]:
    """Return what tells the depth of the samples of ``cells``, float32 (13, n), 0 where something is not known.

    The darkness, and its means around; the distance to the cell's outline. Relief by parallax, the trust in it, and its
    mean around. Of the whole cell: the radius of a disc of its area, the median and the ninth decile of darkness and of
    parallax, and the share of which that is known.
    """
    labels, n = label(cells)
    known = cells & np.isfinite(parallax_mm)
    darkness, parallax_mm = np.minimum(darkness, DARKEST), np.minimum(parallax_mm, DEEPEST_MM)

    def features() -> Iterator[NDArray[np.floating]]:
        near_px, far_px = ((width_mm / sample_mm[0], width_mm / sample_mm[1]) for width_mm in (AROUND_MM, FARTHER_MM))
        yield darkness[cells]
        yield from (mean_around(darkness, cells, around_px)[cells] for around_px in (near_px, far_px))
        yield signed_distance(cells, sample_mm, FARTHEST_MM)[cells]
        yield parallax_mm[cells]
        yield TRUST_MM / (TRUST_MM + parallax_error_mm[cells])
        yield mean_around(parallax_mm, known, near_px)[cells]
        area_px, known_px = (np.bincount(labels[where], minlength=n + 1) for where in (cells, known))
        yield np.minimum(np.sqrt(area_px * np.prod(sample_mm) / np.pi), WIDEST_MM)[labels[cells]]
        for of in (darkness, parallax_mm):
            yield from (quantiles(of[cells], labels[cells], n, share)[labels[cells]] for share in (0.5, 0.9))
        yield (known_px / np.maximum(area_px, 1))[labels[cells]]

    return np.nan_to_num(np.array([*features()], np.float32), copy=False)


def mean_around(image: Image, known: Mask, sigma_px: tuple[float, float]) -> Image:
    """Return the mean of what is ``known`` around each sample, by a Gaussian over (z, θ); 0 far from all of it."""
    total, weight = (
        gaussian(part, *sigma_px) for part in (np.where(known, image, np.float32(0)), known.astype(np.float32))
    )
    return np.divide(total, weight, out=np.zeros_like(total), where=weight > LEAST_WEIGHT)
