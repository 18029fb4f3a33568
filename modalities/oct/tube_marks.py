"""The marks of a printed tube in a pullback: depths of its wall by sector, and the middles of its grooves by slice."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.compute.parallel import thread_map
from endoct.base.numeric.circle import mean_angle_rad, wrap_rad
from endoct.modalities.contract import FrameStream
from endoct.modalities.oct.bscan import rows_from
from endoct.modalities.oct.calibration import OctCalibration
from endoct.modalities.oct.face.face_circle import circle_distance_mm
from endoct.modalities.oct.surface.background import relative_power, spread_of_noise
from endoct.modalities.oct.undistort import bend_rad
from endoct.modalities.oct.unroll import BeamProfile, profile_beams
from endoct.modalities.tube.locating import TubePose
from endoct.modalities.tube.target import Target

EDGE_MM = 0.06
"""From a mark's edge on, what is measured belongs to one side of it alone."""
AROUND_MM = 0.12
"""The surface is looked for so far before and behind the wall that was found."""
SECTORS = 32
LEAST_BEAMS = 5
NEAREST_GROOVES_MM = 0.15
DEPTHS, AXIAL, HELICAL = range(3)
WIDTHS = 0.7, 1.4
"""A measured width of a groove is believed between these parts of the stated one."""
COLUMNS = np.dtype(
    [
        ("slice_index", np.intp), ("beam_rad", np.float64), ("gap_mm", np.float64), ("in_ring", np.bool_),
        ("in_groove", np.bool_), ("line", np.intp), ("sector", np.intp), ("bend_rad", np.float64),
    ]
)  # fmt: skip
Point = tuple[int, float, float, bool, bool, int, int, float]
"""One point of :class:`Marks`, its values in the order of ``COLUMNS``."""


@dataclass(frozen=True, eq=False)
class Beams:
    """What the beams of all slices met, float64 (n_slices, n_beams), in recording order, in stated mm.

    ``beam_rad``: directions in the frame of each slice; ``gap_mm``: from the capillary's outer face to the wall;
    ``good``: the wall is seen. ``start_rad``, ``x_mm``, ``y_mm``, float64 (n_slices,): where turns start, and the
    catheter's place off the capillary's axis, in that frame. ``z_mm``: nominal places. ``bend_rad``: by how much the
    glass turns the beams. ``face_radius_mm`` of the outer face, as stated. ``around``: power about the wall that was
    found, over that of noise, float32 (n_slices, n_beams, n_samples), the wall in their middle, ``depth_mm`` apart.
    """

    beam_rad: Coordinates
    gap_mm: Coordinates
    good: Mask
    start_rad: Coordinates
    x_mm: Coordinates
    y_mm: Coordinates
    z_mm: Coordinates
    bend_rad: Coordinates
    face_radius_mm: float
    around: Image
    depth_mm: float

    def relief_map(self, radius_mm: float, n_columns: int) -> Coordinates:
        """Return how much farther the wall is from the capillary's axis than ``radius_mm``, (n_slices, n_columns).

        At evenly spaced angles from 0 in the frame that slices share; NaN in slices that do not show it.
        """
        x, y = self.x_mm[:, None], self.y_mm[:, None]
        along = circle_distance_mm(self.beam_rad, x, y, self.face_radius_mm) + self.gap_mm
        x, y = x + along * np.cos(self.beam_rad), y + along * np.sin(self.beam_rad)
        relief = np.hypot(x, y) - radius_mm
        angle = np.mod(np.arctan2(y, x) - self.bend_rad + self.start_rad[:, None], 2 * np.pi)
        columns = 2 * np.pi / n_columns * np.arange(n_columns)
        image = np.full((len(relief), n_columns), np.nan)
        for row, good in enumerate(self.good):
            if 2 * np.count_nonzero(good) > good.size:
                order = np.flatnonzero(good)[np.argsort(angle[row, good])]
                image[row] = np.interp(columns, angle[row, order], relief[row, order], period=2 * np.pi)
        return image


