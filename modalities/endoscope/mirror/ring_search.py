"""The mirror's ring in a recording: found once for all frames, then one annulus for each of them.

The ring is found by its light, and by what moves, which decides where the two disagree. Full scale and the place of
the annulus are measured on some frames, before the pass over all of them. An outer rim that is an ellipse along the
image's axes shows that pixels are not square. After the pass, each frame gets one annulus from what was measured in it:
the radii belong to the probe, only the place moves.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.ndimage import median_filter

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.compute.parallel import thread_map
from endoct.base.errors import NotSeen
from endoct.base.numeric.ranks import robust_sigmas
from endoct.modalities.contract import FrameStream
from endoct.modalities.endoscope.light import full_scale_of, reduced_light
from endoct.modalities.endoscope.manifest import EndoscopeAcquisition
from endoct.modalities.endoscope.mirror.annulus import (
    FAINTEST_SUPPORT,
    Annulus,
    Followed,
    edge_points,
    find_annulus,
    find_outer_rims,
    follow,
    locate_outer_rim,
)
from endoct.modalities.endoscope.mirror.movement import (
    NOISE_SHARE,
    Movement,
    inner_rim_of,
    movement,
    movement_in_thirds,
    outer_rim_of,
)
from endoct.modalities.endoscope.mirror.overlay import find_overlay
from endoct.modalities.endoscope.mirror.rings import Ring

MOST_CHANGE = 0.05
MOST_BLUR = 0.3
REACH = 0.14
"""The rim is looked for within this part of the radius, since a circle through part of an ellipse misses the rest."""
LEAST_SEEN = 0.7
"""At least this part of the rim must be visible. An ellipse fitted to less is arbitrary."""
NEAR = 0.012
"""Points farther from the ellipse than this part of the radius do not belong to the rim."""
NOT_ROUND = 0.01
"""A ring is not round from this relative difference of its axes on. It is below 0.002 in both simulators."""
SAME_RIM = 0.03
"""Edges of light and of movement within this part of the outer radius are the same rim."""
SURVEY_SIDE_PX = 480
REFERENCE_FRAMES = 12


def settle_annuli(followed: Sequence[Followed], reference: Annulus, given: bool) -> tuple[list[Annulus], Mask]:
    """Return one annulus a frame with the same radii in all, and which of them were measured, bool (n,).

    The radii belong to the probe and are the recording's medians, or the ``given`` ones; so is the way from
    one centre to the other. Only the place moves. Where a frame's rims were lost, or lie apart from its
    neighbours', the place is interpolated.
    """
    inner = np.array([(f.annulus.inner_x_px, f.annulus.inner_y_px, f.annulus.inner_px) for f in followed])
    outer = np.array([(f.annulus.outer_x_px, f.annulus.outer_y_px, f.annulus.outer_px) for f in followed])
    located = np.array([f.support for f in followed]) >= FAINTEST_SUPPORT
    for measured, expected in ((inner[:, 2], reference.inner_px), (outer[:, 2], reference.outer_px)):
        if not given:  # where the annulus wanders, a mean image has its small rim too large; the frames agree
            near = located & (np.abs(measured / expected - 1) < MOST_BLUR)
            expected = float(np.median(measured[near])) if near.any() else expected
        located = located & (np.abs(measured - expected) < max(MOST_CHANGE * expected, 1.0))
    if not located.any():
        return [reference] * len(followed), located
    between = np.median(inner[located, :2] - outer[located, :2], axis=0)
    inner_px, outer_px = float(np.median(inner[located, 2])), float(np.median(outer[located, 2]))
    if given:
        inner_px, outer_px = reference.inner_px, reference.outer_px
    place = (outer[:, :2] + inner[:, :2] - between) / 2
    located &= ~_outlying(place, located, tolerance_px=0.01 * outer_px)
    index = np.arange(len(followed))
    x, y = (np.interp(index, index[located], place[located, axis]) for axis in (0, 1))
    return [
        Annulus(float(a + between[0]), float(b + between[1]), inner_px, float(a), float(b), outer_px)
        for a, b in zip(x, y, strict=True)
    ], located


def _outlying(place: Coordinates, located: Mask, tolerance_px: float) -> Mask:
    """Say which places lie apart from the median of the nine around them."""
    course = np.where(located[:, None], place, np.median(place[located], axis=0))
    away = np.abs(course - median_filter(course, size=(min(9, len(course)), 1), mode="nearest"))
    spread = robust_sigmas(away)
    outlying: Mask = (away > np.maximum(tolerance_px, 6 * spread)).any(axis=1)
    return outlying


@dataclass(frozen=True)
class Roundness:
    """``wide``: the rim's extent along columns over that along rows; ``oblique``: the same along the diagonals."""

    wide: float
    oblique: float

    @property
    def pixels(self) -> float:
        """Height over width of a pixel that makes a circle of the rim; 1 for a round rim, or an oblique ellipse."""
        along, across = abs(self.wide - 1), abs(self.oblique - 1)
        return self.wide if along > NOT_ROUND and across < 0.5 * along else 1.0

    @property
    def out_of_round(self) -> float:
        """Relative excess of the rim's longest diameter over its shortest."""
        return float(np.hypot(self.wide - 1, self.oblique - 1))


