"""The table of all specimens, ``manifest.csv``."""

import csv
import heapq
from collections.abc import Iterator
from io import TextIOWrapper
from pathlib import Path

from endoct.stitching.errors import EndoctError
from endoct.stitching.names import spreadsheet_text
from endoct.workbench.dataset.files import top_file
from endoct.workbench.dataset.plan import SPLITS, Plan, Split, Unit, job, split_of, units
from endoct.workbench.dataset.records import MadeSpecimen, Scalar, read_record

NAME = "manifest.csv"


def write_manifest(root: Path, plan: Plan) -> None:
    """Write a line for each specimen, ascending: what it is, its digest, and every number and word drawn for it.

    Raises :class:`EndoctError` where a record is missing.
    """
    made = heapq.merge(*(_specimens(root, plan, split) for split in SPLITS), key=lambda pair: pair[0].index)
    with top_file(root, NAME) as file:
        text = TextIOWrapper(file, encoding="utf-8", newline="")
        writer: csv.DictWriter[str] | None = None
        for specimen, unit in made:
            line = _line(plan, specimen, unit)
            if writer is None:
                writer = csv.DictWriter(text, list(line), lineterminator="\n")
                writer.writeheader()
            writer.writerow(line)
        text.detach()


def _specimens(root: Path, plan: Plan, split: Split) -> Iterator[tuple[MadeSpecimen, Unit]]:
    """Yield the specimens of one split, ascending, as they stand in their records."""
    for unit in units(plan):
        if split_of(plan, unit.indices[0]) != split:
            continue
        record = read_record(root, unit)
        if record is None:
            raise EndoctError(
                f"the record of {unit.name} in {root} is gone", remedy="start again with the same arguments"
            )
        for specimen in record.specimens:
            yield specimen, unit


def _line(plan: Plan, made: MadeSpecimen, unit: Unit) -> dict[str, Scalar]:
    this = job(plan, made.index)
    drawn = {name: str(value).lower() if isinstance(value, bool) else value for name, value in made.parameters.items()}
    return {
        "index": this.index,
        "name": this.name,
        "split": split_of(plan, this.index),
        "seed": this.seed,
        "bore": this.bore,
        "bore_seed": this.bore_seed,
        "digest": spreadsheet_text(made.digest),
        "path": unit.place.as_posix(),
        **{k: spreadsheet_text(value) if isinstance(value, str) else value for k, value in drawn.items()},
    }
