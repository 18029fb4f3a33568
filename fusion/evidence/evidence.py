"""Evidence for cells: what is thresholded and correlated, made of whatever a panorama provides.

From depth comes the relief: how far the surface lies behind the wall around it. From intensity alone comes the
darkness: −log of the intensity over that of the wall around it. Where cells are known to be bright, it is the
brightness, its negative. The wall is fitted robustly, with cells left out.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.errors import EndoctError
from endoct.base.numeric.circle import gaussian, masked_gaussian
from endoct.base.numeric.ranks import SIGMA_PER_MEDIAN
from endoct.fusion.evidence import MASK_MODALITY
from endoct.fusion.evidence.relief import WALL_QUANTILE, relief, trust_in
from endoct.fusion.geometry.placement import column_weights, resample, row_weights
from endoct.stitching.panorama import Panorama

EvidenceKind = Literal["relief", "darkness", "brightness", "probability", "mask"]
Polarity = Literal["dark", "bright"]

CLIP = {
    "relief": (0.0, 0.15),
    "darkness": (-0.5, 1.0),
    "brightness": (-0.5, 1.0),
    "probability": (0.0, 1.0),
    "mask": (0.0, 1.0),
}
"""Beyond these bounds evidence of a kind says no more; relief is in mm, a probability that of a cell."""
LIGHT_AROUND_MM = 1.2
LIGHT_ROUNDS = ((6.0, 1.0), (6.0, 0.6), (4.0, 0.4), (3.0, 0.3), (2.0, 0.2), (1.5, 0.15), (1.2, 0.15))
"""Rounds of the fit of the light: σ in mm along z over which it is smoothed, and how far behind it samples count.

