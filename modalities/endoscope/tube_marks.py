"""The marks of a printed tube in an endoscope's frames: darkness along circles, and where inked grooves cross them."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.compute.parallel import thread_map
from endoct.modalities.contract import FrameStream
from endoct.modalities.endoscope.calibration import EndoscopeCalibration
from endoct.modalities.endoscope.flatfield import estimate_flat_field, frame_exposure
from endoct.modalities.endoscope.light import log_light, reduced_light
from endoct.modalities.endoscope.mirror.annulus import Annulus
from endoct.modalities.endoscope.mirror.band import RIM_PX, Circles
from endoct.modalities.endoscope.mirror.rings import sample
from endoct.modalities.tube.locating import COLUMNS, STEP_MM, TubePose
from endoct.modalities.tube.target import Target

N_CIRCLES, N_ANGLES = 64, 1024
DARKEST, BRIGHTEST = 1.2, -0.3
"""Marks are looked for within this darkness: a deep hole is no darker mark."""
EDGE_MM = 0.1
"""From a ring's edge on, a groove is seen as deep as on one side of it alone."""
NEAREST_GROOVES_MM = 0.2
AROUND_MM = 0.25
"""The wall around a groove is looked at so far beyond its edges."""
LEAST_CONTRAST = 0.15
LEVEL = 0.35
"""A groove has this part of its contrast at its edges: a side that faces the camera is not as dark as the floor."""
WIDTHS = 0.75, 1.3
"""A measured width of a groove is believed between these parts of the stated one."""
LEAST_SAMPLES = 3
RING_EDGE_MM = 0.04
RING_DARKNESS, EDGE_DARKNESS = 0.2, 0.5
"""Rings, which no ink covers, are as dark as this part of the grooves, inside and at their edges."""
AXIAL, HELICAL = 1, 2


@dataclass(frozen=True, eq=False)
class Darkness:
    """Natural logarithm of the light that is missing along circles about the annulus' centre.

    ``image``, float32 (n_frames, ``N_CIRCLES``, ``N_ANGLES``), NaN outside the image; ``r_px``, float64
    (``N_CIRCLES``,); ``light``, float32 (``N_CIRCLES``, ``N_ANGLES``), logarithm of the light on the bare wall.
    """

    image: Image
    r_px: Coordinates
    light: Image

    @property
    def angle_rad(self) -> Coordinates:
        """Image angles of the samples."""
        return np.linspace(0, 2 * np.pi, N_ANGLES, endpoint=False)


def centred(annulus: Annulus) -> Annulus:
    """Return circles about the centre of the outer rim."""
    return annulus.with_drift(0.0, 0.0)


def examine_darkness(stream: FrameStream, calibration: EndoscopeCalibration) -> Darkness:
    """Return the darkness of all frames of a surveyed recording, its light evened out."""
    optics = calibration.optics
    r_px = np.linspace(optics.inner_px + RIM_PX, optics.outer_px - RIM_PX, N_CIRCLES)
    angle = np.linspace(0, 2 * np.pi, N_ANGLES, endpoint=False)

    def of_frame(index: int) -> NDArray[np.float16]:
        light, _ = reduced_light(stream[index].samples, calibration.full_scale, 1)
        columns, rows = Circles(centred(calibration.annuli[index]), r_px).pixel_map(angle)
        strip, inside = sample(np.asarray(light, np.float32), columns, rows)
        return np.where(inside, log_light(strip), np.nan).astype(np.float16)

    logs = np.stack(list(thread_map(of_frame, range(len(stream)))))
    # as of few views: else the axial groove, which stays where it is in the image, would be taken for dirt
    flat = estimate_flat_field(logs, 0.0, 0.5)
    exposure = frame_exposure(logs, flat).astype(np.float32)
    return Darkness(flat.log_light + exposure[:, None, None] - logs, r_px, flat.log_light)


def darkness_map(darkness: Darkness, calibration: EndoscopeCalibration) -> tuple[Coordinates, Coordinates]:
    """Return the darkness of the wall, float64 (n_rows, ``COLUMNS``), NaN where it is not seen, and z of its rows."""
    z_mm = calibration.z_mm[:, None] + calibration.optics.z_mm(darkness.r_px)
    theta = np.mod(darkness.angle_rad + calibration.roll_rad[:, None], 2 * np.pi)
    row = ((z_mm - z_mm.min()) / STEP_MM).astype(np.intp)
    column = (theta * (COLUMNS / (2 * np.pi))).astype(np.intp) % COLUMNS
    cell = row[:, :, None] * COLUMNS + column[:, None, :]
    known = np.isfinite(darkness.image)
    n_rows = int(row.max()) + 1
    clipped = np.clip(darkness.image[known], BRIGHTEST, DARKEST)
    total = np.bincount(cell[known], weights=clipped, minlength=n_rows * COLUMNS)
    count = np.bincount(cell[known], minlength=n_rows * COLUMNS)
    with np.errstate(invalid="ignore"):
        image = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return image.reshape(n_rows, COLUMNS), z_mm.min() + STEP_MM * (np.arange(n_rows) + 0.5)


def darkness_of_tube(target: Target, z_mm: Coordinates, theta_rad: Coordinates) -> Coordinates:
    """Return about how dark a tube is seen at z (n, 1) and θ (m,): its ink, and rings with their edges."""
    from_edge = np.abs(z_mm - target.ring_edges_mm).min(axis=1, keepdims=True)
    rings = RING_DARKNESS * (target.ring_inside_mm(z_mm) > 0) + EDGE_DARKNESS * (from_edge < RING_EDGE_MM)
    return np.asarray(np.minimum(target.inked(z_mm, theta_rad) + rings, 1.2))


