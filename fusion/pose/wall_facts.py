"""What the CT has on the wall of a bore along the plan: how much air, how many cells, how like itself when turned."""

from dataclasses import dataclass

import numpy as np

from endoct.fusion.pose.air import AirAround
from endoct.fusion.pose.search import COLUMNS, ROWS_MM, unrolled
from endoct.fusion.segmentation.regions import label
from endoct.stitching.arrays import Image

BEHIND_MM = 0.1
LEAST_EDGE = 0.25
"""Change of the share of air around a row below which there is no edge of a cell: a voxel half full, blurred."""
LEAST_CHANGE = 0.02
"""Standard deviation of the share of air on a wall that has any pattern."""


@dataclass(frozen=True)
class WallFacts:
    """A wall as the CT has it.

    ``air``: share of the wall; ``cells``: connected ones that the wall meets, θ being a circle; ``longest_bare_mm`` of
    bore without an edge of a cell; ``likeness``: correlation of the wall with itself turned by ``turn_deg``, the most
    alike it is away from where it is; None where it has no pattern.
    """

    air: float
    cells: int
    longest_bare_mm: float
    likeness: float | None
    turn_deg: float | None

    @property
    def sentence(self) -> str:
        """The facts in words."""
        if self.likeness is None:
            return f"the wall has {self.cells} cells, {self.air:.0%} air, and no pattern"
        return (
            f"the wall has {self.cells} cells, {self.air:.0%} air, at most {self.longest_bare_mm:.1f} mm without an "
            f"edge, and is like itself when turned by {self.turn_deg:.0f}° (correlation {self.likeness:.2f})"
        ).replace("-", "−")


def wall_of_plan(air: AirAround, radius_mm: float) -> Image:
    """Return the share of air just behind the wall of a bore along the plan, (n_z, n_theta), rows from its entry on."""
    rows = np.arange(0, air.length_mm + 1e-9, ROWS_MM)
    return np.asarray(unrolled(air, np.zeros((1, 4)), rows, radius_mm + BEHIND_MM)[0].cpu().numpy(), dtype=np.float32)


def facts_of(wall: Image) -> WallFacts:
    """Return the facts of a wall (n_z, n_theta) as :func:`wall_of_plan` gives it."""
    along = np.abs(np.diff(wall, axis=0, append=wall[-1:])).max(axis=1)
    edges = np.maximum(np.ptp(wall, axis=1), along) >= LEAST_EDGE
    bare = np.diff(np.flatnonzero(np.concatenate([[True], edges, [True]]))) - 1
    likeness, turn_deg = _likeness(wall)
    return WallFacts(
        air=float(wall.mean()),
        cells=label(wall > 0.5)[1],
        longest_bare_mm=float(bare.max()) * ROWS_MM,
        likeness=likeness,
        turn_deg=turn_deg,
    )


def _likeness(wall: Image) -> tuple[float | None, float | None]:
    """Return the highest correlation of a wall with itself turned, beyond the first trough, and that turn."""
    centred = wall.astype(np.float64) - wall.mean()
    if centred.std() < LEAST_CHANGE:
        return None, None
    power = np.abs(np.fft.rfft(centred, axis=1)) ** 2
    like = np.fft.irfft(power.sum(axis=0), n=COLUMNS)
    like = like[: COLUMNS // 2 + 1] / like[0]
    falling = np.diff(like) < -1e-6
    trough = COLUMNS // 2 if falling.all() else max(1, int(np.argmin(falling)))
    best = trough + int(np.argmax(like[trough:]))
    return float(like[best]), best * 360 / COLUMNS
