"""A pullback's scales and zeros from a printed tube, by least squares over where its beams meet the tube's marks.

The tube's wall lies at its radius, the capillary's outer face at its own. What lies between them, and the steps of
rings and grooves, give the depth of a pixel. The helical groove is a vernier along z: it gives the pitch, and the two
rings say which way. The zero of the depth axis follows from the capillary, its glass being as thick as its inner face
shows.

Unrolling finds the wall of a beam as a whole sample, sooner where it is bright, later where it is faint. The mean of
many beams, each from where a model has the wall, rises within the axial resolution. Half of that rise marks the
surface, however bright it is. What is found of bore, rings and grooves differs from there by a constant each.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image
from endoct.base.numeric.circle import wrap_rad
from endoct.modalities.oct.calibration import OctCalibration
from endoct.modalities.oct.face.face_circle import circle_distance_mm
from endoct.modalities.oct.tube_marks import AXIAL, DEPTHS, HELICAL, SECTORS, Beams, Marks, every_depth
from endoct.modalities.tube.fitting import TubeFit, fit_model
from endoct.modalities.tube.locating import TubePose
from endoct.modalities.tube.target import Target

SURFACE_MM = 0.0015
"""Standard error of where the bore's surface is taken to be, against the capillary's face."""
STEP_MM, FLOOR_MM = 0.001, 0.001
"""The same of a ring's surface against the bore's, and of a groove's floor against both. All are from the preset
`tube`, seeds 30–43, and independent recordings, seeds 10–23."""
TILTED = 0.02
"""Usual slope of the tube's axis against the capillary's, and what they lie apart, mm, is not bounded."""
CLUSTER_MM = 1.2
N_PARAMETERS = 13
SCALE, WALL, DEPTH, FLOOR, X, Y, LEAN_X, LEAN_Y, Z, PITCH, THETA, SWAY, BULGE = range(N_PARAMETERS)
"""Parameters of the fit.

SCALE: logarithm of true over stated axial pixel.

WALL, DEPTH, FLOOR: wall off the stated radius, all depths off the stated ones, the grooves' floors in addition, mm.

X, Y, LEAN_X, LEAN_Y: the tube's axis off the capillary's in its middle, mm, and its slopes.

Z, PITCH, THETA: z of the nominal z = 0, mm; true over stated pitch; θ of the angle 0.