ROUND = Roundness(1.0, 1.0)


def measure_roundness(images: Sequence[Image], outer: Ring) -> Roundness:
    """Return the roundness of the outer rim: the median over the grey images that show enough of it."""
    measured = [one for image in images if (one := _of_image(image, locate_outer_rim(image, outer)[0])) is not None]
    if 2 * len(measured) < len(images):
        return ROUND
    wide, oblique = np.median(measured, axis=0)
    return Roundness(float(wide), float(oblique))


def squared(image: Image, pixels: float) -> Image:
    """Return an image with pixels ``pixels`` times as high as wide as one of square pixels, with the same rows."""
    if pixels == 1:
        return image
    # pixel centres are at integers in both
    shift = np.array([[pixels, 0, 0.5 * pixels - 0.5], [0, 1, 0]])
    size = max(1, round(image.shape[1] / pixels)), image.shape[0]
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(image, shift, size, flags=flags, borderMode=cv2.BORDER_REPLICATE), np.float32)


def _of_image(image: Image, outer: Ring) -> tuple[float, float] | None:
    x, y = edge_points(image, outer, REACH * outer.radius_px)
    if x.size < 8:
        return None
    angle = np.arctan2(y - outer.y_px, x - outer.x_px)
    radius = np.hypot(x - outer.x_px, y - outer.y_px)
    basis = np.stack([np.ones_like(angle), *(f(k * angle) for k in (1, 2) for f in (np.cos, np.sin))], axis=1)
    fitted, misfit = _robust_fit(basis, radius, NEAR * outer.radius_px)
    # rays lie at whole degrees: to the nearest one, since the degree below is decided by rounding
    degrees = np.rint(np.degrees(angle[np.abs(misfit) < NEAR * outer.radius_px])) % 360
    seen = np.unique(degrees).size / 360
    if seen < LEAST_SEEN:
        return None
    mean, cos2, sin2 = fitted[0], fitted[3], fitted[4]
    return float((mean + cos2) / (mean - cos2)), float((mean + sin2) / (mean - sin2))


def _robust_fit(basis: Coordinates, values: Coordinates, scale: float) -> tuple[Coordinates, Coordinates]:
    """Return weights of ``basis`` (n, k) for ``values`` (n,) with Cauchy's weights, ever stricter, and the misfit."""
    weight: Coordinates = np.ones_like(values)
    fitted: Coordinates = np.zeros(basis.shape[1])
    for width in (8 * scale, 4 * scale, 2 * scale, *[scale] * 6):
        normal = (basis * weight[:, None]).T @ basis + 1e-9 * np.eye(basis.shape[1])
        fitted = np.asarray(np.linalg.solve(normal, basis.T @ (weight * values)))
        weight = np.asarray(1 / (1 + ((values - basis @ fitted) / width) ** 2) ** 2)
    return fitted, values - basis @ fitted


@dataclass(frozen=True, eq=False)
class FoundRing:
    """``annulus`` in square pixels of the images; ``handle``: the circle that it is followed by, None for its own rims.

    ``moving``: what moves in the images, None for a single one; ``moving_rim``: where it begins to, None if unclear.
    ``roundness`` of the outer rim in the images, before :func:`squared` by what is ``corrected`` of it.
    """

    annulus: Annulus
    handle: Ring | None
    moving: Movement | None
    moving_rim: Ring | None
    roundness: Roundness
    corrected: bool


