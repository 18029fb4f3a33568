"""Lines that the detector draws into every A-scan of a pullback, and what only looks like one."""

import numpy as np
import pytest

from endoct.base.arrays import Coordinates, Mask
from endoct.modalities.oct.face.face_circle import Capillary, Circle
from endoct.modalities.oct.face.faces import N_RIPPLE, Faces
from endoct.modalities.oct.face.glass import GLASS_INDEX, Glass
from endoct.modalities.oct.face.lines import Lines
from endoct.modalities.oct.face.points import Points
from endoct.modalities.oct.face.slices import SliceFeatures
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.surface.fixed_lines import FixedLines, find_fixed_lines

PIXEL_MM, N_DEPTH, N_ASCANS, N_SLICES = 0.005, 300, 96, 20
CAPILLARY_MM, BORE_MM, AXIS_DEPTH_MM = 0.85, 1.25, -0.4
ACQUISITION = OctAcquisition(
    modality="oct",
    axial_pixel_mm=PIXEL_MM,
    pullback_pitch_mm=0.2,
    capillary_outer_diameter_mm=2 * CAPILLARY_MM,
    bore_diameter_mm=2 * BORE_MM,
)
GLASS_MM = 0.2
ANGLE_RAD = 2 * np.pi * np.arange(N_ASCANS) / N_ASCANS
DEPTH_MM = PIXEL_MM * np.arange(N_DEPTH)


def lines_of(
    offset_mm: float,
    *,
    line_row: int | None = None,
    wander_mm: float = 0.0,
    glint_db: float = 0.0,
    cell: bool = True,
    face_width_mm: float = 0.01,
    glass_mm: float = GLASS_MM,
    counts_per_db: float = 1.0,
    line_power: float = 100.0,
) -> FixedLines:
    """The lines found in a pullback of glass and bone, the catheter ``offset_mm`` off the axis, seen in dB."""
    rng = np.random.default_rng(7)
    slices, circles = [], []
    for k in range(N_SLICES):
        circle = Circle(offset_mm + wander_mm * np.sin(k / 3), wander_mm * np.cos(k / 2), AXIS_DEPTH_MM, CAPILLARY_MM)
        in_cell: Mask = (np.abs(ANGLE_RAD - 2) < 0.4) & cell & (5 < k < 12)
        power = _glass(circle, face_width_mm, glass_mm) + _bone(circle, in_cell, glint_db)
        if line_row is not None:
            power[:, line_row : line_row + 4] += line_power
        level = (counts_per_db * 10 * np.log10(rng.exponential(1 + power))).astype(np.float32)
        nothing = Lines(**vars(Capillary.of([], CAPILLARY_MM)), support=np.empty(0))
        slices.append(SliceFeatures(Points.none(), N_ASCANS, nothing, level, ANGLE_RAD))
        circles.append(circle)
    faces = Faces(
        Capillary.of(circles, CAPILLARY_MM),
        np.zeros(N_SLICES, np.bool_),
        np.ones(N_SLICES),
        np.zeros(N_SLICES),
        np.zeros((N_SLICES, N_RIPPLE)),
    )
    return find_fixed_lines(slices, faces, Glass(CAPILLARY_MM, glass_mm / GLASS_INDEX), ACQUISITION)


def _glass(circle: Circle, width_mm: float, glass_mm: float) -> Coordinates:
    outer = DEPTH_MM - circle.depth_mm(ANGLE_RAD)[:, None]
    inner = outer + glass_mm
    power: Coordinates = 3000 * np.exp(-((outer / width_mm) ** 2)) + 300 * np.exp(-((inner / width_mm) ** 2))
    return power


def _bone(circle: Circle, in_cell: Mask, glint_db: float) -> Coordinates:
    surface = Circle(circle.x_mm, circle.y_mm, circle.axis_depth_mm, BORE_MM).depth_mm(ANGLE_RAD) + 0.5 * in_cell
    behind = DEPTH_MM - surface[:, None]
    bone = np.where(behind >= 0, 60 * np.exp(-np.maximum(behind, 0) / 0.2), 0)
    glint = 10 ** (glint_db / 10) * np.exp(-((behind / 0.012) ** 2)) if glint_db else 0
    return np.asarray(bone + glint)


