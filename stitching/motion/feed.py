"""How far an instrument moved and rolled from frame to frame, from the overlap of the strips themselves.

Every pair of neighbours is compared by a normalised cross-correlation that is cyclic in θ, inside a window around
the nominal feed. The best place is then refined by least squares on the strips, with a first harmonic in θ in
addition to feed and roll. An instrument off the axis sees one side move farther than the other. Wherever the texture
lies unevenly, that would pass for feed or roll. A pair without a clear answer says so and falls back on the nominal
feed.

One robust solution reconciles all pairs: places along a chain, from steps between them of which some are wrong.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solveh_banded

from endoct.base.arrays import Coordinates, Mask
from endoct.base.compute.memory import Kept
from endoct.base.errors import EndoctError
from endoct.base.numeric.circle import turned_harmonic, wrap_rad
from endoct.base.numeric.ranks import error_of_median
from endoct.stitching.motion.matching import FEWEST_FOR_FIXED_PATTERN, Matcher, Pairs, Strips, keep_textures
from endoct.stitching.motion.warp import Texture

EDGE_MM = 0.06
MEASUREMENT_MM = 0.004
MEASUREMENT_RAD = 0.002
ROLL_PRIOR_RAD = 0.1
SWAY_PRIOR_RAD = 0.005
UNKNOWN = (0.0, float("inf"))
MOST_LOST_FRAMES = 2  # in a row, that a recorder dropped without a gap in the numbers


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


@dataclass(frozen=True, eq=False)
class Feed:
    """Where every strip lies; float64 (n,) unless said otherwise.

    Attributes
    ----------
    z_mm, roll_rad: relative to the first strip.
    sway_rad: (n, 2), by how much θ of the wall exceeds θ of the strip plus roll, as factors of cos and sin of that sum.
        Only its changes can be measured, and a steady one looks like a wrong centre. So it has no mean and no trend
        along z.
    tilt: (2,), the share by which the feed is larger where cos θ of the strip is 1, and where sin θ is; median of the
        pairs. A wrong centre of the strips shows there.
    stretch: the share by which the feed is larger in the last row than in the middle one, and the standard error of
        that.
    confidence: how many times as high the best correlation with the strip before is as that of the next best place.
    correlation: that best correlation; both are NaN for the first strip.
    trusted: bool, measured and not nominal (True for the first).
    direction: −1 where the strips move against the nominal feed as a whole, else +1.
    measured: whether any pair was trusted.
    """

    z_mm: Coordinates
    roll_rad: Coordinates
    sway_rad: Coordinates
    tilt: Coordinates
    stretch: tuple[float, float]
    confidence: Coordinates
    correlation: Coordinates
    trusted: Mask
    direction: int
    measured: bool


def estimate_feed(
    strips: Strips,
    dz_mm: float,
    radius_mm: float,
    nominal_mm: Coordinates | None,
    *,
    valid: Mask | None = None,
    relative_sigma: float = 0.2,
) -> Feed:
    """Return feed and roll of ``strips``, float32 (n, n_rows, n_theta), z ascending and θ a full circle.

    The wall in row k of one strip is in row k − feed/``dz_mm`` of the next. θ of the wall is θ of the strip plus its
    roll. ``nominal_mm`` (n,) is the expected place of every strip. The feed of a pair may differ from its nominal value
    by three ``relative_sigma``, in either direction of the whole. Where frames were lost, it may have up to three times
    that value. Without ``nominal_mm`` the whole overlap is searched.

    ``radius_mm`` of the wall converts between mm and rad; samples that are NaN or not ``valid`` are left out. Strips
    are read one by one, each more than once, and never all held. Raises :class:`EndoctError` where shapes disagree.
    """
    n = len(strips)
    shape = np.shape(strips[0]) if n else ()
    if len(shape) != 2 or 0 in shape:
        raise EndoctError("strips to compare must be a stack", found=f"{(n, *shape)}", expected="(n, rows, θ)")
    if nominal_mm is not None and np.shape(nominal_mm) != (n,):
        raise EndoctError("one nominal place a strip is needed", found=f"{np.shape(nominal_mm)}", expected=f"({n},)")
    if n == 1:
        zero, one, two = np.zeros(1), np.ones(1), np.zeros(2)
        return Feed(zero, zero, np.zeros((1, 2)), two, UNKNOWN, one, one, np.ones(1, np.bool_), 1, False)
    steps = [step for step in (1, 2) if step < n]
    directions = (1,) if nominal_mm is None else (1, -1)
    with Kept[Texture]() as textures:
        keep_textures(textures, strips, valid, EDGE_MM / dz_mm, EDGE_MM / radius_mm / (2 * np.pi) * shape[1])
        matcher = Matcher(textures, dz_mm, radius_mm)
        searched = matcher.search(
            {
                step: [_windows(nominal_mm, step, direction, relative_sigma) for direction in directions]
                for step in steps
            }
        )
        matched = [sum(place.correlation for place in places if place.trusted) for places in searched[0]]
        best = matched.index(max(matched))
        pairs = [matcher.refine(step, found[best]) for step, found in zip(steps, searched, strict=True)]
    direction = directions[best]
    return _solve(n, pairs, None if nominal_mm is None else direction * np.diff(nominal_mm), direction, relative_sigma)


def _windows(
    nominal_mm: Coordinates | None, step: int, direction: int, relative_sigma: float
) -> list[tuple[float, float]] | None:
    if nominal_mm is None:
        return None
    feed = direction * (nominal_mm[step:] - nominal_mm[:-step])
    reach = 3 * relative_sigma * np.abs(feed) / np.sqrt(step) + 0.02
    lost = MOST_LOST_FRAMES * feed / step
    least, most = feed + np.minimum(lost, 0) - reach, feed + np.maximum(lost, 0) + reach
    return [(float(low), float(high)) for low, high in zip(least, most, strict=True)]


def _solve(n: int, pairs: list[Pairs], prior_mm: Coordinates | None, direction: int, relative_sigma: float) -> Feed:
    """Return the places that agree best with all trusted pairs and, weakly, with the nominal feed."""
    first = pairs[0]
    if prior_mm is None:
        typical = float(np.median(first.feed_mm[first.trusted, 0])) if first.trusted.any() else 0.0
        prior_mm = np.full(n - 1, typical)
    sigma_mm = np.maximum(relative_sigma * np.abs(prior_mm), 0.01)
    z, z_agree = robust_chain(
        prior_mm, sigma_mm, [(p.step, p.feed_mm[:, 0], p.trusted) for p in pairs], MEASUREMENT_MM, cyclic=False
    )
    none, even = np.zeros(n - 1), np.ones(n - 1)
    roll, roll_agree = robust_chain(
        none,
        ROLL_PRIOR_RAD * even,
        [(p.step, p.roll_rad[:, 0], p.trusted) for p in pairs],
        MEASUREMENT_RAD,
        cyclic=True,
    )
    # a pair that the others overrule was not right, however clear it looked
    trusted = first.trusted & z_agree & roll_agree
    sway = np.zeros((n, 2))
    turned = [turned_harmonic(p.roll_rad[:, 1:], roll[: n - p.step]) for p in pairs]
    for part in (0, 1):
        links = [(p.step, t[:, part], p.trusted) for p, t in zip(pairs, turned, strict=True)]
        sway[:, part], _ = robust_chain(none, SWAY_PRIOR_RAD * even, links, MEASUREMENT_RAD, cyclic=False)
    moved = trusted & (np.abs(first.feed_mm[:, 0]) > 1e-6)
    tilts = first.feed_mm[moved, 1:] / first.feed_mm[moved, :1]
    begin = np.full(1, np.nan)  # no strip before it
    return Feed(
        z_mm=z,
        roll_rad=roll,
        sway_rad=_without_trend(sway, z),
        tilt=np.median(tilts, axis=0) if moved.any() else np.zeros(2),
        stretch=_typical(first.stretch[moved]),
        confidence=np.concatenate([begin, first.ratio]),
        correlation=np.concatenate([begin, first.correlation]),
        trusted=np.concatenate([np.ones(1, np.bool_), trusted]),
        direction=direction,
        measured=bool(trusted.any()),
    )


def _typical(values: Coordinates) -> tuple[float, float]:
    """Return the median of ``values`` and its standard error."""
    if values.size < FEWEST_FOR_FIXED_PATTERN:
        return UNKNOWN
    middle = float(np.median(values))
    return middle, error_of_median(values - middle)


def _without_trend(values: Coordinates, along: Coordinates) -> Coordinates:
    """Return ``values`` (n, k) less the straight line along (n,) that fits them best."""
    line = np.stack([np.ones_like(along), along], axis=1)
    return np.asarray(values - line @ np.linalg.lstsq(line, values, rcond=None)[0])
