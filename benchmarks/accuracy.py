"""How close comparisons come to the truth of simulated specimens, and what each step and parameter is worth in them.

    python -m benchmarks.accuracy --seeds 1000-1029 [--preset quick] [--csv FILE]
    python -m benchmarks.accuracy --preset learning --vary oct.wall_db=-5..13 --methods main,literal [--plots DIR]
    python -m benchmarks.accuracy --methods steps              one step off at a time, or as the paper did it
    python -m benchmarks.accuracy --methods parameters         each parameter times and divided by 1.5

A row a specimen and method, then for each score the median with its 95 % interval, bootstrapped over specimens, and
the differences from the main comparison, specimen by specimen. ``--vary`` is that of ``endoct simulate``. Seeds 0–99
are for tuning, from 1000 on for reporting. :func:`endoct.workbench.pipeline.truth.held_against` says what the scores
mean; ``lost_…`` are the parts of the agreement budget, of 1 − Jaccard on the grid.
"""

import argparse
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
from pydantic import BaseModel
from rich.console import Console
from scipy.stats import bootstrap

from endoct.base.errors import NotSeen
from endoct.fusion.comparison import place_sides, score_placed
from endoct.fusion.evidence.side import Side, two_sides
from endoct.fusion.parameters import CompareParameters
from endoct.fusion.sides import Comparison
from endoct.modalities.acquisition import validate
from endoct.modalities.registry import manifests
from endoct.stitching.panorama import Panorama
from endoct.workbench import unroll
from endoct.workbench.bench.cases.specimens import DIFFICULTIES, simulated
from endoct.workbench.bench.results.plots import draw_plots
from endoct.workbench.bench.results.result_tables import difference_table, write_csv
from endoct.workbench.bench.results.score_summary import differences, score_names
from endoct.workbench.bench.runner import MethodResult, narrowed, parse_seeds, run_method
from endoct.workbench.bench.task import SUCCESS, Case, Declined, Range, Task, draw
from endoct.workbench.bench.tasks.oct import EVEN_TURNS
from endoct.workbench.pipeline.truth import held_against, load_truth
from endoct.workbench.running.scheduler import one_blas_thread
from endoct.workbench.sides.recipes import RECIPES

Settings = Mapping[str, Mapping[str, object]]
"""Parameters that differ from their defaults, by part: "oct", "endoscope" or "compare"."""
MAIN = "main"
FACTOR = 1.5
NOT_TUNED = {"oct.seed", "compare.z_scale_min", "compare.z_scale_max"}
"""These numbers are no amounts: a seed, and bounds about 1."""
STEPS: Mapping[str, Settings] = {
    MAIN: {},
    "literal": {"oct": RECIPES["paper"]["oct"]},
    "no-turning": {"oct": EVEN_TURNS},
    "no-circle": {"oct": {"undistort": "sine"}},
    "no-edge": {"oct": {"wall": "maximum"}},
    "no-continuity": {"oct": {"slope_cost_per_mm": 0, "jump_cost": 0.0}},
    "no-denoising": {"oct": {"denoise_threshold": 0}},
    **{f"no-{name.removeprefix('correct_').replace('_', '-')}": {"oct": {name: False}} for name in EVEN_TURNS},
    "no-faint": {"oct": {"least_wall_sigmas": 0}},
    "no-feed": {"endoscope": {"correct_feed": False}},
    "no-roll": {"endoscope": {"correct_roll": False}},
    "no-offset": {"endoscope": {"probe_offset": False}},
    "no-cone": {"endoscope": {"self_calibration": False}},
    "no-dirt": {"endoscope": {"least_transmission": 0}},
    "no-taper": {"endoscope": {"taper": 0.01}},
    "no-cap": {"compare": {"relief_cap_mm": 10, "contrast_cap": 50}},
    "no-floor": {"compare": {"relief_floor_mm": -10}},
    "no-spread": {"compare": {"contrast_floor_sigmas": 0}},
    "no-outlines": {"compare": {"outlines": False}},
    "no-smoothing": {"compare": {"smooth_mm": 0}},
    "no-cleaning": {"compare": {"open_mm": 0, "close_mm": 0, "smallest_mm2": 0}},
    "no-depth": {"compare": {"segment": "intensity"}},
    "no-scale": {"compare": {"z_scale_min": 1.0, "z_scale_max": 1.0}},
}


