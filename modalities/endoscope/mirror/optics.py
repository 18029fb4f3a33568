"""From the radius in the image to z on the wall and back, for a cone mirror before a pinhole camera.

The cone's apex points at the camera. Let d be the distance from the pupil to the apex and a the cone's half angle.
Let f be the focal length (px), R the bore's radius, and ψ = atan(r/f). The ray of image radius r then meets the wall at
z(r) = −d·cos 2a + (R + d·sin 2a)·cot(2a − ψ), so the outer rim looks ahead. For a = 45° that is (R + d)·r/f.
Without the mirror's optics, a cone of 45° is assumed that shows the stated length between the rims. Then it is replaced
by the cone that makes a feed even all over the annulus. In either, z(r) is nearly linear.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.modalities.endoscope.manifest import EndoscopeAcquisition

DISAGREEMENT = 0.05
ASSUMED_DISTANCE = 1.25
"""An unknown pupil is assumed this far from the cone's apex, in radii of the bore. The simulator has 0.8 to 1.5."""
ASSUMED_LENGTH = 0.65
"""The annulus is assumed to show this length of the bore, in radii, until the feed says more."""
CONE_KEYS = ("cone_half_angle_deg", "focal_px", "mirror_distance_mm")
STEEPEST = 0.6
"""An assumed cone has no larger tan ψ."""
ASSUMED_ANGLES_RAD = np.deg2rad(34.0), np.deg2rad(56.0)
"""A cone's half angle is fitted between these."""


@dataclass(frozen=True)
class ConeOptics:
    """z(r) of a cone mirror; ``rim_sign`` −1 for an outer rim that looks behind.

    ``distortion``: k1, k2, k3 of r_image = f·t·(1 + k1 t² + k2 t⁴ + k3 t⁶) with t = tan ψ. ``assumed``: not stated.
    """

    inner_px: float
    outer_px: float
    half_angle_rad: float
    focal_px: float
    mirror_distance_mm: float
    bore_radius_mm: float
    distortion: tuple[float, ...] = ()
    rim_sign: int = 1
    assumed: bool = False

    def __post_init__(self) -> None:
        psi = np.arctan(self._undistorted(np.array([self.outer_px])))[0]
        if not psi < self.half_angle_rad:
            raise EndoctError(
                "the mirror's optics do not fit the annulus",
                found=f"a ray at {np.rad2deg(psi):.1f}° from the axis at its outer rim",
                expected=f"less than the cone's half angle, {np.rad2deg(self.half_angle_rad):.1f}°",
                remedy="correct focal_px (in pixels of the files) or cone_half_angle_deg",
            )

    @property
    def visible_length_mm(self) -> float:
        """Axial length between the rims, mm."""
        inner, outer = self.ahead_mm(np.array([self.inner_px, self.outer_px]))
        return float(outer - inner)

    @property
    def mm_per_px(self) -> float:
        """Mean axial length of one pixel along r, mm."""
        return self.visible_length_mm / (self.outer_px - self.inner_px)

    def z_mm(self, r_px: Coordinates) -> Coordinates:
        """z relative to the middle of the visible band, float64, any shape."""
        return self.rim_sign * (self.ahead_mm(r_px) - self._middle_mm)

    def r_px(self, z_mm: Coordinates) -> Coordinates:
        """Image radius that shows ``z_mm`` from the middle of the visible band."""
        a, d = self.half_angle_rad, self.mirror_distance_mm
        ahead = self.rim_sign * z_mm + self._middle_mm
        psi = 2 * a - np.arctan2(self.bore_radius_mm + d * np.sin(2 * a), ahead + d * np.cos(2 * a))
        t = np.tan(psi)
        r: Coordinates = self.focal_px * t * self._stretch(t)
        return r

    def centre_shift_px_per_mm(self, r_px: Coordinates) -> Coordinates:
        """Return m/(dz/dr), px/mm: how far a circle of constant z is off centre for 1 mm that the bore's axis is."""
        psi = np.arctan(self._undistorted(r_px))
        slope = (self.ahead_mm(r_px + 0.5) - self.ahead_mm(r_px - 0.5)).clip(1e-9)
        return np.asarray(1 / np.tan(2 * self.half_angle_rad - psi) / slope)

    def slant(self, r_px: Coordinates) -> Coordinates:
        """Return by how much z of a ray changes for 1 mm that it goes on beyond the wall, m = cot(2a − ψ)."""
        return np.asarray(self.rim_sign / np.tan(2 * self.half_angle_rad - np.arctan(self._undistorted(r_px))))

    @cached_property
    def _middle_mm(self) -> float:
        return float(np.mean(self.ahead_mm(np.array([self.inner_px, self.outer_px]))))

    def ahead_mm(self, r_px: Coordinates) -> Coordinates:
        """z from the apex, away from the camera, of an image radius."""
        a, d = self.half_angle_rad, self.mirror_distance_mm
        psi = np.arctan(self._undistorted(r_px))
        z: Coordinates = -d * np.cos(2 * a) + (self.bore_radius_mm + d * np.sin(2 * a)) / np.tan(2 * a - psi)
        return z

    def _undistorted(self, r_px: Coordinates) -> Coordinates:
        """tan ψ of an image radius: the fixed point of the mild distortion."""
        image = r_px / self.focal_px
        t = image
        for _ in range(20 if self.distortion else 0):
            t = image / self._stretch(t)
        return t

    def _stretch(self, t: Coordinates) -> Coordinates:
        powers = [k * t ** (2 * n) for n, k in enumerate(self.distortion, 1)]
        stretch: Coordinates = 1 + np.sum(powers, axis=0) if powers else np.ones_like(t)
        return stretch


