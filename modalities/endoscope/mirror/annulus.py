"""The ring that the mirror makes in the image: found once for the recording, then followed from frame to frame."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from endoct.base.arrays import Coordinates, Image
from endoct.base.compute.compiled import compiled
from endoct.base.errors import NotSeen
from endoct.base.numeric.least_squares import vertex_in_loops
from endoct.base.numeric.ranks import median
from endoct.modalities.endoscope.mirror.rings import (
    FEWEST_POINTS,
    N_RAYS,
    Ring,
    dark_level,
    describe,
    find_rings,
    fit_circle,
    lasting_contrast,
    without_thin_lines,
)

LEAST_SUPPORT = 0.25
FAINTEST_SUPPORT = 0.1
"""Least support of an inner rim where there is no clearer one, and of rims that lie where those of other frames do."""
LARGEST_RADIUS_RATIO = 0.85
SMALLEST_RADIUS_RATIO = 0.1
FARTHEST_CENTRES = 0.2
LEAST_LASTING = 0.5
"""Least share of an inner rim's contrast that remains farther out. A specular ring is bright, but ends."""
NEAR_REACHES = (0.06, 0.03, 0.015)
FAR_REACHES = (0.3, 0.1, 0.03, 0.015)
"""How far from a rim an edge is looked for, round by round, as shares of the outer radius."""
REMEDY = "give 'annulus' in the sidecar as {x, y, inner_px, outer_px}, or check that the frames show the mirror's ring"
STEP_PX = 0.5
MARGIN = 2
"""Number of samples at either end of a ray that are not searched for edges."""
SIGMA = 2.0
_AWAY = np.arange(1, 9)
TAPS = _AWAY / SIGMA**2 * np.exp(-0.5 * (_AWAY / SIGMA) ** 2) / (1 + 2 * np.exp(-0.5 * (_AWAY / SIGMA) ** 2).sum())
"""These are one side of the derivative of a Gaussian, in samples."""


@dataclass(frozen=True)
class Annulus:
    """Two circles, each with its own centre, in pixels.

    Between them the centre of a circle of radius r runs linearly from the one to the other. A mirror or a
    bore that is not quite on the camera's axis moves the centre with the radius. Pixels are square ones: those of the
    image are ``pixels`` times as high as wide, and its rows count.
    """

    inner_x_px: float
    inner_y_px: float
    inner_px: float
    outer_x_px: float
    outer_y_px: float
    outer_px: float
    pixels: float = 1.0

    @classmethod
    def of(cls, inner: Ring, outer: Ring) -> "Annulus":
        """Return the annulus between two circles."""
        return cls(*inner.circle, *outer.circle)

    def columns(self, x_px: Coordinates | np.float64) -> Coordinates:
        """Return the columns of the image that lie at ``x_px`` in square pixels (any shape)."""
        return np.asarray((x_px + 0.5) * self.pixels - 0.5)

    def centre_at(self, r_px: Coordinates) -> tuple[Coordinates, Coordinates]:
        """Return x and y of the centre of the circle of radius ``r_px`` (any shape)."""
        share = (self.outer_px - r_px) / (self.outer_px - self.inner_px)
        return (
            self.outer_x_px + share * (self.inner_x_px - self.outer_x_px),
            self.outer_y_px + share * (self.inner_y_px - self.outer_y_px),
        )

    def scaled(self, factor: float) -> "Annulus":
        """Return the annulus in an image ``factor`` times as large; pixel centres are integers in both."""
        names = "inner_x_px", "inner_y_px", "outer_x_px", "outer_y_px"
        places = {name: (getattr(self, name) + 0.5) * factor - 0.5 for name in names}
        return replace(self, inner_px=self.inner_px * factor, outer_px=self.outer_px * factor, **places)

    def moved(self, dx_px: float, dy_px: float) -> "Annulus":
        """Return the annulus moved in the image."""
        return replace(
            self,
            inner_x_px=self.inner_x_px + dx_px,
            inner_y_px=self.inner_y_px + dy_px,
            outer_x_px=self.outer_x_px + dx_px,
            outer_y_px=self.outer_y_px + dy_px,
        )

    def with_drift(self, dx_px: float, dy_px: float) -> "Annulus":
        """Return the annulus with its inner circle's centre so far from its outer circle's."""
        return replace(self, inner_x_px=self.outer_x_px + dx_px, inner_y_px=self.outer_y_px + dy_px)

    @property
    def rings(self) -> tuple[Ring, Ring]:
        """The inner and the outer rim as circular edges."""
        return (
            Ring(self.inner_x_px, self.inner_y_px, self.inner_px, rising=True),
            Ring(self.outer_x_px, self.outer_y_px, self.outer_px, rising=False),
        )


