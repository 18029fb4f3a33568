"""Least squares over a model of an instrument, and how large the errors of its parameters are.

Residuals are in standard errors; the scale of each group is that of its own residuals. What lies close together on a
tube errs alike. So the residuals of a cluster are summed before they are squared (a sandwich estimator): many points of
one place do not count as many.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Mask
from endoct.base.errors import NotSeen
from endoct.base.numeric.ranks import SIGMA_PER_MEDIAN

ROUNDS = 4
STRAY_SIGMAS = 4.0
LEAST_SIGMA = 1e-3
"""No group's standard error is taken for less than this, mm."""
MOST_SCATTER_MM = 0.05
"""Points that lie on marks scatter by no more than this."""


@dataclass(frozen=True, eq=False)
class TubeFit:
    """``values`` (k,) of a model's parameters with their ``covariance``; ``kept``, bool (n,), the points that count;
    ``residual_mm`` (n,) of all points.
    """

    values: Coordinates
    covariance: Coordinates
    kept: Mask
    residual_mm: Coordinates

    def sigma_of(self, function: Callable[[Coordinates], Coordinates]) -> Coordinates:
        """Return the standard errors of what follows from the parameters, float64 (m,), to first order."""
        scale = np.sqrt(np.diag(self.covariance))
        steps = np.where(scale > 0, 1e-2 * scale, 1e-9)
        slopes = np.stack(
            [
                (function(self.values + step) - function(self.values - step)) / (2 * step.max())
                for step in np.diag(steps)
            ],
            axis=-1,
        )
        return np.asarray(np.sqrt(np.einsum("...i,ij,...j->...", slopes, self.covariance, slopes)))


def fit_model(
    distances_mm: Callable[[Coordinates], Coordinates],
    start: Coordinates,
    expected: Coordinates,
    sigma: Coordinates,
    groups: NDArray[np.intp],
    clusters: NDArray[np.intp],
) -> TubeFit:
    """Return the parameters at which ``distances_mm`` (n,) of all points from the model are least.

    ``expected`` (k,) with its standard errors ``sigma`` (k,), infinite where nothing is known beforehand. ``groups``
    (n,): points of one scale of errors; ``clusters`` (n,): points that err alike. Raises :class:`NotSeen` where the
    points do not fit any parameters.
    """
    from scipy.optimize import least_squares  # takes a while to load

    values = start.copy()
    known = np.flatnonzero(np.isfinite(sigma))
    residual = distances_mm(values)
    kept = np.isfinite(residual)
    scale = _scales(residual, kept, groups, least=0.02)

    def weighed(at: Coordinates) -> Coordinates:
        of_points = distances_mm(at)[kept] / scale[groups][kept]
        return np.concatenate([of_points, (at[known] - expected[known]) / sigma[known]])

    jacobian: Coordinates = np.zeros((0, values.size))
    for _ in range(ROUNDS):
        found = least_squares(weighed, values, x_scale="jac", max_nfev=60)
        values, jacobian = found.x, found.jac
        residual = distances_mm(values)
        scale = _scales(residual, kept, groups, least=LEAST_SIGMA)
        kept = np.abs(residual) < STRAY_SIGMAS * scale[groups]
        if np.count_nonzero(kept) < values.size:
            break
    if np.count_nonzero(kept) < values.size or scale.max() > MOST_SCATTER_MM:
        raise NotSeen(
            "the marks of the tube do not fit each other",
            found=f"{np.count_nonzero(kept)} points that scatter by {1000 * scale.max():.0f} µm",
            expected=f"less than {1000 * MOST_SCATTER_MM:.0f} µm",
            remedy="check that tube.toml is that of this tube",
        )
    found = least_squares(weighed, values, x_scale="jac", max_nfev=60)
    values, jacobian = found.x, found.jac
    residual = distances_mm(values)
    return TubeFit(values, _covariance(jacobian, found.fun, clusters[kept]), kept, residual)


def _scales(residual: Coordinates, kept: Mask, groups: NDArray[np.intp], least: float) -> Coordinates:
    """Return the robust standard deviation of every group's residuals, mm."""
    scales = np.full(int(groups.max()) + 1, least)
    for group in np.unique(groups):
        of_group = np.abs(residual[kept & (groups == group)])
        if of_group.size:
            scales[group] = max(SIGMA_PER_MEDIAN * float(np.median(of_group)), least)
    return scales


def _covariance(jacobian: Coordinates, residual: Coordinates, clusters: NDArray[np.intp]) -> Coordinates:
    """Return the covariance of the parameters; the rows of ``jacobian`` beyond the points are what was known before."""
    n, k = clusters.size, jacobian.shape[1]
    bread = np.linalg.pinv(jacobian.T @ jacobian)
    number = np.unique(clusters, return_inverse=True)[1]
    pull = np.zeros((int(number.max()) + 1, k))
    np.add.at(pull, number, jacobian[:n] * residual[:n, None])
    # what the points were fitted by takes from their residuals, cluster by cluster
    fitted = float(np.trace(bread @ jacobian[:n].T @ jacobian[:n]))
    few = len(pull) / max(len(pull) - fitted, 1.0)
    before = jacobian[n:]
    meat = few * pull.T @ pull + before.T @ before
    return np.asarray(bread @ meat @ bread)
