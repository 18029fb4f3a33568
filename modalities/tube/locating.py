"""Where a tube's marks lie in an unrolled recording, by its template.

The template is laid on the recording at every z in small steps, at every θ by Fourier transform, at several scales and
in all four orientations.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.modalities.tube.target import Target

Template = Callable[[Coordinates, Coordinates], Coordinates]
COLUMNS = 128
STEP_MM = 0.04
TOGETHER_MM = 0.25
"""Along which the brightness of neighbouring rows errs alike."""
MARGIN_MM = 2.0
"""Beyond the tube's ends, to which a recording may reach."""


@dataclass(frozen=True)
class Pose:
    """Where a recording lies on a tube: z_tube = z_mm + direction·scale·z, θ_tube = theta_rad + sense·θ.

    ``correlation`` of the recording with the template there.
    """

    z_mm: float
    scale: float
    direction: int
    theta_rad: float
    sense: int
    correlation: float

    @property
    def winding(self) -> int:
        """Which way the helical groove winds in the recording; turned end for end, a tube's winds alike."""
        return self.direction * self.sense

    def z_of(self, z_mm: Coordinates) -> Coordinates:
        """Return z on the tube of the recording's places."""
        return np.asarray(self.z_mm + self.direction * self.scale * z_mm)


def poses(
    image: Coordinates,
    row_z_mm: Coordinates,
    target: Target,
    template: Template,
    scales: Iterable[float],
) -> list[Pose]:
    """Return the best pose of each orientation, the best first.

    ``image`` float64 (n_rows, ``COLUMNS``), NaN where nothing is known, of evenly spaced θ from 0, at places
    ``row_z_mm`` (n_rows,). ``template`` maps z (n, 1) and θ (m,) to what the image would show there.
    """
    known = np.isfinite(image)
    values = np.where(known, image - np.nanmean(image), 0.0)
    energy = float((values**2).sum())
    spectra = np.fft.rfft(values, axis=1)
    z = np.arange(-MARGIN_MM, target.length_mm + MARGIN_MM, STEP_MM)
    theta = np.linspace(0, 2 * np.pi, COLUMNS, endpoint=False)
    table = template(z[:, None], theta)
    means, squares = table.mean(axis=1), (table**2).mean(axis=1)
    waves = np.fft.rfft(table, axis=1)
    found: list[Pose] = []
    for direction in (1, -1):
        best: dict[int, Pose] = {}
        for scale in scales:
            along = direction * scale * row_z_mm
            for first in np.arange(-along.min(), target.length_mm - along.max() + 1e-9, STEP_MM):
                at = np.rint((first + along + MARGIN_MM) / STEP_MM).astype(np.intp)
                at = at.clip(0, z.size - 1)
                spread = squares[at].mean() - means[at].mean() ** 2
                norm = np.sqrt(max(spread * values.size * energy, 1e-12))
                rows = waves[at]
                for sense in (1, -1):
                    # the image's column j lies at template column sense·j + shift
                    product = (spectra.conj() if sense > 0 else spectra) * rows
                    course = np.fft.irfft(product.sum(axis=0), COLUMNS)
                    top = int(np.argmax(course))
                    correlation = float(course[top] / norm)
                    if sense not in best or correlation > best[sense].correlation:
                        best[sense] = Pose(first, scale, direction, float(theta[top]), sense, correlation)
        found += best.values()
    return sorted(found, key=lambda pose: -pose.correlation)


def rings_sigmas(image: Coordinates, row_z_mm: Coordinates, template: Template, first: Pose, second: Pose) -> float:
    """Return by how many standard errors the rings speak for the first pose against the second; 0 where neither.

    Turned end for end, both grooves lie on themselves, and only the rings tell which way a tube lies. They go all
    around, so they are what the medians of rows show, however dark the ink of the grooves. The medians are fitted by
    the mean of both templates and by half their difference: the factor of the latter is positive for the first. Its
    standard error is that of rows that err together over ``TOGETHER_MM``.
    """
    theta = np.linspace(0, 2 * np.pi, COLUMNS, endpoint=False)
    one, other = (
        np.median(template(pose.z_of(row_z_mm)[:, None], pose.theta_rad + pose.sense * theta), axis=1)
        for pose in (first, second)
    )
    seen = 2 * np.count_nonzero(np.isfinite(image), axis=1) > COLUMNS
    if not np.any(one[seen] != other[seen]):
        return 0.0
    values = np.nanmedian(image[seen], axis=1)
    basis = np.stack([np.ones(values.size), (one + other)[seen] / 2, (one - other)[seen] / 2], axis=1)
    inverse = np.linalg.pinv(basis.T @ basis)
    factors = inverse @ (basis.T @ values)
    block = np.floor(row_z_mm[seen] / TOGETHER_MM).astype(np.intp)
    pull = np.zeros((int(np.ptp(block)) + 1, 3))
    np.add.at(pull, block - block.min(), basis * (values - basis @ factors)[:, None])
    variance = float((inverse @ (pull.T @ pull) @ inverse)[2, 2])
    return float(factors[2]) / math.sqrt(max(variance, 1e-12))
