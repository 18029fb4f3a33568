"""Least squares with honest errors: what a line's fit is off by, over what it says, in many draws."""

import numpy as np
import pytest
from tolerances import TUBE_SIGMA_REL

from endoct.base.errors import NotSeen
from endoct.modalities.tube.fitting import TubeFit, fit_model

X = np.linspace(-1, 1, 240)
PLACE = np.repeat(np.arange(40), 6)


def line(rng: np.random.Generator, common_mm: float, sigma: tuple[float, float] = (np.inf, np.inf)) -> TubeFit:
    truth = 0.02 + 0.03 * X
    noise = 0.005 * rng.standard_normal(X.size) + common_mm * rng.standard_normal(40)[PLACE]
    noise[::60] += 0.3  # what is no mark
    return fit_model(
        lambda at: truth + noise - at[0] - at[1] * X,
        np.zeros(2),
        np.zeros(2),
        np.array(sigma),
        np.zeros(X.size, np.intp),
        PLACE,
    )


@pytest.mark.parametrize("common_mm", [0.0, 0.01])
def test_stated_errors_are_those_made(common_mm: float) -> None:
    rng = np.random.default_rng(3)
    fits = [line(rng, common_mm) for _ in range(60)]
    off = np.array([fit.values - (0.02, 0.03) for fit in fits])
    sigmas = np.array([np.sqrt(np.diag(fit.covariance)) for fit in fits])
    np.testing.assert_allclose(np.sqrt(np.mean((off / sigmas) ** 2, axis=0)), 1, atol=TUBE_SIGMA_REL)


def test_what_is_known_beforehand_counts() -> None:
    fit = line(np.random.default_rng(4), 0.0, sigma=(np.inf, 1e-5))
    assert abs(fit.values[1]) < 1e-4
    assert np.sqrt(fit.covariance[1, 1]) == pytest.approx(1e-5, rel=0.05)
    assert not fit.kept[::60].any()


def test_errors_of_what_follows() -> None:
    fit = line(np.random.default_rng(5), 0.0)
    both = fit.sigma_of(lambda at: np.array([2 * at[0], at[0] + at[1]]))
    c = fit.covariance
    np.testing.assert_allclose(both, [2 * np.sqrt(c[0, 0]), np.sqrt(c[0, 0] + c[1, 1] + 2 * c[0, 1])], rtol=1e-6)


def test_points_of_nothing_are_refused() -> None:
    scattered = 0.2 * np.random.default_rng(6).standard_normal(X.size)
    with pytest.raises(NotSeen, match="do not fit each other"):
        fit_model(
            lambda at: scattered - at[0],
            np.zeros(1),
            np.zeros(1),
            np.array([1.0]),
            np.zeros(X.size, np.intp),
            PLACE,
        )
