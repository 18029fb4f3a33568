"""Commands for research: the bench, its published sets with submissions and their board, and training of the eye."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from endoct.base.errors import EndoctError, visible
from endoct.base.files.files import path_text
from endoct.modalities.device import Device
from endoct.workbench.commands.console import TextConsole, command_stages, print_json, print_line
from endoct.workbench.requests import UNSET, OutputPath
from endoct.workbench.running.refusals import DONE, UNUSABLE_INPUT

SET = "endoct-bench-1"
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
                _names(self.methods),
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


def make(output: OutputPath, full: bool = False, workers: int = 1, json: bool = False) -> int:
    """Make the public half of the published benchmark endoct-bench-1, or what is missing of it in the folder.

    Args:
        output: folder of the set
        full: make the full set, five times the small one
        workers: processes that share the specimens
        json: print as JSON
    """
    from endoct.workbench.bench.published.definition import load_definition
    from endoct.workbench.bench.published.making import WRITERS, make_set
    from endoct.workbench.bench.published.specimen_set import shipped_entries

    made = make_set(output, SET, size="full" if full else "small", workers=workers, stages=command_stages(json))
    published = shipped_entries(SET)
    known = [one for one in made.specimens if one.name in published]
    equal = sum(one.digest == published[one.name].digest for one in known)
    missing = sorted({kind.generator for kind in load_definition(SET).kinds} - set(WRITERS))
    if json:
        facts = {"output": path_text(output), "specimens": len(made.specimens), "digest": made.digest}
        print_json({**facts, "published": len(known), "equal": equal})
        return DONE
    print_line(f"set: {output} ({len(made.specimens)} specimens, digest {made.digest[:16]}…)")
    print_line(f"of {len(known)} published ones {equal} are equal to the bit, {len(known) - equal} but for rounding")
    print_line(f"left out: specimens of the {', '.join(missing)} generator, which a source checkout makes")
    return DONE


def layout(
    data: Positional[Path],
    output: OutputPath,
    to: Literal["huggingface", "webdataset"] = "huggingface",
    overwrite: bool = False,
    json: bool = False,
) -> int:
    """Write the panoramas and true masks of a published set in a layout that other libraries load.

    Args:
        data: folder of the set
        output: folder to write
        to: huggingface, pictures for its imagefolder, or webdataset, shards with arrays
        overwrite: replace the output if it exists
        json: print as JSON
    """
    from endoct.workbench.bench.published.examples import write_layout

    n_examples = write_layout(data, output, to, overwrite=overwrite, stages=command_stages(json))
    if json:
        print_json({"output": path_text(output), "examples": n_examples})
        return DONE
    print_line(f"{to}: {output} ({n_examples} examples)")
    return DONE


@dataclass(frozen=True, eq=False)
class Submit:
    """Run methods on a published set, and write one JSON file with their scores (see docs/how-to/bench.md).

    Args:
        task: oct, stitching, segmentation, alignment, depth or pose
        data: folder of the set, as `endoct bench make` makes it
        output: the file to write
        methods: names of methods, separated by commas; default: all, or none where there are programs
        program: a method that is a program, NAME=COMMAND; it is called with two folders, what is given and the answer
        workers: processes that share the specimens; with more than one, timings are those of a busy machine
        overwrite: replace the output if it exists
        json: print as JSON
    """

    task: Positional[str]
    data: Positional[Path]
    output: OutputPath
    methods: Annotated[str, arg(metavar="NAME,NAME")] = ""
    program: tuple[str, ...] = ()
    workers: int = 1
    overwrite: bool = False
    json: bool = False

    def __call__(self) -> int:
        """Run the methods, print what was written, and return the exit status."""
        from endoct.workbench.bench.program import parse_programs
        from endoct.workbench.bench.published.submission import submit

        submission = submit(
            self.data,
            self.task,
            self.output,
            methods=_names(self.methods),
            programs=parse_programs(self.program),
            workers=self.workers,
            overwrite=self.overwrite,
            stages=command_stages(self.json),
        )
        if self.json:
            facts = {"output": path_text(self.output), "data": submission.data_digest, "rows": len(submission.rows)}
            print_json(facts)
            return DONE
        for name, reason in submission.left_out.items():
            print_line(f"left out: {name}, because {reason}")
        print_line(
            f"submission: {self.output} ({len(submission.methods)} methods on {len(submission.specimens)} specimens, "
            f"data {submission.data_digest[:16]}…)"
        )
        return DONE


def check(
    submission: Positional[Path],
    data: Positional[Path],
    sample: int = 2,
    methods: Annotated[str, arg(metavar="NAME,NAME")] = "",
    program: tuple[str, ...] = (),
    json: bool = False,
) -> int:
    """Run a sample of a submission again, and compare the scores to the last digit. No command of the file is run.

    Args:
        submission: the file that `endoct bench submit` wrote
        data: folder of the set it was run on
        sample: how many specimens to run again
        methods: names of methods, separated by commas; default: all of the submission, but programs only
            where --program says how
        program: how to run a method that is a program, NAME=COMMAND
        json: print as JSON
    """
    from endoct.workbench.bench.program import parse_programs
    from endoct.workbench.bench.published.submission import check as run

    if sample < 1:
        raise EndoctError("--sample must be at least 1", found=str(sample))
    checked = run(
        submission,
        data,
        sample=sample,
        methods=_names(methods),
        programs=parse_programs(program),
        stages=command_stages(json),
    )
    counts = {verdict: checked.count(verdict) for verdict in ("equal", "near", "different")}
    if json:
        reruns = [
            {"verdict": one.verdict, "stated": one.stated.model_dump(), "again": one.again.model_dump()}
            for one in checked.reruns
        ]
        programs = {
            name: {"stated": checked.submission.programs[name], "here": here or None}
            for name, here in checked.programs.items()
        }
        print_json({"counts": counts, "programs": programs, "rows": reruns})
    else:
        for name, here in checked.programs.items():
            done = f"run here as: {here}" if here else "not run again; say how with --program NAME=COMMAND"
            print_line(f"{name}: a program, in the file: {checked.submission.programs[name]}; {done}")
        for one in checked.reruns:
            if one.verdict != "equal":
                before, after = one.stated, one.again
                print_line(f"{one.verdict}: {before.method} on {before.case}: {before.outcome}, again {after.outcome}")
        print_line(
            f"{len(checked.reruns)} rows run again: {counts['equal']} equal to the last digit, "
            f"{counts['near']} but for the last bits, {counts['different']} different"
        )
        if not checked.is_of_equal_data:
            print_line("the data here are equal to those of the submission but for rounding")
    return UNUSABLE_INPUT if counts["different"] and checked.is_of_equal_data else DONE


def board(folder: Positional[Path], output: OutputPath, overwrite: bool = False, json: bool = False) -> int:
    """Draw the board of all submissions in a folder: one HTML page that opens offline.

    Args:
        folder: folder with files that `endoct bench submit` wrote
        output: the page to write
        overwrite: replace the output if it exists
        json: print where endoct is beaten as JSON
    """
    from endoct.workbench.bench.published.board import write_board

    boards = write_board(folder, output, overwrite=overwrite)
    if json:
        print_json({one.task: [asdict(loss) for loss in one.losses()] for one in boards})
        return DONE
    for one in boards:
        beaten = ", ".join(f"{loss.method} ({loss.generator})" for loss in one.losses())
        print_line(f"{one.task}: {len(one.entrants)} methods; endoct is beaten by {beaten or 'none'}")
    print_line(f"board: {output}")
    return DONE


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]
