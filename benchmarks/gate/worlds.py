"""The worlds of the gate: what each case of them comes to, as numbers by name."""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks import accuracy
from benchmarks.independent.run import judged
from benchmarks.real_recordings import wall_of_coronary
from endoct.workbench.bench.runner import run_method
from endoct.workbench.bench.task import SUCCESS
from endoct.workbench.bench.tasks import pose

LEAST_OCT = 0.7
"""An OCT that scores less must be doubted."""
FIRST_SEED = 3000
Numbers = Mapping[str, float]


@dataclass(frozen=True)
class World:
    """Cases of one kind: ``of`` gives what that of a seed comes to; ``recordings``: real ones are needed."""

    name: str
    cases: int
    of: Callable[[int], Numbers]
    recordings: bool = False

    @property
    def seeds(self) -> range:
        """The seeds of its cases."""
        return range(FIRST_SEED, FIRST_SEED + self.cases)


def _independent(name: str, seed: int) -> Numbers:
    """Return what endoct makes of a pair of the second generator."""
    row = next(row for row in judged(name, seed, chains=("endoct",)))
    doubted = float(bool(row.get("doubts")))
    found = {name: float(value) for name, value in row.items() if name in _OF_PAIRS and isinstance(value, float)}
    aligned = float(row["outcome"] == "aligned")
    oct_ = found.get("jaccard_oct", np.nan)
    return found | {
        "aligned": aligned,
        "doubted": doubted,
        "silent": float(oct_ < LEAST_OCT and not doubted),
        "believed": aligned * (1 - doubted),
        "crashed": float(row["outcome"] == "crashed"),
    }


_OF_PAIRS = {
    "jaccard_oct", "jaccard_endoscope", "jaccard_pair", "wrong_oct", "error_theta_sigmas", "error_z_sigmas",
    "error_scale_sigmas",
}  # fmt: skip


def _simulated(preset: str, seed: int) -> Numbers:
    """Return what endoct makes of a specimen of our simulator."""
    (row,) = accuracy.evaluate(seed, {"preset": (preset,)}, [accuracy.MAIN])
    named = {"oct_truth": "jaccard_oct", "endo_truth": "jaccard_endoscope", "pair_native": "jaccard_pair"}
    found = {ours: float(row.scores[theirs]) for theirs, ours in named.items() if theirs in row.scores}
    doubted = float(row.scores.get("doubted", 1.0))
    silent = float(found.get("jaccard_oct", np.nan) < LEAST_OCT and not doubted)
    return found | {"aligned": float(row.scores.get(SUCCESS, 0.0)), "doubted": doubted, "silent": silent}


def _posed(seed: int) -> Numbers:
    """Return how well a bore is found in its CT by both instruments."""
    case = pose.TASK.cases(seed, 0, {"preset": ("small-patient",), "sides": ("both",)})
    try:
        row = run_method(pose.TASK, "endoct", case)
    finally:
        if case.scratch is not None:
            case.scratch.cleanup()
    told = {name: float(row.scores[name]) for name in ("target_mm", "inside_95") if name in row.scores}
    return told | {"told": float(row.status == "ok")}


def _coronary(_: int) -> Numbers:
    """Return how far the wall of the real pullback lies from its own outlines, px, and how much of it is valid."""
    error_px, valid = wall_of_coronary(Path(os.environ["ENDOCT_RECORDINGS"]) / "coronary-oct")
    return {"wall_px": float(np.median(error_px)), "wall_90_px": float(np.percentile(error_px, 90)), "valid": valid}


WORLDS = (
    *(
        World(name, cases, partial(_independent, name))
        for name, cases in (
            ("few", 8), ("tiny", 8), ("sparse", 5), ("specks", 5), ("many", 2), ("floors", 2), ("sound", 12),
            ("mirrors", 4), ("broken", 16),
        )
    ),
    *(World(preset, 6, partial(_simulated, preset)) for preset in ("quick", "hard", "mastoid")),
    World("pose", 4, _posed),
    World("coronary", 1, _coronary, recordings=True),
)  # fmt: skip
"""What one run goes through, in about ten minutes on two cores."""
