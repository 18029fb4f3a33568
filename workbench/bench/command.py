"""What `endoct bench` does and says."""

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from rich.console import RenderableType
from rich.table import Table

from endoct.stitching.errors import EndoctError
from endoct.stitching.output import check_output, new_output
from endoct.workbench.bench.asking import narrowed, parse_seeds
from endoct.workbench.bench.keeping import Kept, kept_beside
from endoct.workbench.bench.methods import check_names, load_task, method_names, origin, task_names
from endoct.workbench.bench.paired import (
    Difference,
    difference_table,
    differences,
    draw_differences,
    write_differences,
)
from endoct.workbench.bench.plots import draw_plots
from endoct.workbench.bench.runner import Plan, Row, run
from endoct.workbench.bench.summary import score_names
from endoct.workbench.bench.task import Task
from endoct.workbench.bench.writing import facts, footnotes, table, write_csv, write_json
from endoct.workbench.running.kinds import BENCH_RESULTS
from endoct.workbench.running.progress import Stages

MOST_LISTED = 20


def list_tasks() -> tuple[dict[str, Any], list[RenderableType]]:
    """Return what can be run, as facts and for people; a task that cannot be imported says so."""
    found: dict[str, Any] = {}
    lines = Table("task", "what", "methods", box=None)
    for name in task_names():
        try:
            task = load_task(name)
        except EndoctError as error:
            found[name] = {"error": str(error)}
            lines.add_row(name, str(error), "")
            continue
        found[name] = {
            "title": task.title,
            "signature": task.signature,
            "conditions": {key: list(range_) for key, range_ in task.ranges.items()},
            "scores": dict(task.scores),
            "methods": {method: origin(task, method) for method in method_names(task)},
        }
        names = method_names(task)
        shown = names if len(names) <= MOST_LISTED else [*names[:MOST_LISTED], f"and {len(names) - MOST_LISTED} more"]
        lines.add_row(name, task.title, ", ".join(shown))
    return found, [lines]


def describe_task(name: str) -> tuple[dict[str, Any], list[RenderableType]]:
    """Return one task's signature, conditions, scores and methods, as facts and for people."""
    task = load_task(name)
    told = list_tasks()[0][name]
    lines: list[RenderableType] = [f"{task.name}: {task.title}", f"a method: {task.signature}", ""]
    for title, entries in (
        ("condition", {key: _shown(range_) for key, range_ in task.ranges.items()}),
        ("only where asked for", {key: _shown(range_) for key, range_ in task.optional.items()}),
        ("score", task.scores),
        ("method", told["methods"]),
    ):
        if not entries:
            continue
        rows = Table(title, "", box=None)
        for key, value in entries.items():
            rows.add_row(key, value)
        lines.append(rows)
    return told, lines


def _shown(range_: Sequence[float | str]) -> str:
    words = [value for value in range_ if isinstance(value, str)]
    return "|".join(words) or "..".join(f"{value:g}" for value in range_)


def run_bench(
    name: str,
    conditions: Sequence[str] = (),
    *,
    methods: Sequence[str] = (),
    seeds: str = "1000-1009",
    count: int = 1,
    sweep: str | None = None,
    against: str | None = None,
    data: Sequence[Path] = (),
    output: Path | None = None,
    workers: int = 1,
    overwrite: bool = False,
    stages: Stages,
) -> tuple[dict[str, Any], list[RenderableType]]:
    """Run a task's methods, write ``output`` where one is given; return the facts, and what to show people.

    Raises :class:`EndoctError` where something asked for is not known, or ``output`` exists.
    """
    task = load_task(name)
    chosen = check_names(task, methods)
    if against is not None:
        task = replace(task, against=check_names(task, [against])[0])
    if task.against is not None and task.against not in chosen:
        chosen = task.against, *chosen
    if count < 1 or workers < 1:
        raise EndoctError("--count and --workers must be at least 1", found=f"{count} and {workers}")
    if data and (conditions or sweep):
        raise EndoctError("the conditions of your own data cannot be drawn", remedy="leave them out, or --data")
    plan = Plan(name, chosen, parse_seeds(seeds), count, narrowed(task, conditions, sweep))
    if data:
        plan = replace(plan, seeds=(), count=1, ranges={}, own=own_folders(data))
    if output is None:
        *_, told, lines = _run(task, plan, workers, None, stages)
        return told, lines
    check_output(output, BENCH_RESULTS, overwrite=overwrite, inputs=data)
    kept = kept_beside(output, plan, overwrite=overwrite)
    try:
        rows, apart, told, lines = _run(task, plan, workers, kept, stages)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            f"{len(kept.read())} of {len(plan.sources)} cases are kept in {kept.folder}; the same command goes on"
        ) from None
    with new_output(output, BENCH_RESULTS, overwrite=overwrite, inputs=data) as scratch:
        scratch.mkdir()
        _write(task, rows, apart, told, scratch, stages)
    kept.remove()
    return told, [*lines, f"results: {output}"]


def own_folders(data: Sequence[Path]) -> tuple[Path, ...]:
    """Return the folders with truth among ``data`` and one level below, in order of their names.

    Absolute, for processes that run elsewhere. Raises :class:`EndoctError` where there is none.
    """
    found: list[Path] = []
    for folder in data:
        inside = sorted(path.parent for path in folder.glob("*/truth"))
        found += [folder] if (folder / "truth").is_dir() else inside
    if not found:
        raise EndoctError(
            f"no data with truth in {', '.join(map(str, data))}",
            expected="a folder with oct/ or endoscope/ and truth/ in it, or a folder of such folders",
        )
    return tuple(Path(os.path.abspath(path)) for path in dict.fromkeys(found))  # noqa: PTH100 – links stay


def _run(
    task: Task, plan: Plan, workers: int, kept: Kept | None, stages: Stages
) -> tuple[list[Row], list[Difference], dict[str, Any], list[RenderableType]]:
    start = time.perf_counter()
    finished = {} if kept is None else kept.read()
    with stages.stage(f"bench {task.name}") as advance:
        keep = None if kept is None else kept.put
        rows = run(plan, workers=workers, advance=advance, finished=finished, keep=keep)
    told = facts(plan, rows, workers=workers, seconds=time.perf_counter() - start)
    lines: list[RenderableType] = [table(rows, task), *footnotes(rows, task)]
    if finished:
        told["taken_over"] = len(finished)  # of the sources of cases; their seconds are not in "seconds"
        lines.append(f"{len(finished)} of {len(plan.sources)} cases are of a run that was stopped before its end")
    apart = differences(rows, task.against, score_names(rows, [*task.scores])) if task.against else []
    if task.against and apart:
        lines.append(difference_table(apart, task.against))
        told["differences"] = {"against": task.against, "of": [asdict(one) for one in apart]}
    return rows, apart, told, lines


def _write(
    task: Task, rows: Sequence[Row], apart: Sequence[Difference], told: Mapping[str, Any], folder: Path, stages: Stages
) -> None:
    write_csv(rows, task, folder / "results.csv")
    write_json(told, folder / "bench.json")
    with stages.stage("plots"):
        draw_plots(rows, task, folder / "plots")
        if task.against and apart:
            write_differences(apart, task.against, folder / "differences.csv")
            draw_differences(apart, task.against, task, folder / "plots" / "differences.png")