def find_outer_rims(image: Image) -> list[Ring]:
    """Return what may be the mirror's outer rim in a grey image, the likeliest first: bright discs on dark ground.

    Raises :class:`NotSeen` where the image is blank.
    """
    spread = float(np.percentile(image, 99) - np.percentile(image, 1))
    if spread < 0.01:
        raise NotSeen(
            "no annulus: the frames are blank",
            found=f"brightness from {np.percentile(image, 1):.2f} to {np.percentile(image, 99):.2f} of full scale",
            expected="a bright ring on dark ground",
            remedy="check the light and the exposure",
        )
    outers = [ring for ring in find_rings(image, rising=False, count=3) if ring.support >= LEAST_SUPPORT]
    return sorted(outers, key=lambda ring: -ring.support * ring.radius_px)


def find_annulus(image: Image, outers: Sequence[Ring] | None = None) -> Annulus:
    """Return the annulus in a grey image, float32 (row, column), best the mean of several frames.

    Its inner rim is the clear edge from dark to lasting brightness that is nearest the outer rim. What lies
    farther inside is the camera's own reflection. ``outers``: :func:`find_outer_rims` of it, where these are known.
    Raises :class:`NotSeen` where there is none.
    """
    outers = find_outer_rims(image) if outers is None else outers
    # a specular ring on the mirror is brighter than the rim next to it and hides it
    edges = (find_rings(one, rising=True, count=6) for one in (without_thin_lines(image), image))
    inners = [ring for of_image in edges for ring in of_image if ring.support >= FAINTEST_SUPPORT]
    # light that falls off towards the inner rim leaves it little contrast
    clear = [ring for ring in inners if ring.support >= LEAST_SUPPORT] or inners
    for outer in outers:
        fitting = [ring for ring in clear if _nested(ring, outer)]
        if fitting:
            # where a specular ring is clearer than the rim, the rim is what is bright beyond it
            faint = _clearest([ring for ring in inners if _nested(ring, outer)])
            fitting = next((kept for of in (fitting, faint) if (kept := [r for r in of if _lasts(image, r)])), fitting)
            inner = max(_clearest(fitting), key=lambda ring: ring.radius_px)
            return follow(image, Annulus.of(inner, outer)).annulus
    raise NotSeen(
        "no annulus in the frames",
        found=f"{len(outers)} bright disc{'' if len(outers) == 1 else 's'}, none of them with a dark one inside",
        expected="a bright ring: dark inside, dark outside, two nearly concentric circles",
        remedy=REMEDY,
    )


def _clearest(rings: Sequence[Ring]) -> list[Ring]:
    """Return the rings with at least half of the best support among them."""
    most = max((ring.support for ring in rings), default=0.0)
    return [ring for ring in rings if ring.support >= 0.5 * most]


def _lasts(image: Image, ring: Ring) -> bool:
    return lasting_contrast(image, ring) >= LEAST_LASTING * ring.contrast