SWAY, BULGE: what an oblique beam makes of the radius, by the first and the second order of the offset. With these, the
eccentricity says nothing of the scale."""
N_KINDS = 4
"""Surfaces are bore and groove, and both within a ring."""
BEFORE_MM = 0.0015
"""By how much half of the rise lies before the surface, as what returns falls off behind it. It is 0.0011 in the preset
`tube`, seeds 30–43, and 0.0017 in independent recordings, seeds 10–23."""
LEAST_BEAMS = 200
BINS_PER_PX = 4
DARK_MM = -0.1, -0.03
"""Before the surface there is only noise between these."""
BRIGHT_MM = 0.04
"""The brightest lies at most so far behind the surface."""
MOST_POWER = 10.0
"""A glint counts for no more than so many times the median behind the surface."""
NEAR_MM = 0.05
"""Beams whose wall is found farther off the model than that see something else."""


@dataclass(frozen=True, eq=False)
class TubeModel:
    """How far marks lie from where the parameters put them."""

    beams: Beams
    marks: Marks
    target: Target
    pose: TubePose

    def start(self) -> Coordinates:
        """Return parameters to begin with."""
        values = np.zeros(N_PARAMETERS)
        values[[Z, PITCH, THETA]] = self.pose.z_mm, self.pose.scale, self.pose.theta_rad
        return values

    def expected(self, capillary_sigma_mm: float) -> tuple[Coordinates, Coordinates]:
        """Return what is known of the parameters beforehand, and its standard errors, infinite where nothing is."""
        known = self.target.standard_errors
        sigma = np.full(N_PARAMETERS, np.inf)
        sigma[WALL] = math.hypot(known.bore_diameter_mm / 2, capillary_sigma_mm / 2, SURFACE_MM)
        sigma[DEPTH], sigma[FLOOR] = math.hypot(known.depth_mm, STEP_MM), FLOOR_MM
        sigma[[LEAN_X, LEAN_Y]] = TILTED
        return np.zeros(N_PARAMETERS), sigma

    def distances_mm(self, values: Coordinates) -> Coordinates:
        """Return how far each mark lies from the tube's, along the radius or the circumference, float64 (n,)."""
        marks, of, target = self.marks, self.marks.slice_index, self.target
        scale = math.exp(values[SCALE])
        x, y = scale * self.beams.x_mm[of], scale * self.beams.y_mm[of]
        cos, sin = np.cos(marks.beam_rad), np.sin(marks.beam_rad)
        nominal = self.beams.z_mm[of]
        aside = nominal - self.beams.z_mm.mean()
        axis_x, axis_y = (values[at] + values[lean] * aside for at, lean in ((X, LEAN_X), (Y, LEAN_Y)))
        # the tube's axis is given in the frame that slices share; beams are turned there by start and bend
        turn = self.beams.start_rad[of] - marks.bend_rad
        c, s = np.cos(turn), np.sin(turn)
        along = circle_distance_mm(marks.beam_rad, x, y, self.beams.face_radius_mm) + scale * marks.gap_mm
        px, py = x + along * cos, y + along * sin
        radius = np.hypot(c * px - s * py - axis_x, s * px + c * py - axis_y)
        off_axis, aside_mm = x * cos + y * sin, x * sin - y * cos
        radius = radius - values[SWAY] * off_axis - values[BULGE] * aside_mm**2
        steps = marks.in_ring.astype(float) + marks.in_groove
        expected = target.radius_mm + marks.relief_mm + values[WALL] + values[DEPTH] * steps
        # in stated mm, as depths were measured: a smaller scale must not make their errors smaller
        off_radius = (radius - expected - values[FLOOR] * marks.in_groove) / scale

        # where the beam, in the shared frame, is as far from the tube's axis as the groove's edges. This takes the
        # stated offset, so that angles say nothing of the scale
        x, y = self.beams.x_mm[of], self.beams.y_mm[of]
        level = target.radius_mm + target.ring_depth_mm * marks.in_ring
        ox, oy = c * x - s * y - axis_x, s * x + c * y - axis_y
        dx, dy = c * cos - s * sin, s * cos + c * sin
        ahead, across = ox * dx + oy * dy, ox * dy - oy * dx
        reach = np.sqrt(np.maximum(level**2 - across**2, 1e-9)) - ahead
        angle = np.arctan2(oy + reach * dy, ox + reach * dx)
        theta = values[THETA] + self.pose.sense * angle
        z_mm = values[Z] + self.pose.direction * values[PITCH] * nominal
        axial, helical = marks.line == AXIAL, marks.line == HELICAL
        off_angle = theta.copy()
        off_angle[helical] -= theta[axial] + target.helix_rad(z_mm[helical])  # wherever the turn started
        return np.where(marks.line == DEPTHS, off_radius, target.radius_mm * wrap_rad(off_angle))

    def groups(self) -> NDArray[np.intp]:
        """Return which points share a scale of errors: depths of the wall, of grooves, middles of either groove."""
        return np.where(self.marks.line > 0, 1 + self.marks.line, self.marks.in_groove.astype(np.intp))

    def clusters(self) -> NDArray[np.intp]:
        """Return which points lie close together on the tube and err alike."""
        z = np.floor((self.beams.z_mm * self.pose.scale)[self.marks.slice_index] / CLUSTER_MM).astype(np.intp)
        around = 2 * np.pi * self.target.radius_mm / SECTORS
        sector = self.marks.sector // max(1, round(CLUSTER_MM / around))
        return z * 1000 + self.marks.line * 100 + np.where(self.marks.line > 0, 0, sector)

    def fit(self, capillary_sigma_mm: float) -> TubeFit:
        """Return the parameters that fit best. Raises :class:`NotSeen` where none do."""
        start = self.start()
        return fit_model(self.distances_mm, start, *self.expected(capillary_sigma_mm), self.groups(), self.clusters())


