"""What speaks against a pullback's panorama: its stated sizes, uneven turns, fixed lines, the surface found."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.doubt import Doubt
from endoct.base.numeric.circle import wrap_rad
from endoct.modalities.oct.calibration import OctCalibration, row_ranges
from endoct.modalities.oct.face.course import Course
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.surface.background import Background
from endoct.stitching.panorama import Panorama

ODD_WALL_SHARE = 0.1
"""A wall farther off than this part of the bore's radius, in the median, is doubted whatever it looks like."""
ODD_PLAIN_SHARE = 0.018
"""The same for the plain wall of a drilled bore, which is known to a few µm (14 independent recordings, 11 simulated
ones: within 0.6 %)."""
PLAIN_MM = 0.025
MOST_INDEX = 1.6
UNEVEN_RAD = 0.12
"""Departure from an even turn, in the median slice, beyond what catheters do: usually a few degrees, 10° at bends.
The simulator's hardest slices have 0.09 rad; a step of 0.3 rad in every turn leaves 0.14 to 0.26 (8 recordings)."""
LEAST_TURNS = 0.25
"""Turns are judged where at least this part of the slices has a measured one."""
MOST_BONE_BEFORE = 0.1
"""At most this part of the openings may have bone before the surface. It is 0.04 and less in 48 simulated recordings
(`hard`, `quick`, `mastoid`, seeds 100–129) and 34 of a second generator. Where wall was erased on purpose it is 0.25
and more; the cells then scored under 0.7."""
MOST_DARK_WALL = 0.25
"""At most this part of the openings may be dark A-scans, where these are more than :data:`LEAST_DARK_WALL` of the
wall."""
LEAST_DARK_WALL = 0.01
MOST_FLOOR = 0.5
"""The noise may differ between depths by this part of the wall's contrast. Beyond it, bone may have been taken for
noise."""
NEAREST_RAD = math.pi / 4
"""The nearest wall reaches this far to either side of where the wall is nearest."""
MOST_NEAREST_LOST = 0.2
"""At most this part of the wall nearest to the catheter may be invalid where everything else is valid."""
LEAST_OFFSET_MM = 0.05
"""Nearer to the axis, no wall is the nearest."""
LEAST_GAP_RAD = math.radians(5)
MOST_GAPS = 0.5
"""At most this part of the slices may have a gap in the wall that is at least :data:`LEAST_GAP_RAD` wide. It is 0.97 in
a coronary pullback with a guide wire, and 0.07 and less in simulated recordings (`quick`, `mastoid`, `patient`,
`hard`)."""
LEAST_PLAIN = 0.3
"""Where less of the wall is plain, it is no drilled bore, and only its median counts."""
WIDE_MM = 0.06
"""Where nothing is seen over so much of depth, the wall may be found at the wrong end. Lines of seven simulated
recordings, of 0.03 mm at most, were made wider on purpose. At 0.06 mm the Jaccard index of the cells fell by up to
0.11, at 0.075 mm by up to 0.39. The widest among 20 simulated recordings is 0.056 mm."""
MOST_UNDER_LINES = 0.05
"""At most this part of the bore's nominal wall may lie there. In these recordings it was 0.1 to 0.5."""
N_BEAMS = 360


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


def doubts_of_floor(background: Background) -> tuple[Doubt, ...]:
    """Return the doubt that the noise differs between depths by about as much as the wall stands out of it."""
    share = float(np.ptp(background.floor)) / background.contrast
    if share <= MOST_FLOOR:
        return ()
    what = (
        f"Between depths the noise differs by {share:.0%} of what the wall stands out of it: bone may have been taken "
        "for noise, or the wall is too faint to be told from it."
    )
    return (Doubt("noise-near-wall", what, value=share, unit="1", expected=(0.0, MOST_FLOOR)),)


def doubts_of_lines(calibration: OctCalibration) -> tuple[Doubt, ...]:
    """Return the doubt that much of the bore's nominal wall lies under lines that hide it over a wide band of depth."""
    mm = calibration.mm_per_px
    run, _ = label(calibration.background.hidden)
    deep_mm = np.bincount(run, minlength=1) * mm
    deep_mm[0] = 0  # what no line hides
    blind = np.append((deep_mm >= WIDE_MM)[run], False)  # no line is deeper than a B-scan
    if not blind.any():
        return ()
    beam = 2 * np.pi * np.arange(N_BEAMS) / N_BEAMS
    bore = (
        replace(calibration.capillary.circle(i), radius_mm=calibration.grid.radius_mm)
        for i in map(int, np.flatnonzero(~calibration.bridged))
    )
    row = np.rint(np.array([circle.depth_mm(beam) / mm for circle in bore])).astype(np.intp)
    share = float(np.mean(blind[row.clip(0, calibration.n_depth)])) if row.size else 0.0
    if share <= MOST_UNDER_LINES:
        return ()
    what = (
        f"{share:.0%} of the bore's nominal wall lies under fixed lines of the detector (depth rows "
        f"{row_ranges(np.flatnonzero(blind))}), which hide it: it may be found up to {deep_mm.max():.2f} mm off, "
        "and cells there may be none."
    )
    return (Doubt("wall-under-lines", what, value=share, unit="1", expected=(0.0, MOST_UNDER_LINES)),)