def turned(optics: ConeOptics) -> ConeOptics:
    """Return the same mirror with its outer rim looking the other way."""
    return replace(optics, rim_sign=-optics.rim_sign)


def assumed_cone(
    inner_px: float, outer_px: float, visible_length_mm: float, bore_radius_mm: float, sign: int = 1
) -> ConeOptics:
    """Return the cone of 45°, whose z is linear in r, that shows ``visible_length_mm`` between the rims."""
    mm_per_px = visible_length_mm / (outer_px - inner_px)
    distance_mm = max(ASSUMED_DISTANCE * bore_radius_mm, outer_px * mm_per_px / STEEPEST - bore_radius_mm)
    focal_px = (bore_radius_mm + distance_mm) / mm_per_px
    return ConeOptics(inner_px, outer_px, np.pi / 4, focal_px, distance_mm, bore_radius_mm, rim_sign=sign, assumed=True)


def stretched(optics: ConeOptics, stretch: float) -> ConeOptics:
    """Return the cone with the same visible length in which a feed is even over the annulus.

    In ``optics``, an assumed cone of 45°, the feed was larger by ``stretch`` of itself at the outer rim. At the inner
    one it was smaller by as much. Where no cone is that uneven, it is the one that comes nearest.
    """
    from scipy.optimize import brentq  # takes a while to load, and a stated mirror does without

    def fitted(half_angle_rad: float) -> ConeOptics:
        def length(focal_px: float) -> float:
            return replace(optics, half_angle_rad=half_angle_rad, focal_px=focal_px).visible_length_mm

        shortest = optics.outer_px / (0.9 * np.tan(half_angle_rad))
        focal_px = brentq(lambda f: length(f) - optics.visible_length_mm, shortest, 50 * optics.focal_px)
        return replace(optics, half_angle_rad=half_angle_rad, focal_px=float(focal_px))

    def unevenness(half_angle_rad: float) -> float:
        cone = fitted(half_angle_rad)
        inner, outer = (
            float(np.diff(cone.z_mm(rim + np.array([-0.5, 0.5])))[0]) for rim in (cone.inner_px, cone.outer_px)
        )
        return (inner - outer) / (inner + outer)

    low, high = ASSUMED_ANGLES_RAD
    at_low, at_high = unevenness(low) - stretch, unevenness(high) - stretch
    if at_low * at_high > 0:
        return fitted(low if abs(at_low) < abs(at_high) else high)
    return fitted(float(brentq(lambda angle: unevenness(angle) - stretch, low, high, xtol=1e-6)))


def stated_optics(
    acquisition: EndoscopeAcquisition, inner_px: float, outer_px: float
) -> tuple[ConeOptics, tuple[str, ...]]:
    """Return z(r) of an annulus as the sidecar has it, and a note where it contradicts itself.

    Where it has neither the mirror's optics nor the visible length but the feed, the length is a guess, see
    :func:`scale_is_stated`. Raises :class:`EndoctError` where it has none of the three.
    """
    angle, focal, distance = (getattr(acquisition, key) for key in CONE_KEYS)
    sign = -1 if acquisition.outer_rim == "behind" else 1
    length = acquisition.visible_length_mm
    radius_mm = acquisition.bore_diameter_mm / 2
    if angle is not None and focal is not None and distance is not None:
        cone = ConeOptics(
            inner_px, outer_px, float(np.deg2rad(angle)), focal, distance, radius_mm, acquisition.distortion, sign
        )
        if length is None or abs(cone.visible_length_mm / length - 1) <= DISAGREEMENT:
            return cone, ()
        return cone, (
            f"The mirror's optics let the annulus span {cone.visible_length_mm:.2f} mm, visible_length_mm says "
            f"{length:.2f} mm; the optics were used.",
        )
    missing = [key for key in CONE_KEYS if getattr(acquisition, key) is None]
    if length is None and acquisition.pitch_mm is None and acquisition.positions_mm is None:
        raise EndoctError(
            "the scale along the bore is not known",
            found=f"neither visible_length_mm nor {' and '.join(missing)} nor feed_pitch_mm in the sidecar",
            expected="the length that the annulus spans, all of the mirror's optics, or the feed",
            remedy="add visible_length_mm: put a scale into a bore of that diameter and read off what the ring shows",
        )
    cone = assumed_cone(inner_px, outer_px, length or ASSUMED_LENGTH * radius_mm, radius_mm, sign)
    if len(missing) == len(CONE_KEYS):
        return cone, ()
    return cone, (f"The mirror's optics were not used, because the sidecar lacks {' and '.join(missing)}.",)


def scale_is_stated(acquisition: EndoscopeAcquisition) -> bool:
    """Say whether the sidecar gives how long a piece of the bore the annulus shows."""
    return acquisition.visible_length_mm is not None or all(getattr(acquisition, k) is not None for k in CONE_KEYS)
