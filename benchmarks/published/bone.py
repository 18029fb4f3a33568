"""A bore in bone of the second origin, its recordings, the CT and a plan: specimens of the task "pose"."""

import gzip
from pathlib import Path

import nibabel
import numpy as np

from benchmarks.independent.pair import write_endoscope, write_pullback
from benchmarks.published.truth import even_turns, write_truth
from benchmarks.second_origin.bores import made
from endoct.modalities.ct.ct_volume import CtVolume
from endoct.modalities.ct.trajectory import write_line
from endoct.workbench.bench.published.definition import Difficulty

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
    to_lps = np.eye(4)
    to_lps[:3, :3], to_lps[:3, 3] = np.asarray(ct.steps_mm)[::-1].T, ct.origin_mm
    image = nibabel.Nifti1Image(np.ascontiguousarray(ct.voxels.T), LPS_TO_RAS @ to_lps)
    image.header.set_xyzt_units("mm")
    path.write_bytes(gzip.compress(image.to_bytes(), 6, mtime=0))
