"""Where a tube's marks lie in an unrolled recording, and whether they are seen well enough to calibrate by.

The tube's template is laid on the recording at every z in small steps, and at every θ by Fourier transform. That is
done at several scales and in all four orientations.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.errors import NotSeen
from endoct.modalities.tube.target import Target

Template = Callable[[Coordinates, Coordinates], Coordinates]
COLUMNS = 128
STEP_MM = 0.04
TOGETHER_MM = 0.25
"""The brightness of rows that lie this close together errs alike."""
MARGIN_MM = 2.0
"""A recording may reach this far beyond the tube's ends."""
LEAST_CORRELATION = 0.6
WINDING_LEAD = 0.03
"""The best orientation's correlation exceeds by this that with a helical groove that winds the other way."""
CLEAR_LEAD, LEAST_SIGMAS = 0.1, 2.0
"""It exceeds that of the tube turned end for end by the first, or rings speak for it by the second, in standard errors.
That was right in 28 of 28 recordings by endoscopes, by 2.1 to 10.5 standard errors and a lead of 0.02 to 0.14. They
were of the preset `tube`, seeds 30–37, and independent recordings, seeds 10–29."""
REMEDY = (
    "check that tube.toml is that of this tube, and that the recording reaches from before its first ring to behind "
    "its second"
)


@dataclass(frozen=True)
class TubePose:
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
    image: Coordinates, row_z_mm: Coordinates, target: Target, template: Template, scales: Iterable[float]
) -> list[TubePose]:
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
    found: list[TubePose] = []
    for direction in (1, -1):
        best: dict[int, TubePose] = {}
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
                        best[sense] = TubePose(first, scale, direction, float(theta[top]), sense, correlation)
        found += best.values()
    return sorted(found, key=lambda pose: -pose.correlation)


def rings_sigmas(
    image: Coordinates, row_z_mm: Coordinates, template: Template, first: TubePose, second: TubePose
) -> float:
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


def clear_pose(
    image: Coordinates, row_z_mm: Coordinates, target: Target, template: Template, scales: Iterable[float]
) -> TubePose:
    """Return how an unrolled recording lies on a tube, by :func:`poses` of the same arguments.

    Raises :class:`NotSeen` where the tube's marks are not seen, or another orientation fits as well.
    """
    best, *others = poses(image, row_z_mm, target, template, scales)
    if best.correlation < LEAST_CORRELATION:
        raise NotSeen(
            "the marks of the tube are not seen",
            found=f"a correlation of {best.correlation:.2f} with its grooves and rings at best",
            expected=f"at least {LEAST_CORRELATION}",
            remedy=REMEDY,
        )
    for other in others:
        lead, turned = best.correlation - other.correlation, other.winding == best.winding
        if lead >= (CLEAR_LEAD if turned else WINDING_LEAD):
            continue
        sigmas = rings_sigmas(image, row_z_mm, template, best, other) if turned else 0.0
        if sigmas < LEAST_SIGMAS:
            raise NotSeen(
                "which way the tube lies cannot be told",
                found=f"correlations of {best.correlation:.2f} and {other.correlation:.2f} for two ways, of which "
                f"rings speak for the first by {sigmas:.1f} standard errors",
                expected=f"{LEAST_SIGMAS:g} standard errors",
                remedy=REMEDY,
            )
    return best


def check_rings(target: Target, z_mm: Coordinates) -> None:
    """Raise :class:`NotSeen` where a recording at ``z_mm`` (n,) of the tube does not show both rings."""
    edges = target.ring_edges_mm
    whole = [
        name
        for name, low, high in (("narrow", edges[0], edges[1]), ("wide", edges[2], edges[3]))
        if ((z_mm > low) & (z_mm < high)).any() and z_mm.min() < low and z_mm.max() > high
    ]
    if len(whole) < 2:
        raise NotSeen(
            "the recording does not show both rings of the tube",
            found=f"the {whole[0]} one alone" if whole else "neither, whole",
            expected="both, from one edge to the other",
            remedy=f"record the tube from {edges[0] - 0.5:.1f} to {edges[3] + 0.5:.1f} mm at least",
        )
