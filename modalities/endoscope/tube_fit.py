"""An endoscope's optics from a printed tube, by least squares over where its rays meet the tube's grooves.

The helical groove is a scale that winds around: where it crosses a circle of the image tells z there. The axial groove
tells how a frame is rolled. Where frames lie and how they are rolled follows from the points themselves, so that only
what changes within a frame counts. On a ring's floor the same ray goes on: how much z changes there gives the slant of
the view, which no single bore does. The slant, and how z(r) bends, distinguish half angle, distance, focal length and
distortion, more or less. The standard errors say how well.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates
from endoct.base.numeric.circle import wrap_rad
from endoct.base.numeric.ranks import SIGMA_PER_MEDIAN
from endoct.modalities.endoscope.mirror.optics import ConeOptics
from endoct.modalities.endoscope.tube_marks import HELICAL, Marks
from endoct.modalities.tube.fitting import LEAST_SIGMA, STRAY_SIGMAS, TubeFit, fit_model
from endoct.modalities.tube.target import Target

ANGLE_DEG, DISTANCE, DISTORTION = 8.0, 1.2, 0.02
"""Standard errors, for mirrors of any make, also those that look along parallel rays.

They say how far the half angle lies from 45° and the distortion at the outer rim from 0. The logarithm of the distance
over the bore's radius is compared with that of ``USUAL_DISTANCE``."""
USUAL_DISTANCE = 2.5
CENTRE_PX, OFFSET_MM, TILT_RAD = 3.0, 0.05, 0.02
"""How far the optical axis lies from the outer rim's centre, the bore's axis from the probe's, and their tilt."""
CLUSTER_MM = 0.5
SHIFT_MM, TREND_MM, BEND_MM = 0.003, 0.0035, 0.002
"""By how much light shifts the helical groove's middle along the circumference.

In a ring against elsewhere, from mid annulus to a rim, and by a parabola along the annulus. They are from the preset
`tube`, seeds 0, 1 and 20 to 22."""
N_PARAMETERS = 16
ANGLE, FOCAL, DISTANT, DISTORTED, X, Y, OFF_X, OFF_Y, TILT_X, TILT_Y = range(10)
RADIUS, DEPTH, BRIM, SHIFT, TREND, BEND = range(10, N_PARAMETERS)
"""Parameters of the fit.

ANGLE, FOCAL, DISTANT, DISTORTED: half angle, rad; logarithms of focal length and distance; distortion at the outer rim,
relative.

X, Y, OFF_X, OFF_Y, TILT_X, TILT_Y: optical axis, px; the probe's axis off the bore's, mm, and its tilt.

RADIUS, DEPTH, BRIM: radius and ring's depth off the stated ones, and how far below the wall grooves' edges are seen,
mm.

SHIFT, TREND, BEND: the helical groove's shifts, mm."""
UNDISTORTING = 6


