"""Where a tube's marks lie in an unrolled recording, by its template.

The template is laid on the recording at every z in small steps, at every θ by Fourier transform, at several scales and
in all four orientations.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.modalities.tube.target import Target

COLUMNS = 128
STEP_MM = 0.04
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

    def z_of(self, z_mm: Coordinates) -> Coordinates:
        """Return z on the tube of the recording's places."""
        return np.asarray(self.z_mm + self.direction * self.scale * z_mm)


def poses(
    image: Coordinates,
    row_z_mm: Coordinates,
    target: Target,
    template: Callable[[Coordinates, Coordinates], Coordinates],
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