@dataclass(frozen=True, eq=False)
class Marks:
    """Points on a tube, (n,) each.

    ``slice_index``; ``beam_rad`` in that slice's frame; ``gap_mm`` from the capillary's face, NaN for middles of
    grooves; ``in_ring``, ``in_groove``: where on the tube; ``relief_mm``: how much farther from the axis than the bore
    it is there; ``line``: ``DEPTHS``, or middles of the ``AXIAL`` or ``HELICAL`` groove, which come in pairs;
    ``sector``: for depths, which of ``SECTORS``. ``bend_rad``: by how much the glass turned the beam.
    """

    slice_index: NDArray[np.intp]
    beam_rad: Coordinates
    gap_mm: Coordinates
    in_ring: Mask
    in_groove: Mask
    line: NDArray[np.intp]
    sector: NDArray[np.intp]
    bend_rad: Coordinates
    relief_mm: Coordinates


def examine_beams(stream: FrameStream, calibration: OctCalibration) -> Beams:
    """Return what the beams of a surveyed pullback met."""

    def of_slice(index: int) -> tuple[Coordinates, Coordinates, Mask, Coordinates, Image]:
        profile = profile_beams(stream[index], calibration)
        beam = calibration.rotation.beam_rad(index, profile.angle_rad)
        bend = bend_rad(calibration, index, beam)
        good = profile.trusted & profile.surface & (not calibration.bridged[index])
        around = _around(profile, calibration)
        return beam, profile.wall_mm - profile.face_mm, good, bend, around

    slices = thread_map(of_slice, range(len(stream)))
    beam, gap, good, bend, around = (np.array(each) for each in zip(*slices, strict=True))
    capillary = calibration.capillary
    return Beams(
        beam_rad=beam,
        gap_mm=gap,
        good=good,
        start_rad=calibration.rotation.start_rad,
        x_mm=capillary.x_mm,
        y_mm=capillary.y_mm,
        z_mm=calibration.slice_z_mm,
        bend_rad=bend,
        face_radius_mm=capillary.radius_mm,
        around=around,
        depth_mm=calibration.mm_per_px,
    )


def _around(profile: BeamProfile, calibration: OctCalibration) -> Image:
    """Return the power of every beam about its wall, float32 (n_beams, n_samples); NaN beyond the recorded depths."""
    reach = math.ceil(AROUND_MM / calibration.mm_per_px)
    first, background = np.rint(profile.wall_mm / calibration.mm_per_px).astype(np.intp) - reach, calibration.background
    around = rows_from(profile.level, first, 2 * reach + 1)
    return relative_power(around, background.noise, spread_of_noise(background))


@dataclass(frozen=True, eq=False)
class _Row:
    """The beams of one slice, with where they meet the tube: across its grooves, mm, and θ; ``opened``: in a groove."""

    index: int
    z_mm: float
    in_ring: bool
    beam_rad: Coordinates
    gap_mm: Coordinates
    bend_rad: Coordinates
    good: Mask
    opened: Mask
    theta_rad: Coordinates
    axial_mm: Coordinates
    helical_mm: Coordinates

    def point(self, beam_rad: float, gap_mm: float, bend_rad: float, line: int, sector: int, groove: bool) -> Point:
        return self.index, beam_rad, gap_mm, self.in_ring, groove, line, sector, bend_rad


def find_marks(beams: Beams, pose: TubePose, target: Target) -> Marks:
    """Return the points of the tube's marks; the ``pose`` of the pullback says roughly where they lie.

    Slices at the edge of a ring are left out: they may lie on either side of it.
    """
    points: list[Point] = []
    for row in _rows(beams, pose, target):
        points += [*_depths(row, target), *_middles(row, target)]
    return _marks(points, target)


def every_depth(beams: Beams, pose: TubePose, target: Target) -> tuple[Marks, NDArray[np.intp]]:
    """Return the depth of every single beam of which :func:`find_marks` takes medians, and its number in its slice."""
    points, numbers = [], []
    for row in _rows(beams, pose, target):
        for which, in_groove in _places(row, target):
            for beam in which:
                place = float(row.beam_rad[beam]), float(row.gap_mm[beam]), float(row.bend_rad[beam])
                points.append(row.point(*place, DEPTHS, 0, in_groove))
            numbers.append(which)
    return _marks(points, target), np.concatenate(numbers) if numbers else np.empty(0, np.intp)