def _nested(inner: Ring, outer: Ring) -> bool:
    apart = inner.apart_px(outer)
    return (
        SMALLEST_RADIUS_RATIO * outer.radius_px <= inner.radius_px <= LARGEST_RADIUS_RATIO * outer.radius_px
        and apart <= FARTHEST_CENTRES * outer.radius_px
        and apart + inner.radius_px < outer.radius_px
    )


@dataclass(frozen=True)
class Followed:
    """An annulus measured in one frame; ``support``: contrast times coverage of its fainter rim."""

    annulus: Annulus
    support: float


def follow(image: Image, near: Annulus, handle: Ring | None = None) -> Followed:
    """Measure the annulus in one grey image, starting ``near`` where it was found before; farther off if it is lost.

    Where its rims are no edges of a single image it keeps its place to ``handle``, a circle that moves with it.
    """
    if handle:
        at, support = locate_outer_rim(image, handle)
        return Followed(near.moved(at.x_px - handle.x_px, at.y_px - handle.y_px), support)
    looks = _Look.at(without_thin_lines(image)), _Look.at(image)
    followed = _measure(looks, near, NEAR_REACHES)
    if followed.support < 2 * LEAST_SUPPORT:
        farther = _measure(looks, near, FAR_REACHES)
        # a specular ring, beyond which it is not bright, may be clearer than the rim
        if farther.support > followed.support and (looks[1].lasts(farther) or not looks[1].lasts(followed)):
            return farther
    return followed


def locate_outer_rim(image: Image, near: Ring) -> tuple[Ring, float]:
    """Return the outer rim in one grey image and its support, starting ``near`` where it was found before."""
    about = Annulus.of(replace(near, radius_px=near.radius_px / 2), near)
    look = _Look.at(image)
    located = _rim(look, near, about, NEAR_REACHES)
    if located[1] >= 2 * LEAST_SUPPORT:
        return located
    return max(located, _rim(look, near, about, FAR_REACHES), key=lambda one: one[1])


@dataclass(frozen=True, eq=False)
class _Look:
    """An image with what is known of all of it, measured once."""

    image: Image
    dark: float

    @classmethod
    def at(cls, image: Image) -> "_Look":
        return cls(image, dark_level(image))

    def lasts(self, followed: Followed) -> bool:
        """Return whether it is bright beyond the inner rim, as it is not beyond a specular ring."""
        return _lasts(self.image, describe(self.image, self.dark, followed.annulus.rings[0]))


def _measure(looks: tuple[_Look, _Look], near: Annulus, reaches: tuple[float, ...]) -> Followed:
    """Fit both rims to the steepest edges within ever shorter reaches, which are parts of the outer radius.

    ``looks``: at the image without thin lines, and at the image as it is.
    """
    without_lines, whole = looks
    inner, of_inner = _rim(without_lines, near.rings[0], near, reaches)
    if of_inner < LEAST_SUPPORT:  # a thin line may be all there is of the inner rim
        inner, of_inner = max((inner, of_inner), _rim(whole, near.rings[0], near, reaches), key=lambda one: one[1])
    outer, of_outer = _rim(whole, near.rings[1], near, reaches)
    return Followed(Annulus.of(inner, outer), min(of_inner, of_outer))


def _rim(look: _Look, rim: Ring, near: Annulus, reaches: tuple[float, ...]) -> tuple[Ring, float]:
    """Fit one rim within ever shorter reaches; return it and its support."""
    for reach in reaches:
        reach_px = min(max(2.0, reach * near.outer_px), 0.9 * rim.radius_px)
        x, y = edge_points(look.image, rim, reach_px)
        if x.size >= FEWEST_POINTS:
            fit = Ring(*fit_circle(x, y, rim.circle), rising=rim.rising)
            # the circle through edges that lie all over the place is not to be followed
            rim = fit if fit.differs_px(rim) <= 2 * reach_px and fit.radius_px > 2 else rim
    return rim, describe(look.image, look.dark, rim).support


