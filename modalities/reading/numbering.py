"""Where frames lie along the travel, by the numbers or times in their files: evenly, with gaps, or unevenly."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.modalities.reading.remarks import NONE, Remarks, doubted

LEAST_REGULAR = 0.8
"""Where this share of the steps is equal, that is the usual step; else it is the median."""
WITHIN = 0.25
"""A step may differ from a whole number of usual steps by this share of one."""
FINE = 20
"""Steps of this many times the resolution or more may jitter, as times and measured places do."""
EXACT = 1e-6
LEAST_USUAL = 0.5
"""At least this share of the steps is no gap."""
MOST_DRIFT_SHARE = 0.01
MOST_DRIFT = 0.5
"""Where all frames lie evenly, one may lie this share of the usual step off its place."""
GAP_STEPS = 1.5
OTHER_PITCH = 0.05
"""The millimetres in names may differ from the pitch of the sidecar by this share."""
OTHER_RATE = 0.02
"""Time stamps that differ from the frame rate of the sidecar by no more than this share are of that rate."""
MOST_MISSING = 3
"""Where there are more than this many times as many places as frames, numbers rather begin anew than count missing
frames."""
Positions = tuple[float, ...] | None


@dataclass(frozen=True, eq=False)
class Spacing:
    """``usual``: the step between neighbours; ``places``: float64 (n,), in usual steps from the first.

    Even places, and those with gaps, are whole numbers: what neighbours jitter is that of a clock.
    """

    kind: Literal["even", "gaps", "uneven"]
    usual: float
    places: Coordinates


def spacing_of(values: Sequence[float] | Coordinates, resolution: float = 0.0, within: float = WITHIN) -> Spacing:
    """Return how ``values``, one a frame in their order, are spaced; fewer than three are even.

    Values that do not ascend are uneven, and so are steps that are no multiples of the usual one. ``resolution``: the
    least difference that values can have; where the usual step is not much more, it is counted exactly. ``within``: by
    how much of the usual step one may differ from a whole number of them.
    """
    along = np.asarray(values, dtype=np.float64)
    n = along.size
    if n < 3:
        return Spacing("even", float(np.ptp(along)) if n > 1 else 0.0, np.arange(n, dtype=np.float64))
    steps = np.diff(along)
    usual = _usual(steps)
    if not np.isfinite(along).all() or usual <= 0 or (steps <= 0).any():
        return Spacing("uneven", max(usual, 0.0), np.arange(n, dtype=np.float64))
    places = (along - along[0]) / usual
    whole = np.rint(steps / usual)
    exact = usual < FINE * resolution
    within, most_drift = (EXACT, EXACT) if exact else (within, within if within < WITHIN else MOST_DRIFT)
    slope = (along[-1] - along[0]) / (n - 1)
    off_line = np.abs(along - along[0] - slope * np.arange(n)) / slope
    if (whole == 1).all() and off_line.max() <= most_drift and (np.abs(steps / usual - 1) <= 2 * within).all():
        return Spacing("even", usual, np.arange(n, dtype=np.float64))
    if (whole >= 1).all() and (np.abs(steps / usual - whole) <= within).all() and (whole == 1).mean() >= LEAST_USUAL:
        counted = np.concatenate([[0.0], np.cumsum(whole)])
        if np.abs(places - counted).max() <= max(most_drift, MOST_DRIFT_SHARE * n):
            return Spacing("gaps", usual, counted)
    return Spacing("uneven", usual, places)


def _usual(steps: Coordinates) -> float:
    values, counts = np.unique(steps, return_counts=True)
    if counts.max() >= LEAST_REGULAR * steps.size:
        return float(values[np.argmax(counts)])
    return float(np.median(steps))


@dataclass(frozen=True, eq=False)
class Along:
    """What a recording's files say of where its frames lie: ``values``, float64 (n,), in the order of the frames.

    In mm, in s, or, without a ``unit``, counts. ``by``: what says so, in words. ``decimal``: they are no whole numbers
    and may be mm; ``resolution``: the least by which they can differ. ``within``: the share of a
    step by which they jitter.
    """

    values: Coordinates
    unit: Literal["", "mm", "s"]
    by: str
    decimal: bool = False
    resolution: float = 0.0
    within: float = WITHIN


def positions_along(
    along: Along | None, pitch_mm: float, rate_hz: float | None = None, *, steady: bool = False
) -> tuple[Positions, Remarks]:
    """Return the place of every frame along the travel, mm from the first, None where all lie evenly; and remarks.

    ``pitch_mm`` is the nominal distance of neighbours, ``rate_hz`` the stated frame rate. ``steady``: the instrument
    moves at a stated speed, so that times are places.
    """
    if along is None:
        return None, NONE
    spacing = spacing_of(along.values, along.resolution, along.within)
    usual, remarks = spacing.usual, NONE
    if (
        (along.unit == "mm" or along.decimal)
        and spacing.kind != "uneven"
        and usual > 0
        and abs(usual / pitch_mm - 1) > OTHER_PITCH
    ):
        what = (
            f"By {along.by}, read as mm, frames lie {usual:g} mm apart, by the sidecar {pitch_mm:g} mm; they were "
            "placed by the sidecar."
        )
        remarks += doubted("names-against-pitch", what, usual, pitch_mm, "mm")
    if along.unit == "s" and rate_hz is not None and abs(usual * rate_hz - 1) <= OTHER_RATE:
        usual = 1 / rate_hz
    if spacing.kind == "even":
        return None, remarks
    if spacing.kind == "uneven" and (not np.all(np.diff(along.values) > 0) or along.unit == ""):
        what = (
            f"By {along.by} frames do not lie at even steps, nor at multiples of one; they were placed evenly. Where "
            "places are known, state positions_mm."
        )
        return None, remarks + doubted("frames-uneven", what)
    if spacing.kind == "uneven" and along.unit == "mm":
        note = f"Frames lie at uneven places in mm by {along.by}, and were placed so."
        return _from_first(along.values, 1.0), remarks + Remarks(notes=(note,))
    if spacing.kind == "uneven":
        if steady and rate_hz is not None:
            usual = 1 / rate_hz
            note = f"Frames were not taken at an even rate; they were placed by {along.by}."
            remarks += Remarks(notes=(note,))
        else:
            what = (
                f"By {along.by} frames were not taken at even steps. They were placed by time, as if the instrument "
                "moved evenly; where it did not, state positions_mm."
            )
            remarks += doubted("frames-uneven", what)
        return _from_first(along.values, pitch_mm / usual), remarks
    if spacing.places[-1] + 1 > MOST_MISSING * len(spacing.places):
        n_places, n = float(spacing.places[-1] + 1), len(spacing.places)
        what = (
            f"By {along.by} {n_places - n:.0f} frames are missing between {n}: the count may have begun anew, and the "
            "order be another."
        )
        remarks += doubted("frames-mostly-missing", what, n_places, n)
    return _from_first(spacing.places, pitch_mm), remarks


def notes_on_gaps(positions_mm: Sequence[float] | None) -> tuple[str, ...]:
    """Return a sentence on frames that are missing between ``positions_mm``, none where there is no gap."""
    if positions_mm is None or len(positions_mm) < 3:
        return ()
    steps = np.abs(np.diff(positions_mm))
    gaps = np.flatnonzero(steps > GAP_STEPS * np.median(steps))
    if not gaps.size:
        return ()
    widest = int(gaps[np.argmax(steps[gaps])])
    return (
        f"Frames are missing in {gaps.size} place{'s' if gaps.size > 1 else ''}, at the widest {steps[widest]:.2f} mm "
        f"between frames {widest} and {widest + 1}; what lies beyond was placed by the nominal pitch.",
    )


def _from_first(values: Coordinates, scale: float) -> Positions:
    return tuple(float(value) for value in (values - values[0]) * scale)