@dataclass(frozen=True, eq=False)
class Marks:
    """Where the middles of grooves cross circles, (n,) each.

    ``frame``; ``r_px`` and ``angle_rad`` in the image, about the annulus' centre; ``line``: ``AXIAL`` or ``HELICAL``;
    ``in_ring``: on a ring's floor; ``z_mm`` on the tube, about.
    """

    frame: NDArray[np.intp]
    r_px: Coordinates
    angle_rad: Coordinates
    line: NDArray[np.intp]
    in_ring: Mask
    z_mm: Coordinates

    def of(self, chosen: Mask) -> "Marks":
        """Return some of the marks."""
        return replace(self, **{name: values[chosen] for name, values in vars(self).items()})


def find_marks(
    darkness: Darkness, bore_mm: Coordinates, floor_mm: Coordinates, turn_rad: Coordinates, sense: int, target: Target
) -> Marks:
    """Return the middles of both grooves on every circle of every frame where they are clear.

    ``bore_mm`` and ``floor_mm`` (n_frames, ``N_CIRCLES``): about z of the circles on the tube, where their rays pass
    the bore's radius and the rings' floor. θ on the tube is ``turn_rad`` (n_frames,) + ``sense`` · image angle.
    """
    entering, ending = target.ring_inside_mm(bore_mm), target.ring_inside_mm(floor_mm)
    in_ring = np.minimum(entering, ending) > EDGE_MM
    z_mm = np.where(in_ring, floor_mm, bore_mm)
    helix = target.helix_rad(z_mm)
    apart = target.radius_mm * np.abs(np.angle(np.exp(1j * helix)))
    meet = apart < (target.groove_width_mm + target.helix_width_mm) / 2 + NEAREST_GROOVES_MM
    usable = (in_ring | (entering < -EDGE_MM)) & ~meet
    parts = []
    for line, width, middle in (
        (AXIAL, target.groove_width_mm, np.zeros_like(z_mm)),
        (HELICAL, target.helix_width_mm, helix),
    ):
        frame, circle = np.nonzero(usable)
        expected = sense * (middle - turn_rad[:, None])[frame, circle]
        half_rad = width / 2 / target.radius_mm
        found = _middles(darkness, frame, circle, expected, half_rad, AROUND_MM / target.radius_mm)
        good = np.isfinite(found)
        frame, circle, found = frame[good], circle[good], found[good]
        parts.append(
            Marks(
                frame,
                darkness.r_px[circle],
                found,
                np.full(frame.size, line),
                in_ring[frame, circle],
                z_mm[frame, circle],
            )
        )
    axial, helical = parts
    return Marks(**{name: np.concatenate([getattr(axial, name), getattr(helical, name)]) for name in vars(axial)})


def _middles(
    darkness: Darkness,
    frame: NDArray[np.intp],
    circle: NDArray[np.intp],
    expected_rad: Coordinates,
    half_rad: float,
    around_rad: float,
) -> Coordinates:
    """Return the angle of the middle between a groove's edges, (n,); NaN where they are not clear.

    An edge is where ``LEVEL`` of the contrast is reached.
    """
    step = 2 * np.pi / N_ANGLES
    reach = int(np.ceil((half_rad + around_rad) / step))
    first = np.rint(expected_rad / step).astype(np.intp)
    offset = np.arange(-reach, reach + 1)
    profile = darkness.image[frame[:, None], circle[:, None], (first[:, None] + offset) % N_ANGLES].astype(np.float64)
    smooth = (np.roll(profile, 1, axis=1) + profile + np.roll(profile, -1, axis=1)) / 3
    smooth[:, [0, -1]] = profile[:, [0, -1]]
    margin = max(LEAST_SAMPLES, int(0.6 * around_rad / step))
    ground = np.stack([np.median(smooth[:, :margin], axis=1), np.median(smooth[:, -margin:], axis=1)])
    inner = np.abs(offset) * step < 0.5 * half_rad
    floor = np.median(smooth[:, inner], axis=1)
    middle = np.full(frame.size, np.nan)
    clear = np.isfinite(profile).all(axis=1) & (floor - ground.max(axis=0) > LEAST_CONTRAST)
    for k in np.flatnonzero(clear):
        edges = []
        for side, level in zip((-1, 1), ground[:, k] + LEVEL * (floor[k] - ground[:, k]), strict=True):
            course = smooth[k, reach::side] if side > 0 else smooth[k, reach::-1]
            below = np.flatnonzero(course < level)
            if not below.size or below[0] == 0:
                break
            j = int(below[0])
            edges.append(side * (j - 1 + (course[j - 1] - level) / max(course[j - 1] - course[j], 1e-9)))
        if len(edges) == 2 and WIDTHS[0] < (edges[1] - edges[0]) * step / (2 * half_rad) < WIDTHS[1]:
            middle[k] = (first[k] + (edges[0] + edges[1]) / 2) * step
    return middle


def on_tube(
    pose: TubePose, calibration: EndoscopeCalibration, r_px: Coordinates, ring_depth_mm: float
) -> tuple[Coordinates, Coordinates, Coordinates]:
    """Return z of circles at the bore and at rings' floors (n_frames, n), and turns of frames, as a pose has them."""
    along = calibration.z_mm[:, None] + calibration.optics.z_mm(r_px)
    bore_mm = pose.z_of(along)
    floor_mm = bore_mm + pose.direction * ring_depth_mm * calibration.optics.slant(r_px)
    return bore_mm, floor_mm, pose.theta_rad + pose.sense * calibration.roll_rad
