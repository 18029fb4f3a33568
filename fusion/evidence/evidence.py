"""Evidence for cells on the samples of one side, and what search and refinement do to it."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.numeric.circle import masked_gaussian
from endoct.fusion.geometry.resample import column_weights, resample, row_weights

Kind = Literal["relief", "darkness", "brightness", "mask"]
Polarity = Literal["dark", "bright"]

CLIP = {"relief": (0.0, 0.15), "darkness": (-0.5, 1.0), "brightness": (-0.5, 1.0), "mask": (0.0, 1.0)}
"""Beyond these, evidence of a kind says no more; mm for relief."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """Evidence for cells on a panorama's own samples: float32 ``values`` (n_z, n_theta), 0 where not ``valid``.

    Higher means rather cell; for darkness that is a guess until something else says whether cells are dark or bright.
    ``slant``: z by which the view goes on for 1 mm beyond the wall, None where that is not known.
    """

    values: Image
    valid: Mask
    z_mm: Coordinates
    dz_mm: float
    theta0_rad: float
    radius_mm: float
    kind: Kind
    slant: float | None = None

    @property
    def knows_cells(self) -> bool:
        """Whether the values say by themselves what is a cell."""
        return self.kind in ("relief", "mask")

    @property
    def column_mm(self) -> float:
        """Arc length of one column, mm."""
        return float(2 * np.pi * self.radius_mm / self.values.shape[1])


def on_grid(evidence: Evidence, z_mm: Coordinates, n_theta: int) -> Evidence:
    """Return ``evidence`` on evenly spaced rows at ``z_mm`` and ``n_theta`` columns from θ = 0."""
    dz_mm = float(z_mm[1] - z_mm[0]) if z_mm.size > 1 else evidence.dz_mm
    rows = row_weights(evidence.z_mm, evidence.dz_mm, z_mm, dz_mm)
    columns = column_weights(*_columns_from_zero(evidence, n_theta))
    values, valid = resample(evidence.values, evidence.valid, rows, columns)
    return replace(evidence, values=values, valid=valid, z_mm=z_mm, dz_mm=dz_mm, theta0_rad=0.0)


def _columns_from_zero(evidence: Evidence, n_theta: int) -> tuple[int, Coordinates, float]:
    n_from = evidence.values.shape[1]
    theta_rad = 2 * np.pi / n_theta * np.arange(n_theta)
    return n_from, (theta_rad - evidence.theta0_rad) * n_from / (2 * np.pi), n_from / n_theta


def clipped(evidence: Evidence) -> Evidence:
    """Return ``evidence`` without the values beyond which it says no more."""
    return replace(evidence, values=np.clip(evidence.values, *CLIP[evidence.kind]))


def correlation(one: Evidence, other: Evidence) -> float:
    """Return the correlation of two kinds of evidence on the same samples, 0 where one of them is constant."""
    both = one.valid & other.valid
    if both.sum() < 2:
        return 0.0
    (of_one, common), (_, of_other) = np.cov(clipped(one).values[both], clipped(other).values[both])
    return float(common / np.sqrt(of_one * of_other)) if of_one > 0 and of_other > 0 else 0.0


def blurred(evidence: Evidence, sigma_mm: float) -> Evidence:
    """Return ``evidence`` smoothed by a Gaussian over its valid samples."""
    sigmas = sigma_mm / evidence.dz_mm, sigma_mm / evidence.column_mm
    return replace(evidence, values=masked_gaussian(evidence.values, evidence.valid, *sigmas))


def reoriented(evidence: Evidence, *, mirrored: bool, z_reversed: bool, z_scale: float) -> Evidence:
    """Return ``evidence`` at θ' = ±θ and z' = z_scale·(±z), rows ascending in z'."""
    n_theta = evidence.values.shape[1]
    rows = slice(None, None, -1 if z_reversed else 1)
    columns = slice(None, None, -1 if mirrored else 1)
    last_rad = evidence.theta0_rad + 2 * np.pi * (n_theta - 1) / n_theta
    return replace(
        evidence,
        values=evidence.values[rows, columns],
        valid=evidence.valid[rows, columns],
        z_mm=z_scale * (-evidence.z_mm[::-1] if z_reversed else evidence.z_mm),
        dz_mm=z_scale * evidence.dz_mm,
        theta0_rad=-last_rad if mirrored else evidence.theta0_rad,
        slant=evidence.slant if evidence.slant is None or not z_reversed else -evidence.slant,
    )
