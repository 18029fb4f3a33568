"""What a pose rests on, and what is doubted of it.

It rests on edges of cells along the bore, and is doubted where its sides show few. It is also doubted where the CT may
be a mirror image of what was recorded.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from endoct.base.doubt import Doubt
from endoct.fusion.pose.observation import Observation
from endoct.fusion.pose.pose import BEYOND_MM, BorePose
from endoct.fusion.pose.wall import Sense

OPEN = "handedness-open"
"""The code of the doubt where no side settles which way θ runs."""
LEAST_EDGE = 0.5
"""A row shows an edge where its clearest one has more weight than this; an edge that is half air has 1."""
LONG_BARE_MM = 8.0
"""A stretch without an edge is doubted from this length on, a third of a usual bore."""
WIDE_MM, TOO_WIDE_MM = 0.5, 1.0
"""Half of the long axis of the 95 % ellipse beyond the target; surgery at the facial recess asks for 0.3 to 0.5 mm."""
CLEAR_STANDING = 3.5
"""A pattern stands clear of the controls from so many of their spreads on."""
REACH = float(np.sqrt(stats.chi2.ppf(0.95, 2)))


@dataclass(frozen=True)
class BareStretch:
    """Depths, mm from the planned entry, between which the observed wall shows no edge of a cell."""

    from_mm: float
    to_mm: float

    @property
    def length_mm(self) -> float:
        """How long it is."""
        return self.to_mm - self.from_mm


def longest_bare_stretch(pose: BorePose) -> BareStretch:
    """Return the longest stretch of the bore, as far as any side observed it, in which none shows an edge."""
    return max(_bare_stretches(pose), key=lambda stretch: stretch.length_mm)


def drawn_on(pose: BorePose) -> list[BareStretch]:
    """Return where the axis is drawn on from the rest: long bare stretches, and what no side observed of the plan."""
    bare = _bare_stretches(pose)
    unseen = BareStretch(0.0, bare[0].from_mm), BareStretch(bare[-1].to_mm, pose.plan.length_mm)
    return [
        *(stretch for stretch in unseen if stretch.length_mm > 0),
        *(stretch for stretch in bare if stretch.length_mm >= LONG_BARE_MM),
    ]


def _bare_stretches(pose: BorePose) -> list[BareStretch]:
    """Return the stretches between rows with edges, from the first depth that any side observed to the last."""
    seen, edges = [], []
    for name, side in zip(pose.names, pose.fit.sides, strict=True):
        depths = pose.depth_of(name, side.z_mm)
        seen += [float(depths.min()), float(depths.max())]
        edges += depths[shows_edges(side)].tolist()
    return [BareStretch(*ends) for ends in pairwise([min(seen), *sorted(edges), max(seen)])]


def shows_edges(side: Observation) -> NDArray[np.bool_]:
    """Return which rows of a side show an edge of a cell, bool (n_z,)."""
    layer = side.layers[0]
    return np.asarray((4 * layer.air * (1 - layer.air) * layer.weight).max(axis=1) > LEAST_EDGE)


def ellipse_mm(pose: BorePose) -> float:
    """Return half the long axis of the 95 % ellipse across the bore, ``BEYOND_MM`` beyond the plan's target."""
    covariance = pose.axis_covariance(pose.plan.length_mm + BEYOND_MM)
    return REACH * float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))


def too_wide(pose: BorePose) -> str | None:
    """Return why the edges that a pose rests on leave it open, None where they do not."""
    if (reach := ellipse_mm(pose)) <= TOO_WIDE_MM:
        return None
    bare = longest_bare_stretch(pose)
    return (
        f"the edges of cells leave open where the bore lies: {BEYOND_MM:g} mm beyond the target by up to {reach:.1f} "
        f"mm, {TOO_WIDE_MM:g} mm at most ({bare.length_mm:.1f} mm of the bore are without an edge)"
    )


def support_doubts(pose: BorePose, standing: Sequence[float]) -> Iterator[Doubt]:
    """Yield what is doubted of a pose that is told; ``standing`` is that of the sides that can tell it alone."""
    bare = longest_bare_stretch(pose)
    if bare.length_mm >= LONG_BARE_MM:
        what = (
            f"{bare.length_mm:.1f} mm of the bore show no edge of a cell, from {bare.from_mm:.1f} to {bare.to_mm:.1f} "
            "mm depth: the axis is drawn on there from the rest"
        )
        yield Doubt("long-bare-stretch", what, value=bare.length_mm, unit="mm", expected=(0.0, LONG_BARE_MM))
    if (reach := ellipse_mm(pose)) > WIDE_MM:
        what = (
            f"{BEYOND_MM:g} mm beyond the target the axis is known to {reach:.1f} mm only; {WIDE_MM:g} mm are asked for"
        )
        yield Doubt("wide-ellipse", what, value=reach, unit="mm", expected=(0.0, WIDE_MM))
    if standing and (highest := max(standing)) < CLEAR_STANDING:
        what = (
            f"the pattern stands {highest:.1f} spreads above rearranged ones, {CLEAR_STANDING:g} are clear: "
            "it may lie elsewhere"
        )
        yield Doubt("weak-pattern", what, value=highest, unit="1")


def mirror_reason(side: str) -> str:
    """Return why nothing is told where a side's mirror image fits."""
    return (
        f"the {side}, of which the sense of θ is known, fits the mirror image of the CT: the CT is mirrored, or "
        "it is of the other ear"
    )


def open_handedness(sides: Sequence[tuple[str, Sense]]) -> Doubt:
    """Return the doubt about a pose that rests on sides of unknown sense of θ, each with the sense that fits."""
    names = " and ".join(name for name, _ in sides)
    fits = ", ".join(f'"{"mirrored" if sense.turning < 0 else "same"}" for {name}' for name, sense in sides)
    return Doubt(
        OPEN,
        f"the sense of θ of {names} is not known: a mirrored CT, or one of the other ear, would fit as well, at a "
        f"place that is wrong. This pose holds only if handedness is {fits}: state it in the sidecar",
    )
