"""How well a bore along a plan could be found from its recordings: rehearsals in the CT, before any recording.

The CT also shows the wall of such a bore. It says how much air and how many cells it has, and how much the wall
resembles itself when turned.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from endoct.base.arrays import Image
from endoct.base.numeric.circle import wrap_rad
from endoct.base.numeric.regions import label
from endoct.fusion.pose.air import AirAround
from endoct.fusion.pose.finding import SidePose, differ, find_alone, summary
from endoct.fusion.pose.pose import BEYOND_MM, BorePose
from endoct.fusion.pose.rehearsal import Instrument, Rehearsal, rehearse
from endoct.fusion.pose.search import COLUMNS, ROWS_MM, unrolled
from endoct.fusion.pose.wall import TURN
from endoct.modalities.ct.trajectory import Trajectory

BEHIND_MM = 0.1
LEAST_EDGE = 0.25
"""Where the share of air around a row changes by less, there is no edge of a cell: a voxel half full, blurred."""
LEAST_CHANGE = 0.02
"""A wall has a pattern where the standard deviation of its share of air is at least this."""
REHEARSALS = 6
"""Rehearsals of each instrument: about a minute of one core for both."""
SEED = 2017
LARGEST_ERROR_MM = 0.5
"""Largest error at the target of a pose that is told well: surgery at the facial recess asks for 0.3 to 0.5 mm."""
Level = Literal["well", "poorly", "hardly"]
LEVELS: tuple[Level, ...] = ("hardly", "poorly", "well")


@dataclass(frozen=True)
class WallFacts:
    """A wall as the CT has it.

    Attributes
    ----------
    air: the share of the wall that is air.
    cells: connected cells that the wall meets; θ is a circle.
    longest_bare_mm: the longest stretch of bore without an edge of a cell.
    likeness: correlation of the wall with itself when turned by ``turn_deg``, where it is highest away from 0. None
        where the wall has no pattern.
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
    """Return the share of air just behind the wall of a bore along the plan, (n_z, n_theta), from its entry on."""
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


@dataclass(frozen=True)
class Tried:
    """One rehearsal: a bore that misses its plan by chance, and where its recording would have been found.

    Attributes
    ----------
    reason: why it would not have been told; None where it would.
    right: whether the place that was found is the true one.
    error_mm: error of the point 5 mm beyond the plan's target.
    turn_deg: error of the roll.
    deviation_mm: standard deviation of the axis at that point, as the fit states it.
    agreement: of the fit.
    second: agreement of the best place apart from it; None where all starts met.
    """

    reason: str | None
    right: bool
    error_mm: float
    turn_deg: float
    deviation_mm: float
    agreement: float
    second: float | None

    @property
    def told(self) -> bool:
        """Whether the pose would have been told."""
        return self.reason is None


@dataclass(frozen=True)
class Prospect:
    """How the rehearsals of one kind of instrument went."""

    instrument: str
    tried: tuple[Tried, ...]

    @property
    def n_told(self) -> int:
        """Rehearsals told at the true place."""
        return sum(one.told and one.right for one in self.tried)

    @property
    def n_misled(self) -> int:
        """Rehearsals told at a wrong place."""
        return sum(one.told and not one.right for one in self.tried)

    @property
    def median_mm(self) -> float | None:
        """Median error of those told; None where none was."""
        return float(np.median(self._errors_mm)) if self._errors_mm else None

    @property
    def largest_mm(self) -> float | None:
        """Largest error of those told; None where none was. So few have no 95th percentile."""
        return max(self._errors_mm, default=None)

    @property
    def level(self) -> Level:
        """Well: each is told, rightly and as precisely as surgery asks. Hardly: fewer than half are told rightly."""
        if 2 * self.n_told < len(self.tried):
            return "hardly"
        all_told = self.n_told == len(self.tried)
        return "well" if all_told and max(self._errors_mm) <= LARGEST_ERROR_MM else "poorly"

    @property
    def _errors_mm(self) -> list[float]:
        return [one.error_mm for one in self.tried if one.told]


@dataclass(frozen=True)
class Outlook:
    """How well a bore could be told, by each kind of instrument alone, and what the CT has on its wall."""

    facts: WallFacts
    prospects: tuple[Prospect, ...]

    @property
    def level(self) -> Level:
        """That of the best instrument: the pose is told where one side can."""
        return max((one.level for one in self.prospects), key=LEVELS.index)

    @property
    def sentence(self) -> str:
        """The verdict and why."""
        return f"could be told {self.level}, because {'; '.join(map(_went, self.prospects))}; {self.facts.sentence}"


def rehearsed(
    air: AirAround, instrument: Instrument, radius_mm: float, seen_mm: float, number: int, device: str = "cpu"
) -> Tried:
    """Return how the ``number``-th rehearsal goes, searched on ``device``: the same for the same CT and plan."""
    # the same bores for every instrument
    rehearsal = rehearse(air, instrument, radius_mm, seen_mm, np.random.default_rng([SEED, number]))
    return _judged(rehearsal, find_alone(air.to(device), rehearsal.shown), air.length_mm)


def _judged(rehearsal: Rehearsal, alone: SidePose, length_mm: float) -> Tried:
    plan = Trajectory((0.0, 0.0, 0.0), (0.0, 0.0, length_mm))
    side, fit = rehearsal.shown, alone.fit
    true_fit = replace(fit, parameters=rehearsal.parameters.numpy())
    pose, true = BorePose(plan, fit), BorePose(plan, true_fit)
    last, target_mm = side.z_mm[-1:], length_mm + BEYOND_MM
    # as far beyond the last observed row as the target truly is
    depth_mm = float((pose.depth_of(side.name, last) + target_mm - true.depth_of(side.name, last))[0])
    off = pose.axis_lps(np.array([depth_mm])) - true.axis_lps(np.array([target_mm]))
    return Tried(
        reason=alone.reason,
        right=not differ(summary(fit), summary(true_fit), length_mm),
        error_mm=float(np.linalg.norm(off)),
        turn_deg=float(np.degrees(wrap_rad(fit.of_side(0)[TURN] - true_fit.of_side(0)[TURN]))),
        deviation_mm=float(np.sqrt(np.trace(pose.axis_covariance(depth_mm)))),
        agreement=fit.agreement[0],
        second=alone.second,
    )


def _went(prospect: Prospect) -> str:
    said = f"{prospect.n_told} of {len(prospect.tried)} rehearsals by {prospect.instrument} were told"
    if prospect.median_mm is not None and prospect.largest_mm is not None:
        said += f", {prospect.median_mm:.2f} mm off at the target (at most {prospect.largest_mm:.2f})"
    return f"{said}, and {prospect.n_misled} at a wrong place" if prospect.n_misled else said