The light is the probe's: it differs around the probe and changes slowly along the bore. So the fit begins wide along z.
There the floor of a cell as large as the bore is not taken for dim light on the wall.
"""
LIGHT_GRID_MM = 0.05
FAINTEST = 0.02
"""An intensity below this share of the median counts as this share: the logarithm of dark noise says nothing."""
_KIND_OF: dict[Polarity, EvidenceKind] = {"dark": "darkness", "bright": "brightness"}


@dataclass(frozen=True, eq=False)
class Evidence:
    """Evidence for cells on a panorama's own samples: float32 ``values`` (n_z, n_theta), 0 where not ``valid``.

    Higher values speak for a cell. For darkness that is a guess until something else says whether cells are dark or
    bright. ``slant``: z by which the view goes on for each mm beyond the wall, None where that is not known.

    >>> wall = np.zeros((40, 128), np.float32)
    >>> wall[15:25, 30:50] = 0.3  # a cell, 0.3 mm deep
    >>> evidence = Evidence(wall, np.isfinite(wall), 0.1 * np.arange(40), 0.1, 0.0, 1.25, kind="relief")
    >>> evidence.knows_cells, round(evidence.column_mm, 4)
    (True, 0.0614)
    >>> f"{clipped(evidence).values.max():.2f} mm"  # deeper says no more
    '0.15 mm'
    """

    values: Image
    valid: Mask
    z_mm: Coordinates
    dz_mm: float
    theta0_rad: float
    radius_mm: float
    kind: EvidenceKind
    slant: float | None = None

    @property
    def knows_cells(self) -> bool:
        """Whether the values say by themselves what is a cell."""
        return self.kind in ("relief", "probability", "mask")

    @property
    def column_mm(self) -> float:
        """Arc length of one column, mm."""
        return float(2 * np.pi * self.radius_mm / self.values.shape[1])


def on_grid(evidence: Evidence, z_mm: Coordinates, n_theta: int) -> Evidence:
    """Return ``evidence`` on evenly spaced rows at ``z_mm`` and ``n_theta`` columns from θ = 0."""
    dz_mm = float(z_mm[1] - z_mm[0]) if z_mm.size > 1 else evidence.dz_mm
    rows = row_weights(evidence.z_mm, evidence.dz_mm, z_mm, dz_mm)
    n_from = evidence.values.shape[1]
    theta_rad = 2 * np.pi / n_theta * np.arange(n_theta)
    columns = column_weights(n_from, (theta_rad - evidence.theta0_rad) * n_from / (2 * np.pi), n_from / n_theta)
    values, valid = resample(evidence.values, evidence.valid, rows, columns)
    return replace(evidence, values=values, valid=valid, z_mm=z_mm, dz_mm=dz_mm, theta0_rad=0.0)


def clipped(evidence: Evidence) -> Evidence:
    """Return ``evidence`` without the values beyond which it says no more."""
    return replace(evidence, values=np.clip(evidence.values, *CLIP[evidence.kind]))


def correlation(a: Evidence, b: Evidence) -> float:
    """Return the correlation of two kinds of evidence on the same samples; 0 where either is constant."""
    both = a.valid & b.valid
    if both.sum() < 2:
        return 0.0
    (of_a, common), (_, of_b) = np.cov(clipped(a).values[both], clipped(b).values[both])
    return float(common / np.sqrt(of_a * of_b)) if of_a > 0 and of_b > 0 else 0.0


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


def prepare(
    panorama: Panorama, *, prefer: Literal["relief", "intensity"] = "relief", polarity: Polarity = "dark"
) -> Evidence:
    """Return the cell evidence of ``panorama``: relief where it has depth, else darkness; a mask as it is.

    ``prefer`` = "intensity" ignores depth; ``polarity`` says how cells look where there is only intensity. Relief is
    in mm, darkness and brightness are natural logarithms; none is floored or capped.

    Raises :class:`EndoctError` where no sample is valid or the intensity is constant.
    """
    valid = panorama.valid & np.isfinite(panorama.intensity)
    image, kind = panorama.intensity, _KIND_OF[polarity]
    if panorama.modality == MASK_MODALITY:
        kind = "mask"
    elif panorama.depth_mm is not None and prefer == "relief":
        valid = panorama.valid & np.isfinite(panorama.depth_mm)
        image, kind = panorama.depth_mm, "relief"
    if not valid.any():
        raise EndoctError(
            f"nothing of the wall is valid in the {panorama.modality} panorama", remedy="look at how it was unrolled"
        )
    grid = panorama.grid
    values = np.where(valid, image, np.float32(0))
    slants = panorama.per_frame.get("view_slant")
    slant = None if slants is None or not np.isfinite(slants.values).all() else float(np.mean(slants.values))
    raw = Evidence(values, valid, panorama.z_mm, grid.dz_mm, grid.theta0_rad, grid.radius_mm, kind, slant)
    if kind == "relief":
        return replace(raw, values=relief(values, valid, panorama.z_mm))
    return raw if kind == "mask" else replace(raw, values=contrast(raw, polarity))


def contrast(evidence: Evidence, polarity: Polarity) -> Image:
    """Return log(intensity / light on the wall), negative where ``polarity`` is "dark", float32 (n_z, n_theta).

    ``evidence`` holds intensity. The light is its slow course over the wall, without the cells, which are dark or
    bright. Intensities that may be negative are first shifted so that one in a thousand lies below zero.
    """
    intensities = evidence.values[evidence.valid]
    least = min(0.0, float(np.quantile(intensities, 0.001)))
    typical = float(np.median(intensities)) - least or float(intensities.max()) - least
    if not typical > 0 or intensities.min() == intensities.max():
        raise EndoctError(
            "the intensity of a panorama is constant", found=f"{intensities[0]:g}", expected="a wall with cells"
        )
    log = np.log(np.maximum((evidence.values - np.float32(least)) / np.float32(typical), np.float32(FAINTEST)))
    behind = -log if polarity == "dark" else log
    light = _light(replace(evidence, values=behind))
    return np.where(evidence.valid, behind - light, np.float32(0)).astype(np.float32)


def brightness(darkness: Evidence) -> Evidence:
    """Turn evidence for dark cells into evidence for bright ones: negate it, and take the light off anew.

    A fit that left dark cells out has taken the light near bright ones for brighter than it is.
    """
    bright = replace(darkness, values=-darkness.values, kind="brightness")
    return replace(bright, values=np.where(bright.valid, bright.values - _light(bright), np.float32(0)))


def _light(behind: Evidence) -> Image:
    """Return the light on the wall on the same samples: the slow course of an image in which cells are higher."""
    n_from = behind.values.shape[1]
    n_theta = min(n_from, max(64, round(2 * np.pi * behind.radius_mm / LIGHT_GRID_MM)))
    n_rows = 1 + int(np.ptp(behind.z_mm) / max(LIGHT_GRID_MM, behind.dz_mm))
    coarse = on_grid(behind, np.linspace(behind.z_mm[0], behind.z_mm[-1], n_rows), n_theta)
    known = coarse.values[coarse.valid]
    level = np.full_like(coarse.values, np.quantile(known, WALL_QUANTILE) if known.size else 0.0)
    for sigma_mm, width in LIGHT_ROUNDS:
        sigmas = sigma_mm / coarse.dz_mm, LIGHT_AROUND_MM / coarse.column_mm
        residual = coarse.values - level
        front = -residual[coarse.valid & (residual < 0)]
        reach = max(2.5 * SIGMA_PER_MEDIAN * float(np.median(front)) if front.size else 0.0, width)
        weight = (coarse.valid * trust_in(residual, reach)).astype(np.float32)
        # where there is no wall in reach, the level stays
        level = level + gaussian(weight * residual, *sigmas) / (gaussian(weight, *sigmas) + np.float32(1e-3))
    columns = (behind.theta0_rad + 2 * np.pi / n_from * np.arange(n_from)) * n_theta / (2 * np.pi)
    rows = row_weights(coarse.z_mm, coarse.dz_mm, behind.z_mm, 0.0)
    return resample(level, np.ones(level.shape, np.bool_), rows, column_weights(n_theta, columns, 0.0))[0]
