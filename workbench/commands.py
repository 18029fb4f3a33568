"""The commands of `endoct`, as tyro reads them from their signatures and docstrings."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich.console import Console
from rich.table import Table
from tyro.conf import Positional, UseAppendAction, arg

from endoct.synthetic.presets import PresetName
from endoct.workbench.progress import ConsoleStages, SilentStages, Stages
from endoct.workbench.status import DONE, NOT_ALIGNED

Output = Annotated[Path, arg(name="output", aliases=["-o"])]
Settings = Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="KEY=VALUE")]
Wishes = Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="KEY=LOW..HIGH")]
WIDE = 200
ModalityName = Annotated[str | None, arg(metavar="NAME")]


_IN_FILES_ONLY = ("statistic", "quartile_1", "quartile_3")
"""Columns of a summary that are left out of what is printed."""


def run(arguments: Sequence[str]) -> int:
    """Run one command and return its exit status."""
    commands: dict[str, Any] = {
        "demo": demo,
        "simulate": simulate,
        "unroll": unroll,
        "compare": compare,
        "dataset": dataset,
        "bench": bench,
        "report": report,
        "summarise": summarise,
        "info": info,
        "modalities": modalities,
    }
    status: int = tyro.extras.subcommand_cli_from_dict(
        commands,
        prog="endoct",
        description="Compare what a cone-mirror endoscope and a catheter OCT see of one drill hole in bone.",
        args=list(arguments),
        config=(tyro.conf.FlagCreatePairsOff,),
    )
    return status


def demo(
    output: Output = Path("demo"),
    preset: PresetName = "quick",
    seed: int = 1,
    overwrite: bool = False,
    json: bool = False,
) -> int:
    """Simulate a specimen, unroll both recordings, compare them and write the report.

    Args:
        output: folder for the specimen and the comparison
        preset: size and difficulty of the recordings
        seed: which specimen
        overwrite: replace the folder if it exists
        json: print the result as JSON
    """
    from endoct.workbench import api

    api.demo(output, preset=preset, seed=seed, overwrite=overwrite, stages=_stages(json))
    return _tell_result(output / "comparison", as_json=json)


def simulate(
    output: Output,
    preset: PresetName = "quick",
    seed: int = 0,
    replay: Path | None = None,
    vary: Wishes = (),
    labels: bool = False,
    spectra: bool = False,
    overwrite: bool = False,
) -> int:
    """Simulate the two recordings of one bore, with truth.

    Args:
        output: folder for the specimen
        preset: size and difficulty of the recordings
        seed: which specimen; the same seed gives the same bytes
        replay: truth/sample.json of a specimen to make again; nothing is drawn then
        vary: what a parameter is drawn from, as oct.wall_db=6..14 or oct.scan=step|helical; repeat for more
        labels: add truth/labels: layers, visibility, shadows, noise-free twins, pixel to pixel maps
        spectra: add oct-spectra: the spectrometer's raw data, 2 kB an A-scan
        overwrite: replace the folder if it exists
    """
    from endoct.workbench.simulating import simulate as write_specimen
    from endoct.workbench.vary import parse_vary

    write_specimen(
        output,
        preset=preset,
        seed=seed,
        replay=replay,
        vary=parse_vary(vary),
        labels=labels,
        spectra=spectra,
        overwrite=overwrite,
        stages=_stages(False),
    )
    _say(f"specimen: {output}")
    return DONE


def unroll(
    path: Positional[Path],
    output: Output,
    modality: ModalityName = None,
    set: Settings = (),
    volume: bool = False,
    overwrite: bool = False,
    json: bool = False,
) -> int:
    """Unroll one recording into a panorama of the bore wall.

    Args:
        path: folder or file of the recording
        output: Zarr store to write
        modality: plug-in to read it with, where the sidecar does not say
        set: a key of the sidecar or a processing parameter; repeat for more
        volume: add the dense hollow cylinder, sub-surface included
        overwrite: replace the output if it exists
        json: print what was found as JSON
    """
    from endoct.workbench import api
    from endoct.workbench.settings import parse

    panorama = api.unroll(
        path,
        output,
        modality=modality,
        settings=parse(set),
        volume=volume,
        overwrite=overwrite,
        stages=_stages(json),
    )
    facts = {
        "output": str(output),
        "modality": panorama.modality,
        "rows": panorama.grid.n_z,
        "columns": panorama.grid.n_theta,
        "z_mm": [float(panorama.z_mm[0]), float(panorama.z_mm[-1])],
        "valid_fraction": float(panorama.valid.mean()),
        "notes": list(panorama.provenance.get("notes", ())),
    }
    if json:
        _print_json(facts)
    else:
        _say(
            f"panorama: {output} ({facts['rows']} rows × {facts['columns']} columns, "
            f"z {panorama.z_mm[0]:.2f} to {panorama.z_mm[-1]:.2f} mm, {panorama.valid.mean():.1%} valid)"
        )
        for note in panorama.provenance.get("notes", ()):
            _say(f"not trusted: {note}")
    return DONE


def compare(
    a: Positional[Path],
    b: Positional[Path],
    output: Output,
    truth: tuple[Path, ...] = (),
    modality_a: ModalityName = None,
    modality_b: ModalityName = None,
    set: Settings = (),
    set_a: Settings = (),
    set_b: Settings = (),
    overwrite: bool = False,
    json: bool = False,
) -> int:
    """Compare two sides of one bore: recordings, panoramas, or mask images drawn by hand.

    Args:
        a: first side; the comparison is in its frame
        b: second side
        output: folder to write
        truth: mask drawn over side A's panorama to score both against: an image, shapes of napari (.csv) or regions
            of Fiji (.roi, .zip); several may follow, named RATER_SESSION.png
        modality_a: plug-in to read side A with
        modality_b: plug-in to read side B with
        set: a parameter of the comparison; repeat for more
        set_a: a key of side A's sidecar or a parameter of its processing
        set_b: a key of side B's sidecar or a parameter of its processing
        overwrite: replace the output if it exists
        json: print the result as JSON
    """
    from endoct.fusion.comparison import CompareParameters
    from endoct.modalities.acquisition import validate
    from endoct.workbench import api
    from endoct.workbench.settings import parse

    api.compare(
        a,
        b,
        output,
        modality_a=modality_a,
        modality_b=modality_b,
        settings_a=parse(set_a),
        settings_b=parse(set_b),
        parameters=validate(CompareParameters, parse(set), "the settings of the comparison"),
        truth=truth,
        overwrite=overwrite,
        stages=_stages(json),
    )
    return _tell_result(output, as_json=json)


def dataset(
    output: Output,
    count: int,
    preset: PresetName = "learning",
    seed: int = 0,
    vary: Wishes = (),
    format: Literal["folders", "webdataset"] = "folders",
    labels: bool = False,
    recordings_per_bore: int = 1,
    workers: int | None = None,
    scheduler: str | None = None,
    dry_run: bool = False,
    json: bool = False,
) -> int:
    """Make a data set of many simulated specimens, or what is missing of one.

    The same arguments give the same bytes, whoever makes them; started again, it makes only what is missing, and
    with a larger count it adds to what is there.

    Args:
        output: folder of the data set
        count: specimens
        preset: size and difficulty of the recordings
        seed: which data set
        vary: what a parameter is drawn from, as oct.wall_db=6..14 or oct.scan=step|helical; repeat for more
        format: a folder for each specimen, or tar files for the webdataset library
        labels: add truth/labels: layers, visibility, shadows, noise-free twins, pixel to pixel maps
        recordings_per_bore: specimens in a row that show one bore
        workers: processes that make it; default: one for each processor
        scheduler: address of a dask scheduler, whose workers make it; they must see the output folder under its name
        dry_run: make one specimen in a temporary folder and say what all would take
        json: print the result as JSON
    """
    from endoct.workbench.dataset.command import run_dataset
    from endoct.workbench.dataset.plan import Plan
    from endoct.workbench.vary import parse_vary

    plan = Plan(count, preset, seed, parse_vary(vary), format, labels, recordings_per_bore)
    facts, lines = run_dataset(
        output, plan, workers=workers, scheduler=scheduler, dry_run=dry_run, stages=_stages(json)
    )
    if json:
        _print_json(facts)
    else:
        for line in lines:
            _say(line)
    return DONE


def bench(
    task: Positional[str | None] = None,
    conditions: Positional[tuple[str, ...]] = (),
    output: Annotated[Path | None, arg(aliases=["-o"])] = None,
    methods: Annotated[str, arg(metavar="NAME,NAME")] = "",
    seeds: str = "1000-1009",
    count: int = 1,
    sweep: Annotated[str | None, arg(metavar="CONDITION")] = None,
    against: Annotated[str | None, arg(metavar="NAME")] = None,
    data: tuple[Path, ...] = (),
    workers: int = 1,
    describe: bool = False,
    overwrite: bool = False,
    json: bool = False,
) -> int:
    """Run named methods on the same cases with truth: a table, results.csv, plots. docs/bench.md tells more.

    Args:
        task: alignment, stitching, segmentation, oct, ablate, sensitivity or another's; left out, all are listed
        conditions: what cases are drawn from, as cell_mm=0.2..1 or modality=depth|intensity; next to the task
        output: folder for results.csv, bench.json and plots
        methods: which methods, with commas; default: all
        seeds: first-last, or numbers with commas; 0-99 are for tuning
        count: cases a seed
        sweep: vary this condition alone and hold the others at the middle of their range
        against: tell differences from this method too, case by case
        data: folders of your own data with truth, or folders of such folders, in place of simulated cases
        workers: processes that share the cases; with more than one, seconds are those of a busy machine
        describe: say what the task gives, asks for and scores, and run nothing
        overwrite: replace the output if it exists
        json: print as JSON
    """
    from endoct.workbench.bench.command import describe_task, list_tasks, run_bench

    if task is None:
        facts, shown = list_tasks()
    elif describe:
        facts, shown = describe_task(task)
    else:
        facts, shown = run_bench(
            task,
            conditions,
            methods=[name.strip() for name in methods.split(",") if name.strip()],
            seeds=seeds,
            count=count,
            sweep=sweep,
            against=against,
            data=data,
            output=output,
            workers=workers,
            overwrite=overwrite,
            stages=_stages(json),
        )
    if json:
        _print_json(facts)
        return DONE
    console = _Console()
    if not console.is_terminal:
        console = _Console(width=WIDE)  # nobody's window is too narrow
    for part in shown:
        console.print(part, highlight=False, markup=False, soft_wrap=isinstance(part, str))
    return DONE


def report(folder: Positional[Path]) -> int:
    """Write the report of a comparison again.

    Args:
        folder: what `endoct compare` wrote
    """
    from endoct.workbench.report import write_report

    with _stages(False).stage("report"):
        path = write_report(folder)
    _say(f"report: {path}")
    return DONE


def summarise(
    folders: Positional[tuple[Path, ...]],
    output: Output,
    against: tuple[Path, ...] = (),
    repeats: bool = False,
    overwrite: bool = False,
    json: bool = False,
) -> int:
    """Summarise many comparisons: a tidy table, medians over specimens with intervals, differences, repeatability.

    Args:
        folders: what `endoct compare` wrote, several
        output: folder to write
        against: a second set of comparisons, paired with the first by their recordings, or else by the folders' names
        repeats: comparisons in one folder are of one specimen; say how well they repeat
        overwrite: replace the output if it exists
        json: print the summary as JSON
    """
    from endoct.workbench import api

    tables = api.summarise(folders, output, against=against, repeats=repeats, overwrite=overwrite)
    if json:
        _print_json(tables)
        return DONE
    for name in ("summary", "paired", "repeatability"):
        if rows := [{k: v for k, v in row.items() if k not in _IN_FILES_ONLY} for row in tables[name]]:
            table = Table(title=name, title_justify="left", box=None)
            for column in rows[0]:
                table.add_column(column, no_wrap=True)
            for row in rows:
                table.add_row(
                    *("–" if v is None else f"{v:.3g}" if isinstance(v, float) else str(v) for v in row.values())
                )
            _Console().print(table)
    _say(f"summary: {output}")
    return DONE


def info(
    path: Positional[Path],
    modality: ModalityName = None,
    write_sidecar: bool = False,
    overwrite: bool = False,
    json: bool = False,
) -> int:
    """Say what a recording, a panorama or a comparison is, and what its sidecar lacks.

    Args:
        path: folder or file
        modality: plug-in to read it with
        write_sidecar: write an acquisition.toml to fill in
        overwrite: replace the acquisition.toml if it exists
        json: print as JSON
    """
    from endoct.workbench.information import describe, write_sidecar_template

    if write_sidecar:
        sidecar, missing = write_sidecar_template(path, modality, overwrite=overwrite)
        _say(f"sidecar: {sidecar}")
        for key, why in missing.items():
            _say(f"to fill in: {key} – {why}")
        return DONE
    facts = describe(path, modality)
    if json:
        _print_json(facts)
    else:
        table = Table(show_header=False, box=None)
        for key, value in facts.items():
            table.add_row(key, str(value))
        _Console().print(table)
    return DONE


def modalities(json: bool = False) -> int:
    """List the installed modalities.

    Args:
        json: print as JSON
    """
    from endoct.workbench.information import installed_modalities

    rows = installed_modalities()
    if json:
        _print_json(rows)
        return DONE
    table = Table("name", "title", "provides", "reads", box=None)
    for row in rows:
        table.add_row(row["name"], row["title"], ", ".join(row["provides"]), " ".join(row["suffixes"]))
    _Console().print(table)
    return DONE


class _Console(Console):
    """A console that leaves it to the entry point what a reader who went away means."""

    def on_broken_pipe(self) -> None:
        """Raise what was caught."""
        raise BrokenPipeError


def _tell_result(folder: Path, *, as_json: bool) -> int:
    result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    if as_json:
        _print_json(result)
    elif result["aligned"]:
        _say(f"Jaccard index {result['jaccard']:.3f}, Dice {result['dice']:.3f} ({' and '.join(result['sides'])})")
    else:
        _say(f"not aligned: {result['reason']}")
    if not as_json:
        for side, notes in result["notes"].items():
            for note in notes:
                _say(f"not trusted ({side}): {note}")
        _say(f"report: {folder / 'report.html'}")
    return DONE if result["aligned"] else NOT_ALIGNED


def _stages(as_json: bool) -> Stages:
    # progress goes to stderr, so that stdout can be piped
    return SilentStages() if as_json and not Console(stderr=True).is_terminal else ConsoleStages(Console(stderr=True))


def _say(line: str) -> None:
    _Console().print(line, highlight=False, markup=False, soft_wrap=True)


def _print_json(value: object) -> None:
    print(json.dumps(value, indent=1, ensure_ascii=False))  # noqa: T201
