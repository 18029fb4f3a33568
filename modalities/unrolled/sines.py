"""The paper's sine of every row of a depth image whose probe was off the axis, and the wall without it.

The wall itself is the ruler, as nothing else is known: a turn's sine goes through most of its beams. Breakouts and
cavities are left out as outliers. The sine closes after a turn, with ω = 1. It is the first order of a circle, and says
by how much and in which direction the probe was off: a beam meets the wall in another direction than it left in.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.errors import NotSeen
from endoct.base.numeric.ranks import robust_sigma
from endoct.base.numeric.sine import Sine, ransac_sine
from endoct.stitching.grid import SurfaceGrid

LEAST_BEAMS = 16
MOST_TOLERANCE = 0.05
"""Beams farther from the sine than this part of the radius are not the wall's, however noisy."""
CLOSED = Sine(0.0, 1.0, 0.0, 0.0)


class UnrolledParameters(BaseModel):
    """How an unrolled image is processed: only depth that is not centred needs any of it."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    tolerance_sigmas: float = Field(
        default=4.0, gt=0, le=100, description="beams within so many times the noise from beam to beam are the wall's"
    )
    least_inlier_fraction: float = Field(
        default=0.3, gt=0, le=1, description="a turn is bridged unless this part of its beams is the wall's"
    )
    ransac_trials: int = Field(default=500, ge=1, le=100_000, description="trials of the sine of a turn")
    seed: int = Field(default=0, ge=0, le=2**32, description="seed of these trials")


@dataclass(frozen=True, eq=False)
class Sines:
    """The sine of every row, in recording order, float64 (n_rows,) each.

    Attributes: ``cosine_mm`` and ``sine_mm``, its factors of cos θ and sin θ; ``offset_mm``, D; ``residual_mm``, robust
    spread of the beams about it; ``noise_mm``, by how much neighbouring beams differ; ``inlier_fraction`` of the beams;
    ``bridged``, bool, where it is that of rows around.
    """

    cosine_mm: Coordinates
    sine_mm: Coordinates
    offset_mm: Coordinates
    residual_mm: Coordinates
    noise_mm: Coordinates
    inlier_fraction: Coordinates
    bridged: Mask

    def per_frame(self) -> dict[str, Coordinates | Mask]:
        """Return A, φ and D, and how well they fit, by the names of the manifest."""
        return {
            "sine_amplitude_mm": np.hypot(self.cosine_mm, self.sine_mm),
            "sine_phase_rad": np.mod(np.arctan2(self.cosine_mm, self.sine_mm), 2 * np.pi),
            "sine_offset_mm": self.offset_mm,
            "residual_mm": self.residual_mm,
            "beam_noise_mm": self.noise_mm,
            "inlier_fraction": self.inlier_fraction,
            "bridged": self.bridged,
        }


def fit_sines(turns: Sequence[Image], grid: SurfaceGrid, count_mm: float, parameters: UnrolledParameters) -> Sines:
    """Return the sine of every turn, (n_theta,) mm, NaN where nothing was observed; ``count_mm``: the finest step.

    Raises :class:`NotSeen` where no turn shows one.
    """
    noises_mm = np.array([_noise_mm(turn) for turn in turns])
    steps_mm = np.array([_step_mm(turn) for turn in turns])
    known = np.isfinite(steps_mm)
    step_mm = float(np.median(steps_mm[known])) if known.any() else 0.0
    tolerance_mm = min(max(parameters.tolerance_sigmas * step_mm, count_mm), MOST_TOLERANCE * grid.radius_mm)
    fits = np.array([_fit(turn, grid.theta_rad, tolerance_mm, index, parameters) for index, turn in enumerate(turns)])
    known = fits[:, 4] >= parameters.least_inlier_fraction
    if not known.any():
        raise NotSeen(
            "no turn of the depth image goes around a wall",
            found=f"at most {fits[:, 4].max():.0%} of a turn near one sine",
            expected=f"{parameters.least_inlier_fraction:.0%} of it at least",
            remedy="look at the image, or state centred = true where depth counts from the axis or the wall",
        )
    every = np.arange(len(fits))
    cosine, sine, offset = (np.interp(every, every[known], fits[known, column]) for column in range(3))
    return Sines(cosine, sine, offset, fits[:, 3].copy(), noises_mm, fits[:, 4].copy(), bridged=~known)


def _step_mm(turn: Image) -> float:
    """Return the spread of steps between neighbouring beams over √2, mm: noise, and the slope of the sine.

    A probe far off the axis has a steep sine, and departs more from it. NaN where there are none.
    """
    steps = turn - np.roll(turn, 1)
    steps = steps[np.isfinite(steps)]
    return robust_sigma(steps) / math.sqrt(2) if steps.size else float("nan")


def _noise_mm(turn: Image) -> float:
    """Return the noise of single beams, mm, by how far each lies off its neighbours; NaN where none has two.

    A step to one neighbour would hold the sine's own slope.
    """
    off = turn - (np.roll(turn, 1) + np.roll(turn, -1)) / 2
    off = off[np.isfinite(off)]
    return robust_sigma(off) / math.sqrt(1.5) if off.size else float("nan")


def _fit(
    turn: Image, theta_rad: Coordinates, tolerance_mm: float, index: int, parameters: UnrolledParameters
) -> tuple[float, ...]:
    """Return cosine, sine, offset, residual and inlier fraction of one turn; 0 of them where it has no sine."""
    seen = np.isfinite(turn)
    x, y = theta_rad[seen], turn[seen].astype(np.float64)
    nothing = (np.nan, np.nan, np.nan, np.nan, 0.0)
    if x.size < LEAST_BEAMS:
        return nothing
    _, inliers = ransac_sine(
        x,
        y,
        tolerance_mm=tolerance_mm,
        trials=parameters.ransac_trials,
        rng=np.random.default_rng((parameters.seed, index)),
        start=CLOSED,
    )
    if np.count_nonzero(inliers) < LEAST_BEAMS:
        return nothing
    basis = np.column_stack([np.cos(x), np.sin(x), np.ones_like(x)])
    factors = np.linalg.lstsq(basis[inliers], y[inliers])[0]
    residual = y - basis @ factors
    return (*factors, robust_sigma(residual), float(np.mean(np.abs(residual) < tolerance_mm)))


def about_axis(
    depth_mm: Coordinates, theta_rad: Coordinates, offset_mm: tuple[float, float], radius_mm: float
) -> tuple[Coordinates, Coordinates]:
    """Return angle and depth behind a wall of ``radius_mm`` at which the beams of a turn meet it, float64 (n_theta,).

    ``depth_mm``: by how much they are longer than that radius; ``offset_mm``: the probe's x and y off the axis.
    """
    distance_mm = radius_mm + depth_mm
    x = offset_mm[0] + distance_mm * np.cos(theta_rad)
    y = offset_mm[1] + distance_mm * np.sin(theta_rad)
    return np.arctan2(y, x), np.hypot(x, y) - radius_mm