def first_sample_mm(values: Coordinates, calibration: OctCalibration) -> Coordinates:
    """Return the optical path from the catheter's axis to depth sample 0, by the capillary's face, float64 (1,)."""
    scale, faces, index = math.exp(values[SCALE]), calibration.faces, calibration.acquisition.medium_index
    known = list(map(int, np.flatnonzero(~faces.bridged)))
    capillary, glass = faces.capillary, calibration.glass
    turn = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    stated = [capillary.circle(i).distance_mm(turn).mean() + capillary.axis_depth_mm[i] for i in known]
    true = [
        circle_distance_mm(turn, scale * capillary.x_mm[i], scale * capillary.y_mm[i], capillary.radius_mm).mean()
        for i in known
    ]
    delay_mm = glass.path_mm - glass.thickness_mm
    return np.array([index * (np.median(np.array(true) - scale * np.array(stated)) + delay_mm)])


def kinds(marks: Marks) -> NDArray[np.intp]:
    """Return on which of the ``N_KINDS`` surfaces points lie, (n,)."""
    return 2 * marks.in_ring.astype(np.intp) + marks.in_groove


def at_surface(marks: Marks, late_mm: Coordinates) -> Marks:
    """Return ``marks`` with the depths of their surfaces, which were found ``late_mm`` (``N_KINDS``,) too deep.

    Depths on a kind of surface for which that is not known are NaN.
    """
    return replace(marks, gap_mm=marks.gap_mm - late_mm[kinds(marks)])


def late_mm(model: TubeModel, values: Coordinates) -> Coordinates:
    """Return by how much the wall is found too deep, by kind, float64 (``N_KINDS``,), in stated mm.

    NaN where few beams show a kind, or it does not stand out.
    """
    beams = model.beams
    marks, number = every_depth(beams, model.pose, model.target)
    every = TubeModel(beams, marks, model.target, model.pose)
    off_px = every.distances_mm(values) / beams.depth_mm
    near = np.abs(off_px) * beams.depth_mm < NEAR_MM
    kind = kinds(marks)
    late = np.full(N_KINDS, np.nan)
    for k in range(N_KINDS):
        which = np.flatnonzero(near & (kind == k))
        if which.size >= LEAST_BEAMS:
            power = beams.around[marks.slice_index[which], number[which]]
            surface_px = half_rise_px(power, off_px[which], beams.depth_mm)
            late[k] = (float(np.median(off_px[which])) - surface_px) * beams.depth_mm - BEFORE_MM
    return late


def half_rise_px(power: Image, off_px: Coordinates, depth_mm: float) -> float:
    """Return where the mean of A-scans rises to half of its brightest, samples from where the wall is expected.

    ``power`` (n, n_samples), NaN where nothing was recorded; the sample in the middle lies ``off_px`` (n,) behind the
    expected place, samples ``depth_mm`` apart. NaN where nothing rises.
    """
    n_samples = power.shape[1]
    place = off_px[:, None] + np.arange(n_samples) - n_samples // 2
    behind = (place > 0) & (place * depth_mm < BRIGHT_MM)
    known = np.isfinite(power)
    clipped = np.minimum(power[known], MOST_POWER * np.nanmedian(power[behind]))
    first = -(n_samples // 2)
    number = np.rint((place[known] - first) * BINS_PER_PX).astype(np.intp)
    n_bins = BINS_PER_PX * (n_samples - 1) + 1
    inside = (number >= 0) & (number < n_bins)
    total = np.bincount(number[inside], weights=clipped[inside], minlength=n_bins)
    count = np.bincount(number[inside], minlength=n_bins)
    wide = np.ones(BINS_PER_PX)
    with np.errstate(invalid="ignore"):
        mean = np.convolve(total, wide, "same") / np.convolve(count, wide, "same")
    # an even number of bins taken together lies half a bin before the one it is written to
    at_px = first + (np.arange(n_bins) - 0.5) / BINS_PER_PX
    dark = float(np.nanmedian(mean[(at_px * depth_mm > DARK_MM[0]) & (at_px * depth_mm < DARK_MM[1])]))
    bright = np.flatnonzero(np.abs(at_px * depth_mm) < BRIGHT_MM)
    top = int(bright[np.nanargmax(mean[bright])])
    half = (dark + mean[top]) / 2
    below = np.flatnonzero(mean[:top] < half)
    if not below.size or not np.isfinite(half) or mean[top] < 2 * dark:
        return float("nan")
    low = int(below[-1])
    return float(at_px[low] + (half - mean[low]) / (mean[low + 1] - mean[low]) / BINS_PER_PX)