def doubts_of_surface(panorama: Panorama) -> Iterator[Doubt]:
    """Yield where the samples as recorded contradict the surface, and where the wall nearest to the catheter is lost.

    Slices whose geometry is bridged, or whose wall is faint, do not count.
    """
    per_slice = {name: of_slices.values for name, of_slices in panorama.per_frame.items()}
    sound = ~(per_slice["bridged"].astype(bool) | per_slice["wall_faint"].astype(bool))
    openings, before, dark = (
        float(per_slice[f"{name}_fraction"][sound].sum()) for name in ("opening", "bone_before", "dark_wall")
    )
    if before > MOST_BONE_BEFORE * openings:
        what = (
            f"In {before / openings:.0%} of what was taken for openings the samples are as bright as bone where the "
            "wall of the bore would be: wall may have been taken for cells."
        )
        yield Doubt("bone-before-surface", what, value=before / openings, unit="1", expected=(0.0, MOST_BONE_BEFORE))
    if dark > max(MOST_DARK_WALL * (openings + dark), LEAST_DARK_WALL * np.count_nonzero(sound)):
        share = dark / (openings + dark)
        what = (
            f"Where the bore's own wall was found, {dark / np.count_nonzero(sound):.1%} of the A-scans are dark behind "
            f"it; openings are {openings / np.count_nonzero(sound):.1%}. Cells may be missed, or the wall is too faint."
        )
        yield Doubt("darkness-behind-wall", what, value=share, unit="1", expected=(0.0, MOST_DARK_WALL))
    yield from _of_nearest(panorama, per_slice, sound)
    yield from _of_gaps(panorama, sound)


def _of_gaps(panorama: Panorama, sound: Mask) -> Iterator[Doubt]:
    """Yield that the wall has a gap along most of the pullback, as behind a guide wire."""
    observed = sound & panorama.valid.any(axis=1)  # in a slice without any wall there is no gap
    if not observed.any():
        return
    widths_rad = panorama.grid.dtheta_rad * longest_gaps(panorama.valid[observed])
    wide = widths_rad >= LEAST_GAP_RAD
    share = float(wide.mean())
    if share <= MOST_GAPS:
        return
    median_deg = math.degrees(float(np.median(widths_rad[wide])))
    what = (
        f"In {share:.0%} of the slices the wall has a gap, {median_deg:.0f}° wide in the median: something "
        "opaque lies before it along the pullback, such as a guide wire. Its edges may be taken for the wall."
    )
    yield Doubt("gap-along-pullback", what, value=share, unit="1", expected=(0.0, MOST_GAPS))


def longest_gaps(valid: Mask) -> NDArray[np.intp]:
    """Return how many samples in a row are not ``valid`` (n, n_theta), at most, around the circle of each row."""
    n = valid.shape[1]
    column = np.arange(2 * n)
    twice = np.concatenate([valid, valid], axis=1)
    last = np.maximum.accumulate(np.where(twice, column, -1), axis=1)  # the valid sample before each, or it itself
    gaps: NDArray[np.intp] = np.minimum((column - last)[:, n:].max(axis=1), n)
    return gaps


def _of_nearest(panorama: Panorama, per_slice: Mapping[str, NDArray[Any]], sound: Mask) -> Iterator[Doubt]:
    slices = sound & (per_slice["offset_mm"] > LEAST_OFFSET_MM)
    from_nearest = panorama.grid.theta_rad - per_slice["offset_direction_rad"][slices, None]
    near = np.abs(wrap_rad(from_nearest)) < NEAREST_RAD
    lost = ~panorama.valid[slices]
    if not near.any():
        return
    share, elsewhere = float(lost[near].mean()), float(lost[~near].mean())
    if share > MOST_NEAREST_LOST and elsewhere < share / 2:
        what = (
            f"Of the wall nearest to the catheter {share:.0%} is not valid, of the rest {elsewhere:.0%}: something "
            "opaque lies there, or the wall was not found where it is nearest."
        )
        yield Doubt("nearest-wall-lost", what, value=share, unit="1", expected=(0.0, MOST_NEAREST_LOST))


def plain_wall(depth_mm: Image) -> PlainWall:
    """Return where the wall (n,), n > 0, is densest: openings of cells are deeper, and none is like another."""
    ordered: Coordinates = np.sort(depth_mm).astype(np.float64)
    last = np.searchsorted(ordered, ordered + 2 * PLAIN_MM, side="right")
    count = last - np.arange(ordered.size)
    first = int(np.argmax(count))
    within = ordered[first : last[first]]
    return PlainWall(float(np.median(within)), within.size / ordered.size)


def _of_wall(depth_mm: Image, stated: OctAcquisition, course: Course | None, *, precise: bool) -> tuple[Doubt, ...]:
    plain = plain_wall(depth_mm)
    beyond_mm, tolerance = float(np.median(depth_mm)), ODD_WALL_SHARE
    if precise and plain.share >= LEAST_PLAIN:
        beyond_mm, tolerance = plain.beyond_mm, ODD_PLAIN_SHARE
    if abs(beyond_mm) <= tolerance * stated.bore_radius_mm:
        return ()
    measured_mm = stated.bore_diameter_mm + 2 * beyond_mm
    what = (
        f"The wall lies {abs(beyond_mm):.3f} mm {'behind' if beyond_mm > 0 else 'before'} the nominal bore, as in a "
        f"bore of {measured_mm:.3f} mm; {stated.bore_diameter_mm:g} mm is stated. "
        f"{_would_agree(beyond_mm, stated, course)}, unless the wrong line was taken for the capillary. "
        f"{_of_course(course)}"
    )
    stated_mm = stated.bore_diameter_mm
    return (Doubt("wall-far-from-nominal", what, None, measured_mm, "mm", stated_mm, key="bore_diameter_mm"),)


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
    key, measured_mm = "capillary_outer_diameter_mm", course.diameter_mm
    return (Doubt("capillary-against-stated", what, None, measured_mm, "mm", stated_mm, key=key),)


def _diameter(course: Course) -> str:
    low_mm, high_mm = course.range_mm
    return f"{course.diameter_mm:.2f} mm ({low_mm:.2f} to {high_mm:.2f})"