def parameters() -> dict[str, Settings]:
    """Return settings with one parameter up or down by :data:`FACTOR`, by "PART.NAME up" or "down"."""
    models: dict[str, type[BaseModel]] = {part: manifests()[part].load().parameters for part in ("oct", "endoscope")}
    settings: dict[str, Settings] = {}
    for part, model in (models | {"compare": CompareParameters}).items():
        for name, field_ in model.model_fields.items():
            default, full = field_.default, f"{part}.{name}"
            if isinstance(default, int | float) and not isinstance(default, bool) and default and full not in NOT_TUNED:
                for way, value in (("up", default * FACTOR), ("down", default / FACTOR)):
                    settings[f"{full} {way}"] = {part: {name: round(value) if isinstance(default, int) else value}}
    return settings


@dataclass(frozen=True, eq=False)
class Specimen:
    """A specimen's folder; its panoramas stay in memory for settings that do not change them."""

    folder: Path
    _unrolled: dict[tuple[str, str], Panorama] = field(default_factory=dict)

    def unrolled(self, part: str, settings: Mapping[str, object]) -> Panorama:
        """Return the panorama of the recording ``part``, unrolled with settings of its plug-in."""
        key = part, repr(sorted(settings.items()))
        if key not in self._unrolled:
            try:
                self._unrolled[key] = unroll(self.folder / part, settings=settings, progress=False)
            except NotSeen as error:  # to say so is an answer
                raise Declined(str(error)) from error
        return self._unrolled[key]


@dataclass(frozen=True, eq=False)
class Compared:
    """A comparison of a specimen's endoscope and OCT, with these sides as they came in and its parameters."""

    sides: tuple[Side, Side]
    comparison: Comparison
    parameters: CompareParameters


def compared(settings: Settings, specimen: Specimen) -> Compared:
    """Unroll and compare as `endoct compare SPECIMEN/endoscope SPECIMEN/oct` does, with ``settings``."""
    of = validate(CompareParameters, dict(settings.get("compare", {})), "the settings of the comparison")
    sides = two_sides(*(specimen.unrolled(part, settings.get(part, {})) for part in ("endoscope", "oct")))
    return Compared(sides, score_placed(place_sides(*sides, of), of), of)


def case_of(seed: int, index: int, ranges: Mapping[str, Range]) -> Case[Specimen, Path]:
    """Return a simulated specimen, whose folder is the truth."""
    drawn = draw(seed, index, ranges)
    preset = str(drawn["preset"])
    scratch = simulated(preset, seed, index, {name: value for name, value in drawn.items() if name != "preset"})
    folder = Path(scratch.name) / "specimen"
    return Case(f"{preset}-{seed}-{index}", Specimen(folder), folder, drawn, scratch)


def judge(case: Case[Specimen, Path], answer: Compared) -> dict[str, float]:
    """Score a comparison against the truth. Raises :class:`Declined` where the sides were not aligned."""
    made = answer.comparison
    scores = held_against(load_truth(case.truth), answer.sides, made, answer.parameters)
    right = scores.pop("right", 0.0)
    scores.pop("aligned")
    if made.result.by_li is not None and made.result.by_li.own_rows.jaccard is not None:
        scores["pair_li"] = made.result.by_li.own_rows.jaccard
    if made.alignment is None:
        raise Declined(made.reason or "not aligned", {SUCCESS: 0.0} | scores)
    parts = made.result.budget.parts.by_cause() if made.result.budget else {}
    lost = {f"lost_{cause}": part.share for cause, part in parts.items()}
    return {SUCCESS: right, "doubted": float(bool(made.doubts))} | scores | lost


