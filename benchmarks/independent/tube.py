"""A printed tube to calibrate by, recorded by the catheter and the mirror of this folder; nothing of it is endoct's."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
from numpy.random import Generator
from PIL import Image
from scipy import ndimage

from benchmarks.independent.bore import STEP_MM, Bore, Cell, Floats, _noise
from benchmarks.independent.catheter import pull_back
from benchmarks.independent.mirror import focal_px, travel, wall_z_mm
from benchmarks.independent.pair import _write_sidecar, endoscope_sidecar, oct_sidecar
from benchmarks.independent.recipe import BoreRecipe, MirrorRecipe, Recipe
from benchmarks.independent.sets import MIRROR_KINDS, _mirror, _pair

RINGS_MM = ((4.2, 0.6), (7.8, 1.8))
RING_DEPTH_MM, GROOVE_DEPTH_MM = 0.4, 0.3
GROOVE_MM, HELIX_MM, HELIX_RAD, LEAD_MM, LENGTH_MM = 0.35, 0.5, 1.5708, 7.0, 13.5
INKED_PX = 2
"""Samples of the maps by which ink goes beyond the floor of a groove, up its sides."""


def write_tube_pair(folder: Path, seed: int) -> None:
    """Write the recordings of a tube, ``tube.toml`` and ``truth.json`` into ``folder``, which must not exist."""
    rng = np.random.default_rng([seed, 4242])
    sigma = {"bore_diameter_mm": rng.uniform(0.001, 0.005), "depth_mm": rng.uniform(0.001, 0.01)}
    sigma["z_mm"] = rng.uniform(0.002, 0.02)
    off = dict(zip((*sigma, "capillary"), rng.normal(size=4).clip(-3, 3), strict=True))
    recipe = _recipe(seed, rng)
    stretch = 1 + off["z_mm"] * sigma["z_mm"] / (RINGS_MM[1][0] - RINGS_MM[0][0])
    bore = _tube(
        recipe.bore.diameter_mm / 2 + off["bore_diameter_mm"] * sigma["bore_diameter_mm"] / 2,
        off["depth_mm"] * sigma["depth_mm"],
        stretch,
        rng,
    )
    pullback = pull_back(bore, recipe.oct, np.random.default_rng([seed, 1]))
    journey = travel(bore, recipe.endoscope, np.random.default_rng([seed, 2]))
    for part in ("oct", "endoscope"):
        (folder / part).mkdir(parents=True)
    import tifffile

    tifffile.imwrite(folder / "oct" / "pullback.tif", pullback.samples, photometric="minisblack")
    capillary_sigma = float(rng.uniform(0.001, 0.004))
    stated = oct_sidecar(recipe.oct, recipe.bore.diameter_mm) | {
        "axial_pixel_mm": recipe.oct.axial_pixel_mm * float(rng.uniform(0.97, 1.03)),
        "pullback_pitch_mm": recipe.oct.pitch_mm * float(rng.uniform(0.97, 1.03)),
        "capillary_outer_diameter_mm": recipe.oct.capillary_outer_mm + float(off["capillary"]) * capillary_sigma,
        "standard_errors": {"capillary_outer_diameter_mm": capillary_sigma},
    }
    stated.pop("handedness", None)
    _write_sidecar(folder / "oct", stated)
    for k, frame in enumerate(journey.frames):
        Image.fromarray(frame).save(folder / "endoscope" / f"frame_{k:04d}.png", compress_level=1)
    of_mirror = endoscope_sidecar(recipe.endoscope, journey, recipe.bore.diameter_mm)
    _write_sidecar(folder / "endoscope", {k: v for k, v in of_mirror.items() if k != "outer_rim"})
    _write_tube(folder / "tube.toml", recipe.bore.diameter_mm, sigma)
    first = int(np.argmin(journey.apex_mm))
    truth = {
        "recipe": asdict(recipe),
        "focal_px": journey.optics.focal_px,
        "inner_px": journey.optics.inner_px,
        "oct_pitch_mm": recipe.oct.pitch_mm,
        "feed_mm": abs(float(np.polyfit(np.arange(journey.apex_mm.size), journey.apex_mm, 1)[0])),
        "endoscope_theta_rad": recipe.endoscope.start_rad + float(journey.roll_rad[first]),
    }
    (folder / "truth.json").write_text(json.dumps(truth, indent=1))


def independent_truth(folder: Path) -> dict[str, dict[str, float | str]]:
    """Return the truth of such recordings by modality and quantity."""
    truth = json.loads((folder / "truth.json").read_text())
    catheter, mirror = truth["recipe"]["oct"], MirrorRecipe(**truth["recipe"]["endoscope"])
    radius, focal = truth["recipe"]["bore"]["diameter_mm"] / 2, truth["focal_px"]
    rims = np.array([truth["inner_px"], (truth["inner_px"] + mirror.outer_px) / 2, mirror.outer_px])
    z, beyond = (wall_z_mm(mirror, r, focal, rims) for r in (radius, radius + 1e-4))
    near = wall_z_mm(mirror, radius, focal, rims[1] + np.array([-0.5, 0.5]))
    sign = 1 if mirror.ahead else -1
    slant = sign * np.degrees(np.arctan((beyond - z) / 1e-4))
    return {
        "oct": {
            "axial_pixel_mm": catheter["axial_pixel_mm"],
            "first_sample_mm": catheter["first_sample_mm"],
            "theta_origin_rad": catheter["start_rad"],
            "pullback_pitch_mm": truth["oct_pitch_mm"],
            "handedness": "mirrored" if catheter["mirrored"] else "same",
            "travel": catheter["travel"],
        },
        "endoscope": {
            "mm_per_px": float(np.diff(near)[0]),
            "visible_length_mm": float(z[2] - z[0]),
            "slant_inner_deg": float(slant[0]),
            "slant_deg": float(slant[1]),
            "slant_outer_deg": float(slant[2]),
            "cone_half_angle_deg": mirror.half_angle_deg,
            "focal_px": focal,
            "mirror_distance_mm": mirror.distance_mm,
            "theta_origin_rad": truth["endoscope_theta_rad"],
            "feed_pitch_mm": truth["feed_mm"],
            "travel": mirror.travel,
            "outer_rim": "ahead" if mirror.ahead else "behind",
        },
    }


def _recipe(seed: int, rng: Generator) -> Recipe:
    diameter = float(rng.choice([2.2, 2.5, 2.8]))
    recipe = _pair(BoreRecipe(diameter_mm=diameter, length_mm=LENGTH_MM), rng)
    oct_ = replace(recipe.oct, start_mm=float(rng.uniform(1.5, 2.8)), linear=False)
    mirror = replace(_mirror(MIRROR_KINDS[seed % 4], rng), stated="feed", ahead=seed % 3 > 0, feed_factor=1.0)
    rims = np.array([mirror.inner_share * mirror.outer_px, mirror.outer_px])
    length = float(np.abs(np.diff(wall_z_mm(mirror, diameter / 2, focal_px(mirror), rims)))[0])
    offset = {"bore_offset_mm": float(rng.uniform(0, 0.06)), "start_mm": 2.2, "length_mm": max(8.0, length + 7)}
    return replace(recipe, oct=oct_, endoscope=replace(mirror, **offset))


def _tube(radius_mm: float, deeper_mm: float, stretch: float, rng: Generator) -> Bore:
    shape = round(LENGTH_MM / STEP_MM), round(2 * np.pi * radius_mm / STEP_MM)
    z = (np.arange(shape[0]) * STEP_MM / stretch)[:, None]
    theta = (np.arange(shape[1]) * (2 * np.pi / shape[1]))[None]
    ring = np.zeros(shape, bool)
    for middle, width in RINGS_MM:
        ring |= np.broadcast_to(np.abs(z - middle) < width / 2, shape)

    def along(angle: Floats) -> Floats:
        return radius_mm * np.abs((angle + np.pi) % (2 * np.pi) - np.pi)

    groove = (along(theta + 0 * z) < GROOVE_MM / 2) | (
        along(theta - HELIX_RAD - 2 * np.pi * z / LEAD_MM) < HELIX_MM / 2
    )
    relief = (RING_DEPTH_MM + deeper_mm) * ring + (GROOVE_DEPTH_MM + deeper_mm) * groove
    inked = ndimage.binary_dilation(groove, iterations=INKED_PX)
    albedo = 1 + 0.08 * _noise(shape, 0.05, rng) + 0.05 * _noise(shape, 0.3, rng)
    marked = ring | groove
    number = np.where(ring & groove, 2, np.where(groove, 1, 0))
    depths = RING_DEPTH_MM, GROOVE_DEPTH_MM, RING_DEPTH_MM + GROOVE_DEPTH_MM
    return Bore(
        radius_mm,
        tuple(Cell(0, 0, 1, (), (), depth, (0, 0), 1, 0.85) for depth in depths),
        np.where(marked, 0.5, 9.0).astype(np.float32),
        (relief + 0.002 * _noise(shape, 0.1, rng)).astype(np.float32),
        number.astype(np.int32),
        np.clip(albedo * np.where(inked, rng.uniform(0.25, 0.5), 1), 0.05, None).astype(np.float32),
        np.exp(0.25 * _noise(shape, 0.3, rng)).astype(np.float32),
    )


def _write_tube(path: Path, diameter_mm: float, sigma: dict[str, float]) -> None:
    lines = [
        f"bore_diameter_mm = {diameter_mm}",
        f"outer_diameter_mm = {diameter_mm + 3.2}",
        f"length_mm = {LENGTH_MM}",
        f"groove_width_mm = {GROOVE_MM}",
        f"helix_width_mm = {HELIX_MM}",
        f"groove_depth_mm = {GROOVE_DEPTH_MM}",
        f"helix_theta_rad = {HELIX_RAD}",
        f"helix_lead_mm = {LEAD_MM}",
        f"ring_z_mm = {[middle for middle, _ in RINGS_MM]}",
        f"ring_width_mm = {[width for _, width in RINGS_MM]}",
        f"ring_depth_mm = {RING_DEPTH_MM}",
        "[standard_errors]",
        *(f"{name} = {value:.6f}" for name, value in sigma.items()),
    ]
    path.write_text("\n".join(lines) + "\n")
