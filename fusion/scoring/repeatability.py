"""How well a score repeats when one specimen is recorded or drawn again."""

from collections.abc import Sequence

import numpy as np

FEWEST_SPECIMENS = 2


def repeatability(groups: Sequence[Sequence[float]]) -> dict[str, float | int | None] | None:
    """Return how values of one specimen scatter, ``groups`` the values of each; None where none was repeated.

    From the one-way analysis of variance with specimens as the factor: ``within_sd`` the root of the mean square
    within specimens; ``repeatability`` = 1.96 √2 within_sd, below which 95 % of differences of two repeats lie (Bland
    and Altman 1999, doi:10.1177/096228029900800204); ``between_sd``; ``icc`` the intraclass correlation ICC(1,1)
    (Shrout and Fleiss 1979, doi:10.1037/0033-2909.86.2.420), for unequal numbers of repeats by their mean size k₀,
    None with one specimen or where nothing varies.
    """
    values = [np.asarray(group, dtype=np.float64) for group in groups if len(group)]
    n, total = len(values), sum(group.size for group in values)
    if total <= n:
        return None
    within = sum(float(((group - group.mean()) ** 2).sum()) for group in values) / (total - n)
    figures: dict[str, float | int | None] = {
        "specimens": n,
        "comparisons": total,
        "within_sd": float(np.sqrt(within)),
        "repeatability": float(1.96 * np.sqrt(2 * within)),
        "between_sd": None,
        "icc": None,
    }
    if n >= FEWEST_SPECIMENS:
        mean = float(np.concatenate(values).mean())
        between = sum(group.size * (float(group.mean()) - mean) ** 2 for group in values) / (n - 1)
        size = (total - sum(group.size**2 for group in values) / total) / (n - 1)
        figures["between_sd"] = float(np.sqrt(max(between - within, 0.0) / size))
        if between + within > 0:
            figures["icc"] = float((between - within) / (between + (size - 1) * within))
    return figures