TASK: Task[Specimen, Path, Compared] = Task(
    name="accuracy",
    signature="method(specimen: Specimen) -> Compared",
    cases=case_of,
    judge=judge,
    ranges={"preset": ("quick",)},
    optional=DIFFICULTIES,
    scores={
        "pair_native": "Jaccard index, endoscope against OCT, on the OCT's rows",
        "oct_truth": "Jaccard index, OCT against the truth",
        "endo_truth": "Jaccard index, endoscope against the truth",
        "pair_li": "Jaccard index, endoscope against OCT, cells of both by Li's threshold alone, on the OCT's rows",
        "landmark_mm": "error of where wall points are mapped to, 95th percentile, mm",
        "oct_valid": "share of the OCT's samples that are valid",
    },
    methods={name: partial(compared, settings) for name, settings in (STEPS | parameters()).items()},
    against=MAIN,
)


@one_blas_thread()
def evaluate(seed: int, ranges: Mapping[str, Range], methods: Sequence[str]) -> list[MethodResult]:
    """Simulate a specimen, and compare its recordings in every way."""
    case = TASK.cases(seed, 0, ranges)
    try:
        return [run_method(TASK, name, case) for name in methods]
    finally:
        if case.scratch is not None:
            case.scratch.cleanup()


def summary(rows: Sequence[MethodResult]) -> list[str]:
    """Return a line a score: median, its interval, extremes."""
    lines = []
    for name in dict.fromkeys(name for row in rows for name in row.scores):
        values = np.array([row.scores[name] for row in rows if name in row.scores])
        low, high = values.min(), values.max()
        if values.size > 1 and low < high:
            interval = bootstrap((values,), np.median, method="percentile", rng=np.random.default_rng(0))
            low, high = interval.confidence_interval
        lines.append(
            f"{name:18s} median {np.median(values):.3f} ({low:.3f} to {high:.3f})  "
            f"min {values.min():.3f}  max {values.max():.3f}  n {values.size}"
        )
    return lines


def main() -> None:
    """Evaluate the seeds asked for and print tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="1000-1009", help="first-last")
    parser.add_argument("--preset", default="quick")
    parser.add_argument("--vary", nargs="*", default=[], metavar="NAME=LOW..HIGH")
    parser.add_argument("--methods", default=MAIN, help="names, steps or parameters")
    parser.add_argument("--csv", type=Path)
    parser.add_argument("--plots", type=Path, help="folder for scores by method, and against what varies")
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    groups = {"steps": [*STEPS], "parameters": [MAIN, *parameters()]}
    methods = groups.get(arguments.methods, arguments.methods.split(","))
    ranges: dict[str, Range] = {**narrowed(TASK, arguments.vary), "preset": (arguments.preset,)}
    rows: list[MethodResult] = []
    with ProcessPoolExecutor(arguments.workers) as pool:
        work = partial(evaluate, ranges=ranges, methods=methods)
        for of_specimen in pool.map(work, parse_seeds(arguments.seeds)):
            rows += of_specimen
            for row in of_specimen:
                scores = "  ".join(f"{name}={value:.3f}" for name, value in row.scores.items())
                print(f"{row.case}  {row.method}  {row.status}  {scores}  {row.reason}", flush=True)
    for method in methods:
        print("\n".join([method, *summary([row for row in rows if row.method == method])]))
    if MAIN in methods[:1] and methods[1:]:
        named = score_names(rows, [*TASK.scores])
        Console(width=160).print(difference_table(differences(rows, MAIN, named), MAIN))
    if arguments.csv:
        write_csv(rows, TASK, arguments.csv)
    if arguments.plots:
        draw_plots(rows, TASK, arguments.plots)


if __name__ == "__main__":
    main()
