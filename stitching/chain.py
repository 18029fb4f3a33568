"""Places along a chain from what is known of the steps between them, some of which are wrong."""

import numpy as np
from scipy.linalg import solveh_banded

from endoct.stitching.arrays import Coordinates, Mask
from endoct.stitching.circle import wrap_rad


def robust_chain(
    prior: Coordinates,
    prior_sigma: Coordinates,
    links: list[tuple[int, Coordinates, Mask]],
    sigma: float,
    *,
    cyclic: bool,
) -> tuple[Coordinates, Mask]:
    """Return places (n,) by least squares with Cauchy weights on the links, and which links of step 1 agree.

    ``links`` are (step, place[k + step] − place[k], whether to be trusted). Iteratively reweighted; the normal
    equations have two bands next to the diagonal. The first place is 0.
    """
    n = prior.size + 1
    _, value, trusted = links[0]
    place = np.concatenate([[0.0], np.cumsum(np.where(trusted, value, prior))])

    def misfit(step: int, value: Coordinates) -> Coordinates:
        off = np.nan_to_num(value) - (place[step:] - place[:-step])
        return wrap_rad(off) if cyclic else off

    terms = [(1, prior, 1 / prior_sigma**2)]
    terms += [(step, value, np.where(trusted, 1 / sigma**2, 0.0)) for step, value, trusted in links]
    widths = [2.0**k for k in range(8, 0, -1)] + [1.0] * 30  # wide first: a wrong link at the start must not decide
    for width in widths:
        bands, right = np.zeros((3, n)), np.zeros(n)
        bands[2, 0] = 1e12
        for step, value, certainty in terms:
            off = misfit(step, value)
            weight = certainty / (1 + off**2 * certainty / (3 * width) ** 2)
            bands[2, :-step] += weight
            bands[2, step:] += weight
            bands[2 - step, step:] -= weight
            right[step:] += weight * off
            right[:-step] -= weight * off
        change = solveh_banded(bands[-min(3, n) :], right)
        place = place + change
        if width == 1.0 and np.abs(change).max() < 1e-7:
            break
    step, value, trusted = links[0]
    return place, ~trusted | (np.abs(misfit(step, value)) <= 6 * sigma)
