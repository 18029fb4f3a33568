"""Commands that make specimens: one with its comparison, one, many."""

from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Literal

from endoct.base.errors import EndoctError
from endoct.synthetic.sample.presets import PresetName
from endoct.workbench.commands.console import command_stages, print_either, print_line, print_result
from endoct.workbench.commands.poses import print_pose
from endoct.workbench.requests import UNSET, OutputPath, Ranges, SimulateRequest
from endoct.workbench.running.refusals import DONE


def demo(
    output: OutputPath = Path("demo"),
    preset: Annotated[PresetName | None, UNSET] = None,
    seed: Annotated[int | None, UNSET] = None,
    pose: bool = False,
    overwrite: bool = False,
    json: bool = False,
) -> int:
    """Simulate a specimen, unroll both recordings, compare them, or find them in a CT, and write the report.

    Args:
        output: folder for the specimen and the comparison
        preset: size and difficulty of the recordings; default: quick, with --pose small-patient
        seed: seed of the specimen; default: 1, with --pose 7
        pose: find the bore in a simulated CT instead of comparing the recordings
        overwrite: replace the folder if it exists
        json: print the result as JSON
    """
    stages = command_stages(json)
    if pose:
        from endoct.workbench.posing.pose import demo_pose

        preset, seed = preset or "small-patient", 7 if seed is None else seed
        result = demo_pose(output, preset=preset, seed=seed, overwrite=overwrite, progress=stages)
        return print_pose(result, output / "pose", as_json=json)
    from endoct.workbench import api

    preset, seed = preset or "quick", 1 if seed is None else seed
    api.demo(output, preset=preset, seed=seed, overwrite=overwrite, progress=stages)
    return print_result(output / "comparison", as_json=json)


@dataclass(frozen=True, eq=False)
class Simulate(SimulateRequest):
    """Simulate the two recordings of one bore, with truth."""

    def __call__(self) -> int:
        """Simulate, and return the exit status."""
        from endoct.workbench.pipeline.simulating import simulate

        simulate(replace(self, on_remark=print_line, progress=command_stages(False)))
        print_line(f"specimen: {self.output}")
        return DONE


@dataclass(frozen=True, eq=False)
class Dataset:
    """Make a data set of many simulated specimens, or complete one.

    The same arguments give the same bytes on any machine. Started again, the command makes only what is missing;
    with a larger count it adds specimens.

    Args:
        output: folder of the data set
        count: specimens
        preset: size and difficulty of the recordings
        seed: seed of the data set
        vary: range or choices of a parameter, such as oct.wall_db=6..14 or oct.scan=step|helical; repeat for more
        format: a folder for each specimen, or tar files for the webdataset library
        labels: add truth/labels: layers, visibility, shadows, noise-free twins, pixel to pixel maps
        recordings_per_bore: consecutive specimens that show the same bore
        workers: number of processes; default: one per processor
        scheduler: address of a dask scheduler whose workers do the work; they must see the output folder under this
            path. Whoever can reach that scheduler can run code on its workers and on this machine: use one that you
            trust, on a network that you trust, and tls://
        dry_run: make one specimen in a temporary folder and estimate what all would take
        json: print the result as JSON
    """

    output: OutputPath
    count: int
    preset: PresetName = "learning"
    seed: int = 0
    vary: Ranges = ()
    format: Literal["folders", "webdataset"] = "folders"
    labels: bool = False
    recordings_per_bore: int = 1
    workers: Annotated[int | None, UNSET] = None
    scheduler: Annotated[str | None, UNSET] = None
    dry_run: bool = False
    json: bool = False

    def __call__(self) -> int:
        """Make the data set, or estimate what it would take; print that, and return the exit status."""
        from endoct.workbench.dataset.creation import run_dataset
        from endoct.workbench.dataset.plan import DatasetPlan
        from endoct.workbench.settings import parse_vary

        ranges, stages = parse_vary(self.vary), command_stages(self.json)
        plan = DatasetPlan(
            self.count, self.preset, self.seed, ranges, self.format, self.labels, self.recordings_per_bore
        )
        facts, lines = run_dataset(
            self.output, plan, workers=self.workers, scheduler=self.scheduler, dry_run=self.dry_run, stages=stages
        )
        return print_either(facts, lines, as_json=self.json)


def warm_up() -> int:
    """Compile what is slow, so that no later command has to: half a minute, once after an installation or an update.

    Simulates a small specimen in a temporary folder and compares its recordings. The machine code is kept next to the
    modules or, where nothing can be written there, in your cache folder; NUMBA_CACHE_DIR names another.
    """
    from endoct.base.compute.compiled import is_kept  # loads numba

    if not is_kept():
        raise EndoctError(
            "machine code cannot be kept",
            expected="a folder that can be written: that of the modules, or your cache folder",
            remedy="name one in NUMBA_CACHE_DIR, here and whenever endoct is used",
        )
    from endoct.workbench import api  # loads what a comparison needs

    with TemporaryDirectory() as folder, command_stages(False).stage("compiling"):
        api.demo(Path(folder) / "demo", preset="learning", progress=False)
    print_line("compiled")
    return DONE


def self_test() -> int:
    """Compare one tiny simulated bore on this machine and hold its figures against the published ones; 20 seconds.

    Prints one line. The exit status is 0 where they agree, 1 where they do not.
    """
    from endoct.fusion.files.result_file import read_result
    from endoct.workbench import api
    from endoct.workbench.pipeline.self_test import PRESET, SEED, check_figures

    with TemporaryDirectory() as folder:
        api.demo(Path(folder) / "demo", preset=PRESET, seed=SEED, progress=command_stages(False))
        said = check_figures(read_result(Path(folder) / "demo" / "comparison"))
    print_line(f"as published: {said}")
    return DONE
