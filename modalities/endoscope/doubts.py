"""What a recording says against the ring that was found in it: whether it is the mirror's, and shows a wall go by."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from endoct.base.arrays import Coordinates, Mask
from endoct.base.doubt import Doubt
from endoct.modalities.endoscope.frames import Frames
from endoct.modalities.endoscope.mirror.movement import NOISE_SHARE, movement_in_thirds, movement_within
from endoct.modalities.endoscope.mirror.overlay import share_of_ring
from endoct.modalities.endoscope.mirror.ring_search import NOT_ROUND, FoundRing, Reference, Roundness
from endoct.stitching.motion.feed import Feed

FARTHEST_APART = 0.06
"""Largest distance between the centres of a mirror's rims, as a share of the outer radius. It is below 0.025 in both
simulators, and 0.12 where the end of a bore was taken for a rim."""
MOST_SPREAD = 0.015
"""Largest interquartile range of a rim's radius over the frames, as a share of the outer radius. It is below 0.005 in
both simulators."""
MOST_SATURATED = 0.25
DARK_CIRCLE = 0.4
"""Least brightness of a wall over three quarters of the way around, as a share of that in the brightest frame. It is
above 0.75 in both simulators, and 0.11 beyond the end of a bore."""
LEAST_MATCHED = 0.5
STILL_WITHIN = 0.25
"""Largest movement inside the ring, as a share of that in it. Noise alone makes 0.2 at the faintest light."""


@dataclass(frozen=True)
class RingEvidence:
    """Ratios by which the ring is judged.

    ``apart``: of its rims' centres, over the outer radius. ``spread``: by how much the middle half of the frames differ
    in the inner and in the outer rim's radius, over the outer radius; None where too few show them. ``darkest``: least
    brightness of a whole circle of the ring in any frame, over that of the same circle in the brightest frame.
    ``saturated``: share of the ring in the median frame. ``matched``: share of neighbouring frames whose wall could be
    matched, None for a single frame. ``moving``, ``moving_within``: how much what is seen changes in the inner, middle
    and outer third of the ring, and inside it, over what noise does; None for a single frame. ``roundness`` of the
    outer rim, and whether that was ``corrected``.
    """

    apart: float
    spread: tuple[float, float] | None
    darkest: float
    saturated: float
    matched: float | None
    moving: tuple[float, float, float] | None
    moving_within: float | None
    roundness: Roundness
    corrected: bool


def evidence_of_ring(frames: Frames, reference: Reference, rows: Coordinates, feed: Feed) -> RingEvidence:
    """Return the evidence on the ring of a recording; ``rows`` (n, n_rows): logarithm of how bright its circles are."""
    ring, own_px = frames.annuli[0], frames.own_radii_px[np.isfinite(frames.own_radii_px).all(axis=1)]
    spread = np.ptp(np.quantile(own_px, (0.25, 0.75), axis=0), axis=0) / ring.outer_px if len(own_px) > 1 else None
    moving, moving_within = _movement(reference.ring)
    return RingEvidence(
        apart=ring.rings[0].apart_px(ring.rings[1]) / ring.outer_px,
        spread=None if spread is None else (float(spread[0]), float(spread[1])),
        darkest=_darkest(rows),
        saturated=float(np.median(frames.saturated_fraction)),
        matched=float(np.mean(feed.trusted[1:])) if feed.z_mm.size > 1 else None,
        moving=moving,
        moving_within=moving_within,
        roundness=reference.ring.roundness,
        corrected=reference.ring.corrected,
    )


def _darkest(rows: Coordinates) -> float:
    """Return the least brightness of a circle over its greatest, of the circles away from the rims."""
    margin = rows.shape[1] // 12
    inside = rows[:, margin : rows.shape[1] - margin]
    seen = np.isfinite(inside).all(axis=0)
    return float(np.exp(-np.ptp(inside[:, seen], axis=0).max())) if seen.any() else 1.0


def _movement(ring: FoundRing) -> tuple[tuple[float, float, float] | None, float | None]:
    if ring.moving is None:
        return None, None
    noise = max(ring.moving.noise, float(np.finfo(np.float32).eps))
    inner, middle, outer = movement_in_thirds(ring.moving, ring.annulus)
    return (inner / noise, middle / noise, outer / noise), movement_within(ring.moving, ring.annulus) / noise


def doubts_of_ring(evidence: RingEvidence) -> Iterator[Doubt]:
    """Yield what speaks against the ring being the mirror's, and its picture that of a wall."""
    yield from _of_place(evidence)
    yield from _of_roundness(evidence.roundness, corrected=evidence.corrected)
    yield from _of_wall(evidence)
    if evidence.darkest < DARK_CIRCLE:
        what = (
            f"A whole circle of the ring is only {evidence.darkest:.0%} as bright in one frame as in another: the end "
            "of the bore is in view, and what lies beyond it may pass for cells, or its edge for a rim."
        )
        yield Doubt("bore-end-in-view", what, value=evidence.darkest, unit="1", expected=(DARK_CIRCLE, 1.0))
    if evidence.saturated > MOST_SATURATED:
        what = (
            f"{evidence.saturated:.0%} of the ring is saturated in the median frame: nothing is seen there, and what "
            "is taken for the wall's brightness, and so the cells, may be wrong. Record with less light."
        )
        yield Doubt("ring-saturated", what, value=evidence.saturated, unit="1", expected=(0.0, MOST_SATURATED))


