"""The table of all specimens, ``manifest.csv``, and the licence and the README of a data set."""

import csv
import heapq
from collections.abc import Iterator
from io import TextIOWrapper
from pathlib import Path

from endoct.base.errors import EndoctError
from endoct.base.files.files import spreadsheet_text
from endoct.workbench.dataset.plan import SPLITS, Plan, Split, Unit, job, split_of, units
from endoct.workbench.dataset.set_files import MadeSpecimen, Scalar, read_record, top_file
from endoct.workbench.pipeline.settings import ranges_text

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


LICENCE = """\
SPDX-License-Identifier: CC0-1.0

Creative Commons CC0 1.0 Universal, Public Domain Dedication
https://creativecommons.org/publicdomain/zero/1.0/

To the extent possible under law, the person who generated this data set has waived all copyright and related or
neighbouring rights to it: to the simulated recordings, their truth and labels, the manifest and the pictures. You
can copy, modify and distribute them and use them in any way, also commercially, without asking permission. They come
without warranty. The legal code is at https://creativecommons.org/publicdomain/zero/1.0/legalcode

This says nothing of the program that generated the data set, which has a licence of its own.
"""

README = """\
# {count} simulated specimens, preset {preset}, seed {seed}

Each specimen is a drill hole in bone, recorded by a cone-mirror endoscope and by a catheter OCT, with its truth. All
of it is simulated; no recording of a real bore is in it. Public domain, see LICENSE. Look at `contact_sheet.png` first.

- `manifest.csv`: a line a specimen: index, name, split, seed, bore, bore_seed, digest, path, and every drawn number
  and word as `part.name`. Angles are in rad, lengths in mm, as the names say.
- {splits}. Splits are by bore: no two show the same one{bores}.
- `dataset.json`: the arguments and versions it was made with. Drawn otherwise than by preset: {vary}.
- {layout}
- `records/`: sha256 of every file, by which an interrupted `endoct dataset` knows what is finished.
  A specimen's digest is the sha256 of the lines of `sha256sum` over its files, sorted by path.

Bore frame, right-handed: z in mm along the bore, growing inward from the mouth; θ = atan2(y, x) in rad, clockwise
when looking in; r in mm from the axis. Axis order z, θ, depth, channel; θ is a circle.

    from torch.utils.data import DataLoader
    from endoct.workbench.dataset import Specimens
    loader = DataLoader(Specimens("path/to/this/folder", split="train"), batch_size=4, shuffle=True, num_workers=2)

Each step has `oct` u8 (batch, slice, depth, A-scan), `endoscope` u8 (batch, frame, row, column, RGB), and the truth
`relief_mm`, `cell` and `cell_id` (batch, z, θ).
"""
FOLDERS = """\
`specimens/NAME/`: `oct/pullback.tif` (slice, depth, A-scan), `endoscope/`, each with its `acquisition.toml`,
  and `truth/`, as `endoct simulate` writes them; `endoct compare` reads them."""
SHARDS = """\
`shards/SPLIT-NUMBER.tar`: {per_shard} specimens each (the last of a split fewer), for the webdataset library:
  `NAME.oct.npy`, `NAME.endoscope.npy`, `NAME.relief_mm.npy` … and `NAME.sample.json`, from which
  `endoct simulate --replay` makes the specimen's folder again."""


def readme(plan: Plan) -> str:
    """Return the README of the set."""
    counts = dict.fromkeys(SPLITS, 0)
    for index in range(plan.count):
        counts[split_of(plan, index)] += 1
    return README.format(
        count=plan.count,
        preset=plan.preset,
        seed=plan.seed,
        splits=", ".join(f"{split} {count}" for split, count in counts.items()).capitalize(),
        bores=f", and each bore has {plan.recordings_per_bore} recordings" if plan.recordings_per_bore > 1 else "",
        vary=ranges_text(plan.ranges),
        layout=SHARDS.format(per_shard=plan.specimens_per_shard) if plan.format == "webdataset" else FOLDERS,
    )
