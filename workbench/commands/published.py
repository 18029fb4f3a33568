"""Commands of published benchmarks: their sets, submissions, and the board of these."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from endoct.base.errors import EndoctError
from endoct.base.files.files import path_text
from endoct.base.files.scratch import new_file
from endoct.workbench.commands.console import command_stages, print_either, print_json, print_line
from endoct.workbench.requests import OutputPath
from endoct.workbench.running.refusals import DONE, UNUSABLE_INPUT

SET = "endoct-bench-2"


def make(output: OutputPath, full: bool = False, task: str | None = None, workers: int = 1, json: bool = False) -> int:
    """Make the public half of the published benchmark endoct-bench-2, or what is missing of it in the folder.

    Args:
        output: folder of the set
        full: make the full set, five times the small one
        task: make the specimens of this task alone, of those that are not there yet
        workers: processes that share the specimens
        json: print as JSON
    """
    from endoct.workbench.bench.published.definition import load_definition
    from endoct.workbench.bench.published.making import WRITERS, make_set
    from endoct.workbench.bench.published.specimen_set import shipped_entries

    made = make_set(
        output, SET, size="full" if full else "small", task=task, workers=workers, stages=command_stages(json)
    )
    published = shipped_entries(SET)
    known = [specimen for specimen in made.specimens if specimen.name in published]
    equal = sum(one.digest == published[one.name].digest for one in known)
    missing = sorted({kind.generator for kind in load_definition(SET).kinds} - set(WRITERS))
    facts = {"output": path_text(output), "specimens": len(made.specimens), "digest": made.digest}
    lines = [
        f"set: {output} ({len(made.specimens)} specimens, digest {made.digest[:16]}…)",
        f"of {len(known)} published ones {equal} are equal to the bit, {len(known) - equal} but for rounding",
        f"left out: specimens of the {', '.join(missing)} generator, which a source checkout makes",
    ]
    return print_either({**facts, "published": len(known), "equal": equal}, lines, as_json=json)


def layout(
    data: Positional[Path],
    output: OutputPath,
    to: Literal["huggingface", "webdataset"] = "huggingface",
    task: str = "segmentation",
    overwrite: bool = False,
    json: bool = False,
) -> int:
    """Write the examples of a published set with their truth in a layout that other libraries load.

    Args:
        data: folder of the set
        output: folder to write
        to: huggingface, pictures for its imagefolder, or webdataset, shards with arrays
        task: whose examples; pictures are of panoramas and masks alone, those of segmentation
        overwrite: replace the output if it exists
        json: print as JSON
    """
    from endoct.workbench.bench.published.examples import write_layout

    n_examples = write_layout(data, output, to, task, overwrite=overwrite, stages=command_stages(json))
    facts = {"output": path_text(output), "examples": n_examples}
    return print_either(facts, [f"{to}: {output} ({n_examples} examples)"], as_json=json)


@dataclass(frozen=True, eq=False)
class Submit:
    """Run methods on a published set, and write one JSON file with their scores (see docs/how-to/bench.md).

    Args:
        task: oct, stitching, segmentation, alignment, depth, wall or pose
        data: folder of the set, as `endoct bench make` makes it
        output: the file to write
        methods: names of methods, separated by commas; default: all, or none where there are programs
        program: a method that is a program, NAME=COMMAND; it is called with two folders, what is given and the answer
        container: image of Podman or Docker in which each --program runs
        workers: processes that share the specimens; with more than one, timings are those of a busy machine
        overwrite: replace the output if it exists
        json: print as JSON
    """

    task: Positional[str]
    data: Positional[Path]
    output: OutputPath
    methods: Annotated[str, arg(metavar="NAME,NAME")] = ""
    program: tuple[str, ...] = ()
    container: Annotated[str | None, arg(metavar="IMAGE")] = None
    workers: int = 1
    overwrite: bool = False
    json: bool = False

    def __call__(self) -> int:
        """Run the methods, print what was written, and return the exit status."""
        from endoct.workbench.bench.program import parse_programs
        from endoct.workbench.bench.published.submission import submit
        from endoct.workbench.settings import listed_names

        submission = submit(
            self.data,
            self.task,
            self.output,
            methods=listed_names(self.methods),
            programs=parse_programs(self.program, self.container),
            workers=self.workers,
            overwrite=self.overwrite,
            stages=command_stages(self.json),
        )
        facts = {"output": path_text(self.output), "data": submission.data_digest, "rows": len(submission.rows)}
        lines = [f"left out: {name}, because {reason}" for name, reason in submission.left_out.items()]
        lines.append(
            f"submission: {self.output} ({len(submission.methods)} methods on {len(submission.specimens)} specimens, "
            f"data {submission.data_digest[:16]}…)"
        )
        return print_either(facts, lines, as_json=self.json)


def check(
    submission: Positional[Path],
    data: Positional[Path],
    nonce: str,
    sample: int = 2,
    receipt: Path | None = None,
    methods: Annotated[str, arg(metavar="NAME,NAME")] = "",
    program: tuple[str, ...] = (),
    container: Annotated[str | None, arg(metavar="IMAGE")] = None,
    json: bool = False,
) -> int:
    """Run a sample of a submission again, and compare the scores to the last digit. No command of the file is run.

    Args:
        submission: the file that `endoct bench submit` wrote
        data: folder of the set it was run on
        nonce: any text that you make up now and told nobody; it draws the specimens that are run again
        sample: how many specimens to run again
        receipt: file to write for `endoct bench board --receipts`
        methods: names of methods, separated by commas; default: all of the submission, but programs only
            where --program says how
        program: how to run a method that is a program, NAME=COMMAND
        container: image of Podman or Docker in which each --program runs
        json: print as JSON
    """
    from endoct.workbench.bench.program import parse_programs
    from endoct.workbench.bench.published.checking import check as run
    from endoct.workbench.settings import listed_names

    if sample < 1:
        raise EndoctError("--sample must be at least 1", found=str(sample))
    checked = run(
        submission,
        data,
        sample=sample,
        nonce=nonce,
        methods=listed_names(methods),
        programs=parse_programs(program, container),
        stages=command_stages(json),
    )
    if receipt is not None:
        with new_file(receipt) as file:
            file.write((checked.receipt.model_dump_json(indent=1) + "\n").encode())
    counts = {verdict: checked.count(verdict) for verdict in ("equal", "near", "different")}
    if json:
        reruns = [
            {"verdict": rerun.verdict, "stated": rerun.stated.model_dump(), "again": rerun.again.model_dump()}
            for rerun in checked.reruns
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


def board(
    folder: Positional[Path],
    output: OutputPath,
    receipts: Path | None = None,
    overwrite: bool = False,
    json: bool = False,
) -> int:
    """Draw the board of all submissions in a folder: one HTML page that opens offline.

    Args:
        folder: folder with files that `endoct bench submit` wrote
        output: the page to write
        receipts: folder of receipts of `endoct bench check`; what has none is marked, and follows after the rest
        overwrite: replace the output if it exists
        json: print where endoct is beaten as JSON
    """
    from endoct.workbench.bench.published.board import write_board

    boards = write_board(folder, output, receipts=receipts, overwrite=overwrite)
    facts = {one.task: [asdict(loss) for loss in one.losses()] for one in boards}
    lines = []
    for one in boards:
        beaten = ", ".join(f"{loss.method} ({loss.generator}, {loss.side or 'all'})" for loss in one.losses())
        lines.append(f"{one.task}: {len(one.entrants)} methods; endoct is beaten by {beaten or 'none'}")
    return print_either(facts, [*lines, f"board: {output}"], as_json=json)
