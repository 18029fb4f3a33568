"""Cell evidence: what is thresholded and correlated, made of whatever a panorama provides.

From depth, the relief: how far the surface lies behind the wall around it. From intensity alone, the darkness:
−log of the intensity over that of the wall around it; or, where cells are known to be bright, the brightness, its
negative. The wall is fitted robustly, cells left out.
"""

from dataclasses import replace
from typing import Literal

import numpy as np

from endoct.base.arrays import Image
from endoct.base.errors import EndoctError
from endoct.base.numeric.circle import gaussian
from endoct.base.numeric.ranks import SIGMA_PER_MEDIAN
from endoct.fusion.evidence.drawn_mask import MASK_MODALITY
from endoct.fusion.evidence.evidence import Evidence, Kind, Polarity, on_grid
from endoct.fusion.evidence.relief import WALL_QUANTILE, relief, trust_in
from endoct.fusion.geometry.resample import column_weights, resample, row_weights
from endoct.stitching.panorama import Panorama

LIGHT_AROUND_MM = 1.2
LIGHT_ROUNDS = ((6.0, 1.0), (6.0, 0.6), (4.0, 0.4), (3.0, 0.3), (2.0, 0.2), (1.5, 0.15), (1.2, 0.15))
"""σ in mm along z over which the light is smoothed, and how far behind it samples count, in the rounds of the fit.

The light is the probe's: it differs around it, and changes slowly along the bore. So the fit begins wide along z, where
the floor of a cell as large as the bore is not taken for dim light on the wall.
"""
LIGHT_GRID_MM = 0.05
FAINTEST = 0.02
"""Intensity below this share of the median counts as this: the logarithm of dark noise says nothing."""


def prepare(
    panorama: Panorama, *, prefer: Literal["relief", "intensity"] = "relief", polarity: Polarity = "dark"
) -> Evidence:
    """Return the cell evidence of ``panorama``: relief where it has depth, else darkness; a mask as it is.

    ``prefer`` = "intensity" ignores depth; ``polarity`` says how cells look where there is only intensity. Relief is
    in mm, darkness and brightness in units of the natural logarithm, none floored or capped. Raises
    :class:`EndoctError` where no sample is valid or the intensity is constant.
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


_KIND_OF: dict[Polarity, Kind] = {"dark": "darkness", "bright": "brightness"}


def contrast(evidence: Evidence, polarity: Polarity) -> Image:
    """Return log(intensity / light on the wall), negative where ``polarity`` is "dark", float32 (n_z, n_theta).

    ``evidence`` holds intensity; the light is its slow course over the wall, cells (which are dark, or bright) left
    out. Intensities that may be negative are first shifted so that one in a thousand lies below zero.
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
    """Return evidence for bright cells of evidence for dark ones: negated, and the light taken off anew.

    Where the cells are bright, a fit that leaves dark ones out has taken the light for brighter near them.
    """
    bright = replace(darkness, values=-darkness.values, kind="brightness")
    return replace(bright, values=np.where(bright.valid, bright.values - _light(bright), np.float32(0)))


def _light(behind: Evidence) -> Image:
    """Return the slow course over the wall, on the same samples, of an image in which cells lie behind (higher)."""
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
