"""What the outer face's course says of its diameter, from beams bent by Snell's law at both faces."""

from dataclasses import replace

import numpy as np
import pytest
from tolerances import COURSE_RTOL

from endoct.modalities.oct.face.course import Course, measure_course
from endoct.modalities.oct.face.face_circle import Capillary, Circle
from endoct.modalities.oct.face.glass import GLASS_INDEX, Glass
from endoct.modalities.oct.face.lines import fit_circle
from endoct.modalities.oct.face.points import Points
from tests.modalities.oct.turning.drawn_slices import NOMINAL, Array, drawn_slice, faces_of

OUTER_MM, THICKNESS_MM = 0.85, 0.15
NO_TURN = np.zeros(NOMINAL.size)


def optical_path(alpha: Array, x: float) -> Array:
    """From (x, 0) to the outer face, by exact refraction at the inner one."""
    start, way = np.array([x, 0.0]), np.stack([np.cos(alpha), np.sin(alpha)], axis=1)

    def reach(place: Array, along: Array, radius: float) -> Array:
        half = (place * along).sum(axis=1)
        return np.asarray(-half + np.sqrt(half**2 + radius**2 - (place**2).sum(axis=1)))

    inner = OUTER_MM - THICKNESS_MM
    first = reach(np.broadcast_to(start, way.shape), way, inner)
    place = start + first[:, None] * way
    normal = place / inner
    cosine = (way * normal).sum(axis=1)
    behind = np.sqrt(1 - (1 - cosine**2) / GLASS_INDEX**2)
    within = way / GLASS_INDEX + (behind - cosine / GLASS_INDEX)[:, None] * normal
    return np.asarray(first + GLASS_INDEX * reach(place, within, OUTER_MM))


def course_of(
    stated_mm: float, *, offset_mm: float = 0.2, error: Array = NO_TURN, thickness_mm: float = THICKNESS_MM
) -> Course | None:
    """Measure eight slices, fitted with circles of the stated radius."""
    rng = np.random.default_rng(1)
    slices, circles = [], []
    for seed in range(8):
        depth = optical_path(NOMINAL + error, offset_mm) + 0.0005 * rng.normal(size=NOMINAL.size)
        points = Points(NOMINAL, depth, np.ones(NOMINAL.size))
        start = Circle(offset_mm, 0.0, float(depth.mean()) - stated_mm, stated_mm)
        circles.append(fit_circle(points, start, width_mm=0.05))
        slices.append(replace(drawn_slice(NO_TURN, 0.0, 0.2 + 0j, seed), points=points))
    faces = replace(faces_of(slices), capillary=Capillary.of(circles, stated_mm))
    return measure_course(slices, faces, Glass(stated_mm, thickness_mm))


@pytest.mark.parametrize("factor", [0.53, 0.95, 1.0, 1.1])
def test_the_diameter_does_not_depend_on_the_stated_one(factor: float) -> None:
    course = course_of(factor * OUTER_MM)
    assert course is not None
    assert course.diameter_mm == pytest.approx(2 * OUTER_MM, rel=COURSE_RTOL)
    assert course.contradicts(2 * factor * OUTER_MM) == (factor == 0.53)
    low_mm, high_mm = course.range_mm
    assert low_mm < 2 * OUTER_MM < high_mm


def test_without_glass_the_range_is_wider() -> None:
    with_glass, without = course_of(OUTER_MM), course_of(OUTER_MM, thickness_mm=0.0)
    assert with_glass is not None
    assert without is not None
    assert without.diameter_mm == pytest.approx(2 * OUTER_MM, rel=2 * COURSE_RTOL)
    assert np.ptp(without.range_mm) > np.ptp(with_glass.range_mm)


@pytest.mark.parametrize("offset_mm", [0.0, 0.03])
def test_near_the_axis_nothing_is_said(offset_mm: float) -> None:
    assert course_of(OUTER_MM, offset_mm=offset_mm) is None


@pytest.mark.parametrize("phase_rad", [0.0, 0.8, np.pi / 2, 2.4])
def test_an_uneven_turn_does_not_contradict_what_is_true(phase_rad: float) -> None:
    """By 1.1°: as large as what simulated catheters do alike in every turn."""
    course = course_of(OUTER_MM, error=0.02 * np.cos(NOMINAL - phase_rad))
    assert course is None or not course.contradicts(2 * OUTER_MM)