def _of_place(evidence: RingEvidence) -> Iterator[Doubt]:
    if evidence.apart > FARTHEST_APART:
        what = (
            f"The centres of the ring's two rims lie {evidence.apart:.1%} of its radius apart: one of them may be no "
            "rim of the mirror, but the end of the bore or a reflection. Look at the frame with the rims drawn in, and "
            "state 'annulus' in the sidecar."
        )
        yield Doubt("rims-eccentric", what, value=evidence.apart, unit="1", expected=(0.0, FARTHEST_APART))
    for name, spread in zip(("inner", "outer"), evidence.spread or (), strict=False):
        if spread > MOST_SPREAD:
            what = (
                f"The ring's {name} rim changes its radius from frame to frame, by {spread:.1%} of the outer one: a "
                "mirror's does not, but the end of the bore does, as the probe moves."
            )
            yield Doubt("rim-moves", what, value=spread, unit="1", expected=(0.0, MOST_SPREAD))
    moving, within = max(evidence.moving or (0.0,)), evidence.moving_within
    if moving and within and within > NOISE_SHARE and within > STILL_WITHIN * moving:
        what = (
            f"What is seen inside the ring's inner rim changes {within / moving:.0%} as much from frame to frame as in "
            "the ring: wall may be seen there, and the mirror's rim may lie farther in."
        )
        yield Doubt("wall-within-inner-rim", what, value=within / moving, unit="1", expected=(0.0, STILL_WITHIN))


def _of_roundness(roundness: Roundness, *, corrected: bool) -> Iterator[Doubt]:
    if corrected:
        what = (
            f"The ring is {roundness.wide:.3f} times as wide as high, as with pixels that are not square. It was "
            "unrolled as an ellipse; if its pixels are square, the mirror is tilted and z is wrong."
        )
        yield Doubt("pixels-not-square", what, value=roundness.wide, unit="1", expected=1.0)
    elif roundness.out_of_round > NOT_ROUND:
        what = (
            f"The ring's outer rim is no circle: its longest diameter exceeds the shortest by "
            f"{roundness.out_of_round:.1%}. It was unrolled as a circle, so z is wrong by about as much."
        )
        yield Doubt("ring-not-round", what, value=roundness.out_of_round, unit="1", expected=(0.0, NOT_ROUND))


def _of_wall(evidence: RingEvidence) -> Iterator[Doubt]:
    moving, matched = evidence.moving, evidence.matched
    if moving is None:
        what = "A single picture does not show whether what is in the ring is a wall that goes by."
        yield Doubt("no-wall-moves", what)
    elif max(moving) < NOISE_SHARE:
        what = (
            f"What is seen in the ring changes only {max(moving):.1f} times as much from frame to frame as the noise "
            "around it: no wall goes by there, or the probe stood still."
        )
        yield Doubt("no-wall-moves", what, value=max(moving), unit="1", expected=(NOISE_SHARE, float("inf")))
    elif min(moving) < NOISE_SHARE:
        part = ("inner", "middle", "outer")[moving.index(min(moving))]
        what = (
            f"What is seen in the {part} third of the ring changes only {min(moving):.1f} times as much from frame to "
            "frame as the noise around it: that part shows no wall, or the end of the bore is in view."
        )
        yield Doubt("ring-partly-still", what, value=min(moving), unit="1", expected=(NOISE_SHARE, float("inf")))
    elif matched is not None and matched < LEAST_MATCHED:
        what = (
            f"Only {matched:.0%} of neighbouring frames show a wall that could be matched: the others lie where the "
            "nominal feed puts them, and their roll is not known."
        )
        yield Doubt("frames-not-matched", what, value=matched, unit="1", expected=(LEAST_MATCHED, 1.0))


def doubts_of_overlay(overlay: Mask | None, reference: Reference) -> Iterator[Doubt]:
    """Yield that something was drawn over the ring, and where, in pixels of the files: ``overlay``, (row, column)."""
    if overlay is None or reference.overlay is None:
        return
    rows, columns = np.flatnonzero(overlay.any(axis=1)), np.flatnonzero(overlay.any(axis=0))
    share = share_of_ring(reference.overlay, reference.annulus)
    what = (
        f"Something is drawn over the picture (a text, a logo or a mask) and covers {share:.1%} of the ring, within "
        f"columns {columns[0]} to {columns[-1]} and rows {rows[0]} to {rows[-1]}: the wall is not "
        "seen there. Record without it if you can."
    )
    yield Doubt("overlay-masked", what, value=share, unit="1", expected=0.0)
