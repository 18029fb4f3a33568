"""How far what was segmented is to be believed as cells, by what the wall around it shows."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from endoct.stitching.arrays import Image, Mask
from endoct.stitching.doubt import Doubt
from endoct.stitching.robust import robust_sigma

MOST_NOISE = 0.04
"""Above this ``noise_share``, Jaccard indices against the truth were under 0.7, mostly under 0.5."""
MOST_CELLS = 0.6
"""A wall of which more than this is cells was probably missed: bores have 0.08 to 0.3."""
MOST_SPREAD = 0.185
MOST_UNCLAIMED = 0.03
"""Of 90 endoscope walls of a second generator (benchmarks/independent: sound, seeds 1300–1339 and 1500–1539, few and
many), those above one of these two scored 0.41 to 0.78 against the truth, all others 0.60 and more."""


@dataclass(frozen=True)
class Believability:
    """What speaks for cells, as shares.

    Attributes
    ----------
    noise: samples as far in front of the wall as cells lie behind it, over those; 0 without cells.
    cells: cells, over what was observed.
    spread: standard deviation of the wall's own evidence, over that by which cells stand out of it in the median.
    unclaimed: samples that stand out as cells do but have no outline, over what was observed; 0 without outlines.
    """

    noise: float
    cells: float
    spread: float
    unclaimed: float


def believability_of(
    valid: Mask, smooth: Image, mask: Mask, threshold: float, *, with_outlines: bool, dark: Mask | None = None
) -> Believability:
    """Return how far cells are to be believed.

    ``smooth``: the evidence that was thresholded, float32 (n_z, n_theta), 0 where it is that of the wall; ``mask`` the
    cells among the ``valid`` samples; ``dark`` those known by how they stand out, without what lines enclose.
    """
    observed, cells = smooth[valid], mask[valid]
    behind, before = int(np.count_nonzero(observed > threshold)), int(np.count_nonzero(-observed > threshold))
    unclaimed = int(np.count_nonzero((observed > threshold) & ~cells)) if with_outlines else 0
    known = cells if dark is None else dark[valid]
    stands_out = float(np.median(observed[known])) if known.any() else np.inf
    return Believability(
        noise=before / max(behind, 1) if cells.any() else 0.0,
        cells=float(cells.mean()),
        spread=spread_of_wall(observed) / max(stands_out, 1e-9),
        unclaimed=unclaimed / cells.size,
    )


def spread_of_wall(observed: NDArray[np.float32]) -> float:
    """Return the standard deviation of evidence where it is that of the wall, by what lies in front of it, below 0."""
    front = observed[observed < 0]
    return robust_sigma(front) if front.size else 0.0


def doubts_of_cells(found: Believability) -> Iterator[Doubt]:
    """Yield why what was segmented is not to be trusted as cells."""
    if found.noise > MOST_NOISE:
        what = (
            f"What was taken for cells may be noise: {found.noise:.0%} as many samples lie as far in front of the "
            "wall, where nothing can be."
        )
        yield Doubt("cells-in-noise", what, value=found.noise, unit="1", expected=(0.0, MOST_NOISE))
    if found.cells > MOST_CELLS:
        what = f"The wall may not have been found: {found.cells:.0%} of it was taken for cells."
        yield Doubt("wall-mostly-cells", what, value=found.cells, unit="1", expected=(0.0, MOST_CELLS))
    if found.spread > MOST_SPREAD:
        what = (
            "Cells hardly stand out of the wall: its own standard deviation is "
            f"{found.spread:.0%} of what cells differ from it by in the median. Some may be missed, some stains of the "
            "wall."
        )
        yield Doubt("cells-faint", what, value=found.spread, unit="1", expected=(0.0, MOST_SPREAD))
    if found.unclaimed > MOST_UNCLAIMED:
        what = (
            f"{found.unclaimed:.1%} of the wall is as dark as cells, but has no clear outline; cells are "
            f"{found.cells:.1%} of it. Some may be missed."
        )
        yield Doubt("cells-without-outline", what, value=found.unclaimed, unit="1", expected=(0.0, MOST_UNCLAIMED))