@pytest.mark.parametrize("offset_mm", [0.0, 0.03, 0.1, 0.2, 0.3])
@pytest.mark.parametrize("wander_mm", [0.0, 0.03])
@pytest.mark.parametrize("glint_db", [0.0, 30.0])
def test_glass_and_wall_are_no_lines(offset_mm: float, wander_mm: float, glint_db: float) -> None:
    assert not lines_of(offset_mm, wander_mm=wander_mm, glint_db=glint_db).excess.any()


@pytest.mark.parametrize("glass_mm", [0.1, 0.15, 0.2])
@pytest.mark.parametrize("offset_mm", [0.15, 0.2, 0.25])
@pytest.mark.parametrize("face_width_mm", [0.02, 0.03])
def test_the_broad_line_of_the_inner_face_is_none_where_it_is_farthest(
    glass_mm: float, offset_mm: float, face_width_mm: float
) -> None:
    """There it keeps its depth for a third of the turn, and lies deeper than the outer face where that is nearest."""
    assert not lines_of(offset_mm, face_width_mm=face_width_mm, glass_mm=glass_mm).excess.any()


@pytest.mark.parametrize("offset_mm", [0.0, 0.03, 0.1, 0.2])
@pytest.mark.parametrize("wander_mm", [0.0, 0.03])
def test_a_line_in_the_dark_gap_is_one(offset_mm: float, wander_mm: float) -> None:
    row = round((AXIS_DEPTH_MM + (CAPILLARY_MM + BORE_MM) / 2) / PIXEL_MM)
    claimed = np.flatnonzero(lines_of(offset_mm, line_row=row, wander_mm=wander_mm).excess)
    assert set(range(row, row + 4)) <= set(claimed)
    assert np.abs(claimed - row - 1.5).max() <= 6


def test_a_line_where_a_steady_wall_is_cannot_be_claimed() -> None:
    row = round((AXIS_DEPTH_MM + BORE_MM) / PIXEL_MM)
    assert not lines_of(0.0, line_row=row).excess[row - 3 : row + 8].any()


@pytest.mark.parametrize("beyond_mm", [0.03, 0.05, 0.08, 0.1])
@pytest.mark.parametrize("wander_mm", [0.0, 0.01])
def test_a_line_just_behind_where_the_face_is_nearest_is_one(beyond_mm: float, wander_mm: float) -> None:
    """Behind the face in a few directions only, but before it all round: neither sheath nor glass nor wall can be."""
    row = round((AXIS_DEPTH_MM + CAPILLARY_MM - 0.2 + beyond_mm) / PIXEL_MM)
    claimed = np.flatnonzero(lines_of(0.2, line_row=row, wander_mm=wander_mm).excess)
    assert set(range(row, row + 4)) <= set(claimed)


def test_a_sheath_within_the_capillary_is_no_line() -> None:
    row = round((AXIS_DEPTH_MM + CAPILLARY_MM - 0.2) / PIXEL_MM) - 20
    assert not lines_of(0.2, line_row=row).excess.any()


@pytest.mark.parametrize("line_power", [10.0, 100.0])
def test_in_whatever_unit_samples_are_lines_are_the_same(line_power: float) -> None:
    row = round((AXIS_DEPTH_MM + (CAPILLARY_MM + BORE_MM) / 2) / PIXEL_MM)
    in_db = lines_of(0.1, line_row=row, line_power=line_power)
    for counts in (0.1, 12.0):
        found = lines_of(0.1, line_row=row, line_power=line_power, counts_per_db=counts)
        np.testing.assert_allclose(found.excess, counts * in_db.excess, atol=1e-2 * counts)
        np.testing.assert_array_equal(found.undecided, in_db.undecided)
    assert in_db.excess.any()


@pytest.mark.parametrize("before_mm", [0.06, 0.07])
def test_depths_that_no_ascan_judges_are_no_part_of_the_line_next_to_them(before_mm: float) -> None:
    """Behind a line that ends where the face is farthest, nothing is before the face any more."""
    row = round((AXIS_DEPTH_MM + CAPILLARY_MM + 0.2 - before_mm) / PIXEL_MM)
    claimed = np.flatnonzero(lines_of(0.2, line_row=row).excess)
    assert set(range(row, row + 4)) <= set(claimed)
    assert np.abs(claimed - row - 1.5).max() <= 3