@dataclass(frozen=True, eq=False)
class TubeModel:
    """How far points of grooves lie from where the parameters put them.

    ``sign``: +1 where larger radii of the image look farther in; ``sense``: −1 for mirrored images. ``rims_px``: radii
    of inner and outer rim.
    """

    marks: Marks
    target: Target
    sign: int
    sense: int
    rims_px: tuple[float, float]

    def start(self, optics: ConeOptics, scale: float) -> Coordinates:
        """Return parameters to begin with: those of ``optics``, whose z is to be multiplied by ``scale``."""
        values = np.zeros(N_PARAMETERS)
        values[ANGLE] = optics.half_angle_rad
        values[FOCAL], values[DISTANT] = math.log(optics.focal_px / scale), math.log(optics.mirror_distance_mm)
        return values

    def expected(self) -> tuple[Coordinates, Coordinates]:
        """Return what is known of the parameters beforehand, and its standard errors."""
        known, expected, sigma = self.target.standard_errors, np.zeros(N_PARAMETERS), np.full(N_PARAMETERS, np.inf)
        expected[ANGLE], sigma[ANGLE] = math.pi / 4, math.radians(ANGLE_DEG)
        expected[DISTANT], sigma[DISTANT] = math.log(USUAL_DISTANCE * self.target.radius_mm), DISTANCE
        sigma[DISTORTED] = DISTORTION
        sigma[[X, Y]], sigma[[OFF_X, OFF_Y]], sigma[[TILT_X, TILT_Y]] = CENTRE_PX, OFFSET_MM, TILT_RAD
        sigma[RADIUS], sigma[DEPTH] = max(known.bore_diameter_mm / 2, 1e-5), max(known.depth_mm, 1e-5)
        expected[BRIM], sigma[BRIM] = self.target.ink_depth_mm, max(known.ink_depth_mm, 1e-5)
        sigma[[SHIFT, TREND, BEND]] = SHIFT_MM, TREND_MM, BEND_MM
        return expected, sigma

    def places(self, values: Coordinates) -> tuple[Coordinates, Coordinates]:
        """Return z from the apex and θ of the marks on the tube, but for where frames lie and how they are rolled."""
        marks = self.marks
        x = marks.r_px * np.cos(marks.angle_rad) - values[X]
        y = marks.r_px * np.sin(marks.angle_rad) - values[Y]
        r_px = np.hypot(x, y)
        cos, sin = x / r_px, y / r_px
        tan_psi = self.tan_psi(values, r_px)
        a, distance = values[ANGLE], math.exp(values[DISTANT])
        z = distance * tan_psi / (math.tan(a) - tan_psi)
        rho = z * math.tan(a)
        out = 2 * a - np.arctan(tan_psi)
        start = _tilted(rho * cos, rho * sin, z, values[TILT_X], values[TILT_Y])
        way = _tilted(np.sin(out) * cos, np.sin(out) * sin, np.cos(out), values[TILT_X], values[TILT_Y])
        px, py = start[0] + values[OFF_X], start[1] + values[OFF_Y]
        depth = self.target.ring_depth_mm + values[DEPTH]
        radius = self.target.radius_mm + values[RADIUS] + values[BRIM] + depth * marks.in_ring
        square, ahead = way[0] ** 2 + way[1] ** 2, px * way[0] + py * way[1]
        inside = radius**2 - px**2 - py**2
        along = (np.sqrt(np.maximum(ahead**2 + square * inside, 1e-9)) - ahead) / square
        theta = np.arctan2(py + along * way[1], px + along * way[0])
        return self.sign * (start[2] + along * way[2]), self.sense * theta

    def tan_psi(self, values: Coordinates, r_px: Coordinates) -> Coordinates:
        """Return the tangent of the angle to the axis of rays at ``r_px``."""
        image = r_px / math.exp(values[FOCAL])
        k1 = self.k1(values)
        tan = image
        for _ in range(UNDISTORTING):
            tan = image / (1 + k1 * tan**2)
        return tan

    def k1(self, values: Coordinates) -> float:
        """Return the distortion's first factor."""
        outer = self.rims_px[1] / math.exp(values[FOCAL])
        return float(values[DISTORTED] / outer**2)

    def distances_mm(self, values: Coordinates) -> Coordinates:
        """Return how far the marks lie from the tube's, along the circumference, less each frame's mean."""
        off = self._off(values)
        return off - self._mean_of_line(off)[self._line]

    def frames(self, values: Coordinates) -> tuple[NDArray[np.intp], Coordinates, Coordinates]:
        """Return which frames show both grooves, and z of the apex and roll in these, on the tube."""
        mean = self._mean_of_line(self._off(values)) / self.target.radius_mm
        axial, helical = mean[0::2], mean[1::2]
        both = np.flatnonzero(np.isfinite(axial) & np.isfinite(helical))
        roll = -axial[both]
        z_mm = (helical[both] + roll - self.target.helix_theta_rad) * self.target.helix_lead_mm / (2 * math.pi)
        return both, z_mm, roll

    def _off(self, values: Coordinates) -> Coordinates:
        z_mm, theta = self.places(values)
        # as on a tube at z = 0 that is not turned; where it lies, marks are off by a constant for each line and frame
        helix = np.where(self.marks.line == HELICAL, 2 * math.pi / self.target.helix_lead_mm * z_mm, 0.0)
        inner, outer = self.rims_px
        along = 2 * (self.marks.r_px - inner) / (outer - inner) - 1
        shift_mm = values[BEND] * along**2 + self.marks.in_ring * (values[SHIFT] + values[TREND] * along)
        off = theta - helix - (self.marks.line == HELICAL) * shift_mm / self.target.radius_mm
        first_of_line = np.zeros(int(self._line.max()) + 1, np.intp)
        first_of_line[self._line[::-1]] = np.arange(self._line.size)[::-1]
        first = first_of_line[self._line]
        return np.asarray(self.target.radius_mm * (off[first] + wrap_rad(off - off[first])))

    @property
    def _line(self) -> NDArray[np.intp]:
        return np.asarray(2 * self.marks.frame + (self.marks.line == HELICAL), np.intp)

    def _mean_of_line(self, off: Coordinates) -> Coordinates:
        n = 2 * (int(self.marks.frame.max()) + 1)
        count = np.bincount(self._line, minlength=n)
        total = np.bincount(self._line, weights=off, minlength=n)
        return np.where(count > 0, total / np.maximum(count, 1), np.nan)

    def clusters(self) -> NDArray[np.intp]:
        """Return which points lie at one place of the tube and err alike, whichever frame shows them."""
        return 1000 * self.marks.line + np.floor(self.marks.z_mm / CLUSTER_MM).astype(np.intp)

    def fit(self, start: Coordinates) -> TubeFit:
        """Return the parameters that fit the helical groove best. Raises :class:`NotSeen` where none do.

        The axial groove only gives how frames are rolled. Its points in a frame err together as the probe wanders, and
        outweighed the helical one's by their number. With them, mm per pixel were off by 0.60 %, without by 0.29 %
        (preset `tube`, seeds 1200–1211, ink's depth known).
        """
        helical = self.marks.line == HELICAL
        alone = replace(self, marks=self.marks.of(helical))
        groups = np.zeros(alone.marks.frame.size, np.intp)
        fit = fit_model(alone.distances_mm, start, *self.expected(), groups, alone.clusters())
        off_mm = self.distances_mm(fit.values)
        scale = SIGMA_PER_MEDIAN * float(np.median(np.abs(off_mm[~helical]))) if (~helical).any() else 0.0
        kept = np.abs(off_mm) < STRAY_SIGMAS * max(scale, LEAST_SIGMA)
        kept[helical] = fit.kept
        return TubeFit(fit.values, fit.covariance, kept, off_mm)


def optics_of(model: TubeModel, values: Coordinates) -> ConeOptics:
    """Return the optics that a fit gives."""
    return ConeOptics(
        *model.rims_px,
        float(values[ANGLE]),
        math.exp(values[FOCAL]),
        math.exp(values[DISTANT]),
        model.target.radius_mm + float(values[RADIUS]),
        (model.k1(values),),
        model.sign,
    )


def _tilted(
    x: Coordinates, y: Coordinates, z: Coordinates, tilt_x: float, tilt_y: float
) -> tuple[Coordinates, Coordinates, Coordinates]:
    return x + tilt_x * z, y + tilt_y * z, z - tilt_x * x - tilt_y * y
