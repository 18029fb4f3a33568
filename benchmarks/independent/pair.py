"""One bore, its two recordings, their sidecars and the truth."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import tifffile
from PIL import Image

from benchmarks.independent.bore import Bore, drill
from benchmarks.independent.catheter import Pullback, pull_back
from benchmarks.independent.mirror import Journey, travel
from benchmarks.independent.recipe import CatheterRecipe, MirrorRecipe, Recipe
from benchmarks.independent.truth import Place, endoscope_place, oct_place


@dataclass(frozen=True, eq=False)
class Pair:
    """A bore, what was recorded of it, and where the panoramas of both sides lie in its frame."""

    recipe: Recipe
    bore: Bore
    oct: Pullback
    endoscope: Journey

    @property
    def oct_place(self) -> Place:
        return oct_place(self.recipe.oct, self.oct)

    @property
    def endoscope_place(self) -> Place:
        return endoscope_place(self.recipe.endoscope, self.endoscope)


def make_pair(recipe: Recipe, seed: int) -> Pair:
    """Return the pair of a recipe; one seed, one pair, whatever else is drawn."""
    bore_rng, oct_rng, endoscope_rng = (np.random.default_rng([seed, part]) for part in range(3))
    bore = drill(recipe.bore, bore_rng)
    return Pair(recipe, bore, pull_back(bore, recipe.oct, oct_rng), travel(bore, recipe.endoscope, endoscope_rng))


def make_pullback(recipe: Recipe, seed: int) -> tuple[Bore, Pullback]:
    """Return the bore of :func:`make_pair` and its pullback, without the endoscope."""
    bore_rng, oct_rng = (np.random.default_rng([seed, part]) for part in range(2))
    bore = drill(recipe.bore, bore_rng)
    return bore, pull_back(bore, recipe.oct, oct_rng)


def write_pair(pair: Pair, folder: Path) -> None:
    """Write both recordings with their sidecars, and the truth, below ``folder``, which must not exist."""
    oct_folder, endoscope_folder, truth = folder / "oct", folder / "endoscope", folder / "truth"
    for made in (oct_folder, endoscope_folder, truth):
        made.mkdir(parents=True)
    write_pullback(pair.oct, pair.recipe, oct_folder)
    write_endoscope(pair.endoscope, pair.recipe, endoscope_folder)
    np.savez(
        truth / "truth.npz",
        cell=pair.bore.level < 1,
        relief_mm=pair.bore.relief_mm,
        oct_z_mm=pair.oct.z_mm,
        oct_angle_rad=pair.oct.angle_rad,
        oct_offset_mm=pair.oct.offset_mm,
        endoscope_apex_mm=pair.endoscope.apex_mm,
        endoscope_roll_rad=pair.endoscope.roll_rad,
    )
    places = {"oct": asdict(pair.oct_place), "endoscope": asdict(pair.endoscope_place)}
    (truth / "truth.json").write_text(json.dumps({"recipe": asdict(pair.recipe), "places": places}, indent=1))


def write_pullback(pullback: Pullback, recipe: Recipe, folder: Path) -> None:
    """Write a pullback and its sidecar into ``folder``, which exists."""
    tifffile.imwrite(folder / "pullback.tif", pullback.samples, photometric="minisblack")
    _write_sidecar(folder, oct_sidecar(recipe.oct, recipe.bore.diameter_mm))


def write_endoscope(journey: Journey, recipe: Recipe, folder: Path) -> None:
    """Write an endoscope's recording and its sidecar into ``folder``, which exists."""
    for k, frame in enumerate(journey.frames):
        Image.fromarray(frame).save(folder / f"frame_{k:04d}.png", compress_level=1)
    _write_sidecar(folder, endoscope_sidecar(recipe.endoscope, journey, recipe.bore.diameter_mm))


def oct_sidecar(recipe: CatheterRecipe, diameter_mm: float) -> dict[str, object]:
    """Return what the OCT's sidecar states."""
    size = recipe.fault_size if recipe.fault in ("pitch", "capillary") else 1.0
    stated: dict[str, object] = {
        "modality": "oct",
        "axial_pixel_mm": recipe.axial_pixel_mm,
        "pullback_pitch_mm": recipe.pitch_mm * (size if recipe.fault == "pitch" else 1.0),
        "bore_diameter_mm": diameter_mm,
        "capillary_outer_diameter_mm": recipe.capillary_outer_mm * (size if recipe.fault == "capillary" else 1.0),
        "intensity": "linear" if recipe.linear else "log",
        "travel": recipe.travel if recipe.states_travel else "unknown",
    }
    if recipe.states_handedness:
        stated["handedness"] = "mirrored" if recipe.mirrored else "same"
    return stated


def endoscope_sidecar(recipe: MirrorRecipe, journey: Journey, diameter_mm: float) -> dict[str, object]:
    """Return what the endoscope's sidecar states."""
    low, high = journey.optics.band_mm
    stated: dict[str, object] = {
        "modality": "endoscope",
        "bore_diameter_mm": diameter_mm,
        "feed_pitch_mm": round(journey.pitch_mm * recipe.feed_factor, 4),
        "outer_rim": "ahead" if recipe.ahead else "behind",
        "travel": recipe.travel if recipe.states_travel else "unknown",
    }
    if recipe.stated in ("optics", "half_angle"):
        stated["cone_half_angle_deg"] = recipe.half_angle_deg
    if recipe.stated == "optics":
        stated |= {"focal_px": round(journey.optics.focal_px, 3), "mirror_distance_mm": recipe.distance_mm}
    if recipe.stated == "visible_length":
        stated["visible_length_mm"] = round(high - low, 4)
    if recipe.states_annulus:
        x, y = journey.optics.centre_px
        stated["annulus"] = {"x": x, "y": y, "inner_px": journey.optics.inner_px, "outer_px": recipe.outer_px}
    return stated


def _write_sidecar(folder: Path, stated: dict[str, object]) -> None:
    def text(value: object) -> str:
        if isinstance(value, dict):
            return "{" + ", ".join(f"{k} = {v!r}" for k, v in value.items()) + "}"
        return json.dumps(value)

    (folder / "acquisition.toml").write_text("".join(f"{k} = {text(v)}\n" for k, v in stated.items()))