def find_ring(images: Sequence[Image]) -> FoundRing:
    """Return the ring in grey images, spread over the recording. Raises :class:`NotSeen` where there is none.

    Rims of light have the radii of the mean image; frames are to be followed for better ones.
    """
    outers = find_outer_rims(_mean(images))
    roundness = measure_roundness(images, outers[0]) if outers else ROUND
    if corrected := roundness.pixels != 1:
        images = [squared(image, roundness.pixels) for image in images]
        outers = find_outer_rims(_mean(images))
    by_light, refusal = _by_light(_mean(images), outers)
    if not outers:
        raise refusal or NotSeen("no annulus in the frames")
    outer = by_light.rings[1] if by_light else outers[0]
    places = list(thread_map(lambda image: locate_outer_rim(image, outer)[0], images))
    moving = movement(images, places, outer)
    inner = inner_rim_of(moving) if moving else None
    if moving is None or inner is None:
        if by_light is None:
            raise refusal or NotSeen("no annulus in the frames")
        return FoundRing(by_light, None, moving, None, roundness, corrected)
    # what is followed may be a reflection inside the rim: fixed to the probe, too, and of another radius
    handle = replace(outer, radius_px=float(np.median([place.radius_px for place in places])))
    limit = outer_rim_of(moving, inner)
    if limit is None or limit.radius_px < (1 + SAME_RIM) * handle.radius_px:
        limit = handle  # where nothing moves inside the rim, the bore may be at its end
    if by_light and limit is handle and by_light.rings[0].differs_px(inner) <= SAME_RIM * outer.radius_px:
        return FoundRing(by_light, None, moving, inner, roundness, corrected)
    return FoundRing(Annulus.of(inner, limit), handle, moving, inner, roundness, corrected)


def _by_light(mean: Image, outers: Sequence[Ring]) -> tuple[Annulus | None, NotSeen | None]:
    try:
        return find_annulus(mean, outers), None
    except NotSeen as error:
        return None, error


def ring_at(images: Sequence[Image], given: Annulus) -> FoundRing:
    """Return the ``given`` ring with what moves in the images."""
    annuli, _ = settle_annuli([follow(image, given) for image in images], given, True)
    outer = given.rings[1]
    moving = movement(images, [annulus.rings[1] for annulus in annuli], outer)
    inner = inner_rim_of(moving) if moving else None
    return FoundRing(given, None, moving, inner, measure_roundness(images, outer), corrected=False)


def _mean(images: Sequence[Image]) -> Image:
    return np.asarray(np.mean(images, axis=0, dtype=np.float32))


@dataclass(frozen=True)
class Reference:
    """How every frame is looked at: fixed before the pass, so that the order of the frames does not matter.

    ``full_scale``: value of a saturated sample. The survey reduces frames by ``factor``. ``annulus``, in pixels of
    the reduced frames: where it is looked for first. ``handle``: the circle that it is followed by, None for its
    own rims. ``ring``: what it was found by. ``overlay``: what was drawn over the ring, in square pixels of the reduced
    frames, bool (row, column); None where nothing was.
    """

    full_scale: float
    factor: int
    annulus: Annulus
    handle: Ring | None
    ring: FoundRing
    overlay: Mask | None


def find_reference(stream: FrameStream, acquisition: EndoscopeAcquisition) -> Reference:
    """Return the reference by frames spread over the whole recording.

    Raises :class:`NotSeen` where they show no annulus and the sidecar gives none.
    """
    chosen = np.unique(np.linspace(0, len(stream) - 1, min(len(stream), REFERENCE_FRAMES)).round().astype(int))
    frames = list(thread_map(lambda k: stream[int(k)], chosen))
    scale = max(map(full_scale_of, frames))
    factor = max(1, min(frames[0].samples.shape[:2]) // SURVEY_SIDE_PX)
    images = list(thread_map(lambda frame: reduced_light(frame.samples, scale, factor)[0], frames))
    given = acquisition.annulus
    if given is not None:
        stated = Annulus(given.x, given.y, given.inner_px, given.x, given.y, given.outer_px)
        ring = ring_at(images, stated.scaled(1 / factor))
    else:
        ring = find_ring(images)
    pixels = ring.roundness.pixels if ring.corrected else 1.0
    images = [squared(image, pixels) for image in images]
    followed = list(thread_map(lambda image: follow(image, ring.annulus, ring.handle), images))
    annuli, _ = settle_annuli(followed, ring.annulus, given is not None)
    x, y = np.median([(a.outer_x_px, a.outer_y_px) for a in annuli], axis=0)
    annulus = annuli[0].moved(float(x) - annuli[0].outer_x_px, float(y) - annuli[0].outer_y_px)
    handle = ring.handle
    if handle:
        dx_px, dy_px = annulus.outer_x_px - ring.annulus.outer_x_px, annulus.outer_y_px - ring.annulus.outer_y_px
        handle = replace(handle, x_px=handle.x_px + dx_px, y_px=handle.y_px + dy_px)
    moving = ring.moving
    wall_moves = moving is not None and max(movement_in_thirds(moving, ring.annulus)) > NOISE_SHARE * moving.noise
    overlay = find_overlay(images, annulus) if wall_moves else None
    return Reference(scale, factor, replace(annulus, pixels=pixels), handle, ring, overlay)
