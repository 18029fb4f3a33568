"""Specimens of the second generator: bores with cells, the catheter turning unevenly, and bores in bone with a CT."""

import gzip
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import nibabel
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from benchmarks.independent.bore import Floats, drill
from benchmarks.independent.catheter import Pullback, pull_back
from benchmarks.independent.mirror import travel
from benchmarks.independent.pair import Pair, write_endoscope, write_pullback
from benchmarks.independent.recipe import Recipe
from benchmarks.independent.sets import recipe_of
from benchmarks.published.truth import Turns, even_turns, write_truth
from benchmarks.second_origin.bores import made
from endoct.modalities.ct.ct_volume import CtVolume
from endoct.modalities.ct.trajectory import write_line
from endoct.workbench.bench.published.definition import Difficulty, Planned
from endoct.workbench.bench.published.making import WRITERS, Writer

FINER = 4
"""Even A-scans that are recorded for one of an uneven turn, which is the nearest of them: none is interpolated."""
LOW_LIGHT = 0.35, 0.6


@dataclass(frozen=True)
class Turning:
    """How unevenly a catheter turns.

    ``peak_deg`` of the rotation error within a turn, ``jitter`` of a turn's length, relative rms, and the share of
    pullbacks in which every turn starts ``free``, anywhere.
    """

    peak_deg: float
    jitter: float
    free: float


KINDS: dict[Difficulty, tuple[tuple[str, ...], Turning]] = {
    "easy": (("few",), Turning(1.0, 0.002, 0.0)),
    "middle": (("usual", "sound"), Turning(3.0, 0.005, 0.25)),
    "hard": (("many", "tiny", "floors"), Turning(8.0, 0.01, 0.5)),
}
"""By difficulty, the sets of recipes that are drawn from, and the turning."""


def write_walls(folder: Path, difficulty: Difficulty, seed: int) -> None:
    """Write a specimen into ``folder``, which must not exist."""
    names, turning = KINDS[difficulty]
    rng = np.random.default_rng([seed, 7])
    recipe = recipe_of(names[int(rng.integers(len(names)))], seed)
    if difficulty == "hard":
        dim = replace(recipe.endoscope, exposure=float(rng.uniform(*LOW_LIGHT)))
        recipe = replace(recipe, endoscope=dim)
    pair, turns = _recorded(recipe, turning, seed)
    for side in ("oct", "endoscope"):
        (folder / side).mkdir(parents=True)
    write_pullback(pair.oct, recipe, folder / "oct")
    write_endoscope(pair.endoscope, recipe, folder / "endoscope")
    write_truth(folder / "truth", pair, turns, {"seed": seed, "difficulty": difficulty, "recipe": asdict(recipe)})


def _recorded(recipe: Recipe, turning: Turning, seed: int) -> tuple[Pair, Turns]:
    """Return the pair of a recipe, as :func:`benchmarks.independent.make_pair` draws it but for the turns."""
    bore_rng, oct_rng, endoscope_rng, turn_rng = (np.random.default_rng([seed, part]) for part in range(4))
    bore = drill(recipe.bore, bore_rng)
    fine = replace(recipe.oct, a_scans=FINER * recipe.oct.a_scans)
    turns = uneven_turns(recipe.oct.slices, turning, turn_rng)
    pullback = turned(pull_back(bore, fine, oct_rng), turns, recipe.oct.start_rad, mirrored=recipe.oct.mirrored)
    return Pair(recipe, bore, pullback, travel(bore, recipe.endoscope, endoscope_rng)), turns


def uneven_turns(n_slices: int, turning: Turning, rng: Generator) -> Turns:
    """Draw turns: three harmonics that hold for the whole pullback and change slowly, lengths and starts."""
    even = even_turns(n_slices)
    shape = rng.normal(size=(2, 3)) / np.arange(1, 4)
    drift = 1 + 0.2 * np.sin(np.linspace(0, 2 * np.pi * rng.uniform(0.5, 2), n_slices) + rng.uniform(0, 2 * np.pi))
    around = np.linspace(0, 2 * np.pi, 360)[:, np.newaxis] * np.arange(1, 4)
    peak = np.abs(np.cos(around) @ shape[0] + np.sin(around) @ shape[1]).max()
    cosines, sines = np.deg2rad(turning.peak_deg) / peak * shape
    start = rng.uniform(0, 2 * np.pi, n_slices) if rng.random() < turning.free else 0.0 * even.start_rad
    return Turns(
        start_rad=start,
        length=1 + turning.jitter * rng.normal(size=n_slices),
        cosines_rad=drift[:, np.newaxis] * cosines,
        sines_rad=drift[:, np.newaxis] * sines,
    )


def turned(pullback: Pullback, turns: Turns, start_rad: float, *, mirrored: bool) -> Pullback:
    """Return what an uneven catheter records where an even one recorded ``pullback``, :data:`FINER` as fine."""
    n_fine = pullback.samples.shape[2]
    angles = turns.angles_rad(n_fine // FINER)
    chosen: NDArray[np.intp] = np.rint(angles / (2 * np.pi) * n_fine).astype(np.intp) % n_fine
    samples = np.take_along_axis(pullback.samples, chosen[:, np.newaxis, :], axis=2)
    sense = -1.0 if mirrored else 1.0
    beams: Floats = start_rad + sense * chosen * (2 * np.pi / n_fine)
    return replace(pullback, samples=samples, angle_rad=beams)


LPS_TO_RAS = np.diag([-1.0, -1.0, 1.0, 1.0])


def write_bone_bore(folder: Path, difficulty: Difficulty, seed: int) -> None:
    """Write a specimen into ``folder``, which must not exist; hard ones have cells on a third of the bore only."""
    bore = made(seed, sparse=difficulty == "hard")
    for side in ("oct", "endoscope"):
        (folder / side).mkdir(parents=True)
    write_pullback(bore.pair.oct, bore.pair.recipe, folder / "oct")
    write_endoscope(bore.pair.endoscope, bore.pair.recipe, folder / "endoscope")
    write_scan(folder / "ct.nii.gz", bore.ct)
    write_line(bore.plan, "plan", folder / "plan.mrk.json")
    world = {"coordinates": "lps", "bore_to_world": bore.to_lps.tolist()}
    sample = {"seed": seed, "difficulty": difficulty, "bore": {"length_mm": bore.length_mm}}
    write_truth(folder / "truth", bore.pair, even_turns(bore.pair.recipe.oct.slices), sample, world)


def write_scan(path: Path, ct: CtVolume) -> None:
    """Write a CT as NIfTI, the same bytes for the same voxels."""
    to_ras = LPS_TO_RAS @ ct.to_lps[:, [2, 1, 0, 3]]  # NIfTI counts i first
    image = nibabel.Nifti1Image(np.ascontiguousarray(ct.voxels.T), to_ras)
    image.header.set_xyzt_units("mm")
    path.write_bytes(gzip.compress(image.to_bytes(), 6, mtime=0))


def second_specimen(folder: Path, specimen: Planned) -> None:
    """Write a specimen of the second generator: in bone with a CT for the task "pose", else a wall with cells."""
    if "pose" in specimen.kind.tasks:
        write_bone_bore(folder, specimen.kind.difficulty, specimen.seed)
    else:
        write_walls(folder, specimen.kind.difficulty, specimen.seed)


BOTH: Mapping[str, Writer] = {**WRITERS, "second": second_specimen}
