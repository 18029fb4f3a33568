"""Commands for research: the bench, and training of the eye."""

from dataclasses import KW_ONLY, dataclass, replace
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional

from endoct.base.errors import visible
from endoct.workbench.commands.console import TextConsole, command_stages, print_json, print_line
from endoct.workbench.requests import UNSET, BenchRequest, TrainRequest
from endoct.workbench.running.refusals import DONE

WIDE = 200


@dataclass(frozen=True, eq=False)
class Bench(BenchRequest):
    """Run named methods on the same cases with truth: a table, results.csv, plots (see docs/how-to/bench.md).

    Args:
        describe: describe what the task gives, expects and scores, and run nothing
        json: print as JSON
    """

    task: Positional[Annotated[str | None, UNSET]] = None  # type: ignore[assignment]
    _: KW_ONLY
    describe: bool = False
    json: bool = False

    def __call__(self) -> int:
        """Run the methods, or describe or list tasks; print that, and return the exit status."""
        from endoct.workbench.bench.command import describe_task, list_tasks, run_bench

        if self.task is None:
            facts, parts = list_tasks()
        elif self.describe:
            facts, parts = describe_task(self.task)
        else:
            facts, parts = run_bench(replace(self, progress=command_stages(self.json)))
        if self.json:
            print_json(facts)
            return DONE
        console = TextConsole()
        if not console.is_terminal:
            console = TextConsole(width=WIDE)  # nothing is cut off in a file
        for part in parts:
            console.print(visible(part) if isinstance(part, str) else part, soft_wrap=isinstance(part, str))
        return DONE


@dataclass(frozen=True, eq=False)
class Train(TrainRequest):
    """Train a learned eye for the endoscope on simulated bores (see docs/how-to/train.md)."""

    def __call__(self) -> int:
        """Train, print where the weights are, and return the exit status."""
        from endoct.workbench.training import WEIGHTS, train

        train(replace(self, progress=command_stages(False)))
        weights = Path(self.output) / WEIGHTS
        print_line(f"weights: {weights}; use them with --set eye={weights}")
        return DONE