def _rows(beams: Beams, pose: TubePose, target: Target) -> Iterator[_Row]:
    z_mm = pose.z_of(beams.z_mm)
    inside_ring = target.ring_inside_mm(z_mm)
    for index in map(int, np.flatnonzero(np.abs(inside_ring) > EDGE_MM)):
        in_ring = bool(inside_ring[index] > 0)
        radius_mm = target.radius_mm + target.ring_depth_mm * in_ring
        x, y, beam = beams.x_mm[index], beams.y_mm[index], beams.beam_rad[index]
        gap, bend = beams.gap_mm[index], beams.bend_rad[index]
        along = circle_distance_mm(beam, x, y, radius_mm)
        angle = np.arctan2(y + along * np.sin(beam), x + along * np.cos(beam)) - bend
        theta = pose.theta_rad + pose.sense * (angle + beams.start_rad[index])
        floor_mm = circle_distance_mm(beam, x, y, radius_mm + target.groove_depth_mm / 2)
        opened = gap > floor_mm - circle_distance_mm(beam, x, y, beams.face_radius_mm)
        across = target.from_grooves_mm(z_mm[index], theta)
        yield _Row(index, float(z_mm[index]), in_ring, beam, gap, bend, beams.good[index], opened, theta, *across)


def _marks(points: Sequence[Point], target: Target) -> Marks:
    table = np.array(points, COLUMNS)
    columns = {name: table[name].copy() for name in COLUMNS.names or ()}
    relief = target.ring_depth_mm * columns["in_ring"] + target.groove_depth_mm * columns["in_groove"]
    return Marks(**columns, relief_mm=relief)


def _places(row: _Row, target: Target) -> Iterator[tuple[NDArray[np.intp], bool]]:
    """Yield the beams of each sector of the wall, and of both grooves' floors; and whether they are a groove's."""
    axial = target.groove_width_mm / 2 - np.abs(row.axial_mm)
    helical = target.helix_width_mm / 2 - np.abs(row.helical_mm)
    sector = _sectors(row.theta_rad)
    on_wall = np.maximum(axial, helical) < -EDGE_MM
    places = [(on_wall & (sector == k), False) for k in range(SECTORS)]
    for place, in_groove in (*places, (axial > EDGE_MM, True), (helical > EDGE_MM, True)):
        which = np.flatnonzero(place & row.good)
        if which.size >= LEAST_BEAMS:
            yield which, in_groove


def _sectors(theta_rad: Coordinates) -> NDArray[np.intp]:
    return np.asarray(np.mod(theta_rad, 2 * np.pi) * (SECTORS / (2 * np.pi)), np.intp) % SECTORS


def _depths(row: _Row, target: Target) -> Iterator[Point]:
    """Yield the median depth of each sector of the wall, and of both grooves' floors."""
    sector = _sectors(row.theta_rad)
    for which, in_groove in _places(row, target):
        beam = float(mean_angle_rad(row.beam_rad[which]))
        gap, bend = float(np.median(row.gap_mm[which])), float(np.median(row.bend_rad[which]))
        yield row.point(beam, gap, bend, DEPTHS, int(sector[which[which.size // 2]]), in_groove)


def _middles(row: _Row, target: Target) -> list[Point]:
    """Return the middles of both grooves, each by its edges at half its depth; none where either is not clear."""
    widths = target.groove_width_mm, target.helix_width_mm
    apart = target.radius_mm * abs(float(wrap_rad(target.helix_rad(np.array(row.z_mm)))))
    if apart < sum(widths) / 2 + NEAREST_GROOVES_MM:
        return []
    middles = []
    for line, across, width in zip((AXIAL, HELICAL), (row.axial_mm, row.helical_mm), widths, strict=True):
        near = np.flatnonzero(np.abs(across) < width / 2 + NEAREST_GROOVES_MM)
        if near.size < 2 * LEAST_BEAMS:
            return []
        near = near[np.argsort(across[near])]
        step_mm = row.opened[near] * np.gradient(across[near])
        opening_mm = float(step_mm.sum())
        if not WIDTHS[0] * width < opening_mm < WIDTHS[1] * width:
            return []
        middle_mm = float((step_mm * across[near]).sum()) / opening_mm
        beam = float(np.interp(middle_mm, across[near], np.unwrap(row.beam_rad[near])))
        bend = float(np.interp(middle_mm, across[near], row.bend_rad[near]))
        middles.append(row.point(beam, float("nan"), bend, line, 0, False))
    return middles
