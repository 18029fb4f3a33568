"""What `endoct bench` does and prints."""

import os
import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

from rich.console import RenderableType
from rich.table import Table

from endoct.base.errors import EndoctError
from endoct.base.files.output import check_output, new_output
from endoct.workbench.bench.checkpoint import Checkpoint, Facts, open_checkpoint
from endoct.workbench.bench.program import parse_programs, with_programs
from endoct.workbench.bench.results.plots import draw_plots
from endoct.workbench.bench.results.result_tables import (
    bench_facts,
    difference_table,
    footnotes,
    table,
    write_csv,
)
from endoct.workbench.bench.results.score_summary import differences, score_names
from endoct.workbench.bench.runner import BenchPlan, MethodResult, narrowed, parse_seeds, run
from endoct.workbench.bench.task import AnyTask, check_names, load_task, method_names, origin, task_names
from endoct.workbench.requests import BenchRequest, by_request
from endoct.workbench.running.outputs import BENCH_RESULTS, json_text
from endoct.workbench.running.progress import Stages, stages_for
from endoct.workbench.settings import listed_names, range_text

MOST_LISTED = 20

Lines = list[RenderableType]
"""Lines of text and tables for people to read."""


def list_tasks() -> tuple[Facts, Lines]:
    """Return what can be run, as facts and for people; a task that cannot be imported says so."""
    facts: Facts = {}
    lines = Table("task", "what", "methods", box=None)
    for name in task_names():
        try:
            task = load_task(name)
        except EndoctError as error:
            facts[name] = {"error": str(error)}
            lines.add_row(name, str(error), "")
            continue
        facts[name] = _task_facts(task)
        names = method_names(task)
        first = names if len(names) <= MOST_LISTED else [*names[:MOST_LISTED], f"and {len(names) - MOST_LISTED} more"]
        lines.add_row(name, task.title, ", ".join(first))
    return facts, [lines]


def describe_task(name: str) -> tuple[Facts, Lines]:
    """Return one task's signature, conditions, scores and methods, as facts and for people."""
    task = load_task(name)
    lines: Lines = [f"{task.name}: {task.title}", *f"a method: {task.signature}".splitlines()]
    lines += [*([f"a success is {task.success}"] if task.success else []), ""]
    for title, entries in (
        ("condition", {key: range_text(range_) for key, range_ in task.ranges.items()}),
        ("only on request", {key: range_text(range_) for key, range_ in task.optional.items()}),
        ("score", task.scores),
        ("method", {method: origin(task, method) for method in method_names(task)}),
    ):
        if not entries:
            continue
        rows = Table(title, "", box=None)
        for key, value in entries.items():
            rows.add_row(key, value)
        lines.append(rows)
    return _task_facts(task), lines


def _task_facts(task: AnyTask) -> Facts:
    return {
        "title": task.title,
        "signature": task.signature,
        "conditions": {key: list(range_) for key, range_ in task.ranges.items()},
        "scores": dict(task.scores),
        "success": task.success,
        "methods": {method: origin(task, method) for method in method_names(task)},
    }


@by_request(BenchRequest)
def run_bench(request: BenchRequest) -> tuple[Facts, Lines]:
    """Run a task's methods, write ``output`` where one is given; return the facts, and what to show people.

    Arguments are those of :class:`~endoct.workbench.requests.BenchRequest`. Raises :class:`EndoctError` where something
    in the request is not known, or ``output`` exists.

    >>> from endoct.workbench import run_bench
    >>> facts, _ = run_bench("segmentation", methods=["otsu"], seeds="1000", progress=False)
    >>> facts["summary"][0]["method"], facts["summary"][0]["ok"]
    ('otsu', 1)
    """
    workers, overwrite, stages = request.workers, request.overwrite, stages_for(request.progress)
    output, data = None if request.output is None else Path(request.output), [Path(folder) for folder in request.data]
    if request.count < 1 or workers < 1:
        raise EndoctError("--count and --workers must be at least 1", found=f"{request.count} and {workers}")
    task, plan = _planned(request)
    if output is None:
        _, facts, lines = _run(task, plan, workers, None, stages)
        return facts, lines
    check_output(output, BENCH_RESULTS, overwrite=overwrite, inputs=data)
    checkpoint = open_checkpoint(output, plan, overwrite=overwrite)
    with checkpoint.said_to_resume(plan):
        rows, facts, lines = _run(task, plan, workers, checkpoint, stages)
    with new_output(output, BENCH_RESULTS, overwrite=overwrite, inputs=data) as scratch:
        scratch.mkdir()
        write_csv(rows, task, scratch / "results.csv")
        (scratch / "bench.json").write_text(json_text(facts) + "\n", encoding="utf-8")
        with stages.stage("plots"):
            draw_plots(rows, task, scratch / "plots")
    checkpoint.remove()
    return facts, [*lines, f"results: {output}"]


