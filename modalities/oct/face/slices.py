"""What the survey keeps of one B-scan: points on bright lines, the lines, and some A-scans."""

from dataclasses import dataclass

import numpy as np

from endoct.base.arrays import Coordinates, Image
from endoct.modalities.contract import Frame
from endoct.modalities.oct.bscan import (
    Raster,
    logarithmic,
    reduce_theta,
    reduced,
    rows_from,
    sector_angles_rad,
    share_brightening,
)
from endoct.modalities.oct.face.face_circle import Circle
from endoct.modalities.oct.face.lines import Lines, find_lines
from endoct.modalities.oct.face.points import Points, line_points
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.parameters import OctParameters

SURVEY_COLUMNS = 256
KEPT_ASCANS = 96


@dataclass(frozen=True, eq=False)
class SliceFeatures:
    """What the survey keeps of one slice.

    Attributes: ``points`` on bright lines; ``n_columns``, the number of sectors of the turn that were searched for
    them; ``lines`` through them; ``ascans``, some A-scans (n, depth) in the recording's logarithmic samples, at the
    rotation angles ``ascan_angle_rad``; ``saturated``, whether most of the B-scan is; ``brightening``, the share of
    directions that brighten with depth faster than they darken, see :mod:`endoct.modalities.oct.bscan`.
    """

    points: Points
    n_columns: int
    lines: Lines
    ascans: Image
    ascan_angle_rad: Coordinates
    saturated: bool = False
    brightening: float = 1.0


def examine_bscan(
    frame: Frame, acquisition: OctAcquisition, parameters: OctParameters, n_theta: int
) -> tuple[float, SliceFeatures]:
    """Return the nominal place of one B-scan, mm, and what the survey keeps of it.

    ``n_theta`` is the number of columns that unrolling will have; the A-scans are averages over one of these.
    """
    bscan = reduced(frame, n_theta)
    n_ascans, fine = bscan.n_ascans, bscan.image
    n_depth = fine.shape[1]
    n_columns = min(SURVEY_COLUMNS, n_theta)
    coarse = logarithmic(reduce_theta(fine, n_columns), acquisition.intensity)
    raster = Raster(sector_angles_rad(n_ascans, n_columns), n_depth, acquisition.mm_per_px)
    points = line_points(coarse, raster, parameters) if float(np.ptp(coarse)) > 0 else Points.none()
    rng = np.random.default_rng((parameters.seed, frame.index))
    kept = np.linspace(0, n_theta, min(KEPT_ASCANS, n_theta), endpoint=False).astype(int)
    return frame.z_mm, SliceFeatures(
        points=points,
        n_columns=n_columns,
        lines=find_lines(points, raster, acquisition.capillary_radius_mm, parameters.ransac_trials, rng),
        ascans=logarithmic(fine[kept], acquisition.intensity),
        ascan_angle_rad=bscan.angle_rad[kept],
        saturated=bscan.saturated,
        brightening=share_brightening(coarse),
    )


def samples_behind(features: SliceFeatures, circle: Circle, mm_per_px: float, n_px: int) -> Image:
    """Return the samples from the line ``circle`` on, float32 (n_ascans, n_px), NaN outside the B-scan."""
    first = np.round(circle.depth_mm(features.ascan_angle_rad) / mm_per_px).astype(np.intp)
    return rows_from(features.ascans, first, n_px)
