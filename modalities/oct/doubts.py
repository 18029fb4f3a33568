"""What a pullback's own geometry says against the sizes that its sidecar states, and against an even turn."""

import math
from dataclasses import dataclass

import numpy as np

from endoct.modalities.oct.calibration import OctCalibration
from endoct.modalities.oct.face.course import Course
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.stitching.arrays import Coordinates, Image
from endoct.stitching.doubt import Doubt

ODD_WALL_SHARE = 0.1
"""Of the bore's radius: a wall that is farther off in the median is doubted, whatever it looks like."""
ODD_PLAIN_SHARE = 0.018
"""The same for the plain wall of a drilled bore, which is known to a few µm (14 independent recordings, 11 simulated
ones: within 0.6 %)."""
PLAIN_MM = 0.025
MOST_INDEX = 1.6
UNEVEN_RAD = 0.12
"""Departure from an even turn, in the median slice, beyond what catheters do: usually a few degrees, 10° at bends.
The simulator's hardest slices have 0.09 rad; a step of 0.3 rad in every turn leaves 0.14 to 0.26 (8 recordings)."""
LEAST_TURNS = 0.25
"""Of the slices whose turn was measured."""
LEAST_PLAIN = 0.3
"""Of the wall: where less of it is plain, it is no drilled bore, and only its median counts."""


@dataclass(frozen=True)
class PlainWall:
    """Where most of the wall lies: ``beyond_mm`` the nominal bore; ``share`` of it within ``PLAIN_MM`` of that."""

    beyond_mm: float
    share: float


def doubts_of_sizes(depth_mm: Image, calibration: OctCalibration) -> tuple[Doubt, ...]:
    """Return what contradicts the sidecar's sizes; ``depth_mm`` (n,) of the valid wall beyond the nominal bore."""
    stated = calibration.acquisition
    return (
        *_of_wall(depth_mm, stated, calibration.course, precise=calibration.parameters.wall == "edge"),
        *_of_face(calibration.course, stated),
    )


def doubts_of_turns(calibration: OctCalibration) -> tuple[Doubt, ...]:
    """Return the doubt that turns are so uneven, through the whole pullback, that something else happened in them."""
    rotation = calibration.rotation
    known = rotation.shape_known
    if known.sum() < max(1, LEAST_TURNS * known.size):
        return ()
    uneven_rad = float(np.median(rotation.peak_rad()[known]))
    if uneven_rad <= UNEVEN_RAD:
        return ()
    what = (
        f"Turns depart by {math.degrees(uneven_rad):.1f}° from even ones in the median slice; catheters do by up to "
        f"{math.degrees(UNEVEN_RAD):.0f}°. That was corrected as far as the capillary's face shows it, but where θ "
        "begins may be off by as much, and A-scans may be lost at one angle of every turn: check the trigger."
    )
    return (Doubt("turns-uneven", what, value=uneven_rad, unit="rad", expected=(0.0, UNEVEN_RAD)),)


def plain_wall(depth_mm: Image) -> PlainWall:
    """Return where the wall (n,), n > 0, is densest: openings of cells are deeper, and none is like another."""
    ordered: Coordinates = np.sort(depth_mm).astype(np.float64)
    last = np.searchsorted(ordered, ordered + 2 * PLAIN_MM, side="right")
    count = last - np.arange(ordered.size)
    first = int(np.argmax(count))
    within = ordered[first : last[first]]
    return PlainWall(float(np.median(within)), within.size / ordered.size)


def _of_wall(depth_mm: Image, stated: OctAcquisition, course: Course | None, *, precise: bool) -> tuple[Doubt, ...]:
    plain, tolerance = plain_wall(depth_mm), ODD_PLAIN_SHARE
    drilled = precise and plain.share >= LEAST_PLAIN
    beyond_mm = plain.beyond_mm if drilled else float(np.median(depth_mm))
    if not drilled:
        tolerance = ODD_WALL_SHARE
    if abs(beyond_mm) <= tolerance * stated.bore_radius_mm:
        return ()
    measured_mm = stated.bore_diameter_mm + 2 * beyond_mm
    what = (
        f"The wall lies {abs(beyond_mm):.3f} mm {'behind' if beyond_mm > 0 else 'before'} the nominal bore, as in a "
        f"bore of {measured_mm:.3f} mm; {stated.bore_diameter_mm:g} mm is stated. "
        f"{_would_agree(beyond_mm, stated, course)}, unless the wrong line was taken for the capillary. "
        f"{_of_course(course)}"
    )
    return (Doubt("wall-far-from-nominal", what, value=measured_mm, unit="mm", expected=stated.bore_diameter_mm),)


def _would_agree(beyond_mm: float, stated: OctAcquisition, course: Course | None) -> str:
    """Name each key with the value of it that puts the wall where the bore is, and that ``course`` leaves open."""
    capillary_mm, gap_mm = stated.capillary_outer_diameter_mm, stated.gap_mm + beyond_mm
    # the value, and how large the capillary then is in millimetres as stated
    changes = [
        (f"bore_diameter_mm = {stated.bore_diameter_mm + 2 * beyond_mm:.3f}", capillary_mm),
        (f"capillary_outer_diameter_mm = {capillary_mm - 2 * beyond_mm:.3f}", capillary_mm - 2 * beyond_mm),
    ]
    if gap_mm > 0:
        longer = gap_mm / stated.gap_mm
        changes.append((f"axial_pixel_mm = {stated.axial_pixel_mm / longer:.5f}", capillary_mm * longer))
        if index := _possible_index(stated.medium_index * longer):
            changes.append((f"medium_index = {index:.2f}", capillary_mm * longer))
    possible = [change for change, then_mm in changes if then_mm > 0]
    likely = [change for change, then_mm in changes if then_mm > 0 and not (course and course.contradicts(then_mm))]
    return f"That agrees with {' or '.join(likely or possible)}"


def _possible_index(index: float) -> float | None:
    return index if 1 <= index <= MOST_INDEX else None


def _of_course(course: Course | None) -> str:
    if course is None:
        return "The catheter is too near the axis for the course of the capillary's face to say which."
    return f"The course of the capillary's face, by itself, gives it a diameter of {_diameter(course)}."


def _of_face(course: Course | None, stated: OctAcquisition) -> tuple[Doubt, ...]:
    stated_mm = stated.capillary_outer_diameter_mm
    if course is None or not course.contradicts(stated_mm):
        return ()
    longer = course.diameter_mm / stated_mm
    changes = [f"capillary_outer_diameter_mm = {course.diameter_mm:.2f}"]
    changes.append(f"axial_pixel_mm = {stated.axial_pixel_mm / longer:.4f}")
    if index := _possible_index(stated.medium_index * longer):
        changes.append(f"medium_index = {index:.2f}")
    what = (
        f"Through the turn, the capillary's outer face runs like a circle of {_diameter(course)}; {stated_mm:g} mm is "
        f"stated. That agrees with {' or '.join(changes)}, unless the wrong line was taken for the capillary."
    )
    return (Doubt("capillary-against-stated", what, value=course.diameter_mm, unit="mm", expected=stated_mm),)


def _diameter(course: Course) -> str:
    low_mm, high_mm = course.range_mm
    return f"{course.diameter_mm:.2f} mm ({low_mm:.2f} to {high_mm:.2f})"
