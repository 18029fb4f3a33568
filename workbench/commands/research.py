"""Commands for research: the bench, and training of the eye."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from endoct.base.errors import visible
from endoct.modalities.device import Device
from endoct.workbench.commands.console import TextConsole, command_stages, listed_names, print_json, print_line
from endoct.workbench.requests import UNSET, OutputPath
from endoct.workbench.running.refusals import DONE

WIDE = 200


@dataclass(frozen=True, eq=False)
class Bench:
    """Run named methods on the same cases with truth: a table, results.csv, plots (see docs/how-to/bench.md).

    Args:
        task: alignment, stitching, segmentation, oct, depth, pose, ablate, sensitivity, speed or a task of another
            package; without one, all tasks are listed
        conditions: ranges or choices to draw cases from, right after the task, such as cell_mm=0.2..1 or
            modality=depth|intensity
        output: folder for results.csv, bench.json and plots
        methods: names of methods, separated by commas; default: all
        seeds: a range as 1000-1009, or numbers separated by commas; 0-99 are reserved for tuning
        count: cases per seed
        sweep: vary only this condition; the others stay at the middle of their range
        against: print differences from this method too, case by case
        data: folders of your own data with truth, or folders of such folders, instead of simulated cases
        workers: processes that share the cases; with more than one, timings are those of a busy machine
        describe: describe what the task gives, expects and scores, and run nothing
        overwrite: replace the output if it exists
        json: print as JSON
    """

    task: Positional[Annotated[str | None, UNSET]] = None
    conditions: Positional[tuple[str, ...]] = ()
    output: Annotated[Path | None, arg(aliases=["-o"]), UNSET] = None
    methods: Annotated[str, arg(metavar="NAME,NAME")] = ""
    seeds: str = "1000-1009"
    count: int = 1
    sweep: Annotated[str | None, arg(metavar="CONDITION"), UNSET] = None
    against: Annotated[str | None, arg(metavar="NAME"), UNSET] = None
    data: tuple[Path, ...] = ()
    workers: int = 1
    describe: bool = False
    overwrite: bool = False
    json: bool = False

    def __call__(self) -> int:
        """Run the methods, or describe or list tasks; print that, and return the exit status."""
        from endoct.workbench.bench.command import Request, describe_task, list_tasks, run_bench

        if self.task is None:
            facts, parts = list_tasks()
        elif self.describe:
            facts, parts = describe_task(self.task)
        else:
            request = Request(
                self.task,
                self.conditions,
                listed_names(self.methods),
                self.seeds,
                self.count,
                self.sweep,
                self.against,
                self.data,
            )
            stages = command_stages(self.json)
            facts, parts = run_bench(
                request, output=self.output, workers=self.workers, overwrite=self.overwrite, stages=stages
            )
        if self.json:
            print_json(facts)
            return DONE
        console = TextConsole()
        if not console.is_terminal:
            console = TextConsole(width=WIDE)  # nothing is cut off in a file
        for part in parts:
            console.print(visible(part) if isinstance(part, str) else part, soft_wrap=isinstance(part, str))
        return DONE


def train(
    output: OutputPath,
    bores: int = 120,
    steps: int = 3000,
    batch: int = 12,
    seed: int = 1,
    device: Device = "cpu",
    overwrite: bool = False,
) -> int:
    """Train a learned eye for the endoscope on simulated bores (see docs/how-to/train.md).

    Args:
        output: folder for the weights and their card
        bores: simulated bores to learn from, 10 to 20 s each
        steps: steps of the fit; 3000 take two minutes on a large GPU, and hours on two cores
        batch: pieces of bores a step
        seed: seed of the weights and of how examples are varied
        device: where to fit; bores are always simulated on the CPU
        overwrite: replace the output if it exists
    """
    from endoct.workbench.training import WEIGHTS
    from endoct.workbench.training import train as train_eye

    train_eye(
        output,
        n_bores=bores,
        steps=steps,
        batch=batch,
        seed=seed,
        device=device,
        overwrite=overwrite,
        stages=command_stages(False),
    )
    print_line(f"weights: {output / WEIGHTS}; use them with --set eye={output / WEIGHTS}")
    return DONE