def edge_points(image: Image, ring: Ring, reach_px: float) -> tuple[Coordinates, Coordinates]:
    """Return x and y, float64 (n,), of the steepest edge on each ray within ``reach_px`` of ``ring``.

    A blurred edge is steepest in its middle only where the image is linear in light. Its logarithm, or a camera's
    gamma, moves it towards the dark. As the gamma is not known, a little of a usual one is undone. Rays without a clear
    edge are left out.
    """
    margin_px = 2 * MARGIN * STEP_PX
    radii = ring.radius_px + np.arange(-reach_px - margin_px, reach_px + margin_px + STEP_PX / 2, STEP_PX)
    angle = 2 * np.pi / N_RAYS * np.arange(N_RAYS)
    cos, sin = np.cos(angle), np.sin(angle)
    radius, slope = _steepest(image, ring.x_px, ring.y_px, cos, sin, radii, 1.0 if ring.rising else -1.0)
    rising = slope[slope > 0]
    clear = slope > 0.3 * max(median(rising) if rising.size else 0.0, 1e-6)
    return (ring.x_px + radius * cos)[clear], (ring.y_px + radius * sin)[clear]


@compiled
def _steepest(
    image: Image, x_px: float, y_px: float, cos: Coordinates, sin: Coordinates, radii: Coordinates, sign: float
) -> tuple[Coordinates, Coordinates]:
    """Return radius and slope of the steepest edge of one ``sign`` on each ray; there is no edge outside the image."""
    n, reach, zero = radii.size, TAPS.size, np.float32(0)
    last_x, last_y = np.float32(image.shape[1] - 1), np.float32(image.shape[0] - 1)
    last_left, last_top = np.int32(image.shape[1] - 2), np.int32(image.shape[0] - 2)
    radius, steepest = np.empty(cos.size), np.empty(cos.size)
    line, slope, inside = np.empty(n + 2 * reach, np.float32), np.empty(n), np.empty(n, np.bool_)
    across, down = np.empty(n, np.float32), np.empty(n, np.float32)
    left, top = np.empty(n, np.int32), np.empty(n, np.int32)
    for i in range(cos.size):
        for k in range(n):  # apart from what reads the image, so that it is done as vectors
            x, y = np.float32(x_px + radii[k] * cos[i]), np.float32(y_px + radii[k] * sin[i])
            inside[k] = (x >= zero) & (y >= zero) & (x <= last_x) & (y <= last_y)
            x, y = min(max(x, zero), last_x), min(max(y, zero), last_y)
            left[k], top[k] = min(np.int32(x), last_left), min(np.int32(y), last_top)
            across[k], down[k] = x - np.float32(left[k]), y - np.float32(top[k])
        for k in range(n):
            above, below = image[top[k], left[k] : left[k] + 2], image[top[k] + 1, left[k] : left[k] + 2]
            upper = above[0] + across[k] * (above[1] - above[0])
            lower = below[0] + across[k] * (below[1] - below[0])
            line[reach + k] = upper + down[k] * (lower - upper)
        line[:reach], line[reach + n :] = line[reach], line[reach + n - 1]
        for k in range(line.size):
            light = max(line[k], zero)
            line[k] = light * np.sqrt(np.sqrt(light))
        slope[:] = 0
        for tap in range(reach):
            weight = sign * TAPS[tap]
            before, after = line[reach - 1 - tap : reach - 1 - tap + n], line[reach + 1 + tap : reach + 1 + tap + n]
            for k in range(n):
                slope[k] += weight * (after[k] - before[k])
        for k in range(n):
            slope[k] = slope[k] if inside[k] else 0.0
        at = MARGIN
        for k in range(MARGIN, n - MARGIN):
            if slope[k] > slope[at]:
                at = k
        at = min(max(at, MARGIN + 1), n - MARGIN - 2)
        shift = vertex_in_loops(slope[at - 1], slope[at], slope[at + 1])
        radius[i] = radii[at] + STEP_PX * min(max(shift, -1.0), 1.0)
        steepest[i] = slope[at]
    return radius, steepest