def _planned(request: BenchRequest) -> tuple[AnyTask, BenchPlan]:
    programs = parse_programs(tuple(request.program), request.container)
    task = with_programs(load_task(request.task), programs)
    methods = check_names(task, [*listed_names(request.methods), *programs])
    if request.against is not None:
        task = replace(task, against=check_names(task, [request.against])[0])
    if task.against is not None and task.against not in methods:
        methods = task.against, *methods
    if request.data:
        if request.conditions or request.sweep:
            raise EndoctError("the conditions of your own data cannot be drawn", remedy="leave them out, or --data")
        own = own_folders([Path(folder) for folder in request.data])
        return task, BenchPlan(request.task, methods, ranges={}, own=own, programs=programs)
    ranges, seeds = narrowed(task, request.conditions, request.sweep), parse_seeds(request.seeds)
    return task, BenchPlan(request.task, methods, seeds, request.count, ranges, programs=programs)


def own_folders(data: Sequence[Path]) -> tuple[Path, ...]:
    """Return the folders with truth among ``data`` and one level below, in order of their names.

    Absolute, for processes that run elsewhere. Raises :class:`EndoctError` where there is none.
    """
    folders: list[Path] = []
    for folder in data:
        inside = sorted(path.parent for path in folder.glob("*/truth"))
        folders += [folder] if (folder / "truth").is_dir() else inside
    if not folders:
        raise EndoctError(
            f"no data with truth in {', '.join(map(str, data))}",
            expected="a folder with oct/ or endoscope/ and truth/ in it, or a folder of such folders",
        )
    return tuple(Path(os.path.abspath(path)) for path in dict.fromkeys(folders))  # noqa: PTH100 – links stay


def _run(
    task: AnyTask, plan: BenchPlan, workers: int, checkpoint: Checkpoint | None, stages: Stages
) -> tuple[list[MethodResult], Facts, Lines]:
    start = time.perf_counter()
    finished = {} if checkpoint is None else checkpoint.read()
    with stages.stage(f"bench {task.name}") as advance:
        save = None if checkpoint is None else checkpoint.save
        rows = run(plan, workers=workers, advance=advance, finished=finished, keep=save)
    missing = {row.method: row.reason for row in rows if row.status == "missing"}
    rows = [row for row in rows if row.method not in missing]
    if not rows:
        raise EndoctError("none of the methods is installed", found="; ".join(f"{m}: {r}" for m, r in missing.items()))
    facts = bench_facts(plan, rows, workers=workers, seconds=time.perf_counter() - start)
    lines: Lines = [table(rows, task), *footnotes(rows, task)]
    if missing:
        facts["left_out"] = missing
        lines += [f"left out: {method}, because {reason}" for method, reason in missing.items()]
    if finished:
        facts["taken_over"] = len(finished)  # of the sources of cases; their seconds are not in "seconds"
        lines.append(f"{len(finished)} of {len(plan.sources)} cases are of a run that was stopped before its end")
    differing = differences(rows, task.against, score_names(rows, [*task.scores])) if task.against else []
    if task.against and differing:
        lines.append(difference_table(differing, task.against))
        facts["differences"] = {"against": task.against, "of": [asdict(one) for one in differing]}
    return rows, facts, lines
