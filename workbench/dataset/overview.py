"""What a data set holds, for people: the table of all specimens ``manifest.csv``, README, licence and contact sheet.

The contact sheet is a picture of some specimens, to look at before anything is done with the set.
"""

import csv
import heapq
from collections.abc import Iterator
from io import TextIOWrapper
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from endoct.base.errors import EndoctError
from endoct.base.files.files import spreadsheet_text
from endoct.workbench.dataset.loader import Specimens
from endoct.workbench.dataset.plan import SPLITS, Plan, Split, Unit, job, split_of, units
from endoct.workbench.dataset.set_files import MadeSpecimen, Scalar, read_record, top_file
from endoct.workbench.settings import ranges_text

MANIFEST = "manifest.csv"
SHEET = "contact_sheet.png"
N_SPECIMENS = 8
TITLES = ("B-scan, depth × A-scan", "OCT from above, slice × A-scan", "endoscope", "true depth, z × θ (cells outlined)")
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


def write_manifest(root: Path, plan: Plan) -> None:
    """Write a line for each specimen, ascending: what it is, its digest, and every number and word drawn for it.

    Raises :class:`EndoctError` where a record is missing.
    """
    made = heapq.merge(*(_specimens(root, plan, split) for split in SPLITS), key=lambda pair: pair[0].index)
    with top_file(root, MANIFEST) as file:
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


def write_contact_sheet(root: Path) -> None:
    """Draw specimens spread evenly over the set in ``root``: the middle frame of both recordings, and the truth."""
    specimens = Specimens(root)
    chosen = np.unique(np.linspace(0, len(specimens) - 1, N_SPECIMENS).round().astype(int))
    figure = Figure(figsize=(14, 0.4 + 2.1 * chosen.size), dpi=80, layout="constrained")
    axes = figure.subplots(chosen.size, 4, squeeze=False, width_ratios=(1, 1, 0.85, 1.15))
    for row, index in zip(axes, chosen, strict=True):
        arrays, line = specimens[int(index)], specimens.rows[int(index)]
        oct_, frames = arrays["oct"], arrays["endoscope"]
        _draw(row[0], oct_[len(oct_) // 2], "gray")
        _draw(row[1], oct_.mean(axis=1), "gray")
        row[2].imshow(frames[len(frames) // 2])
        _draw(row[3], np.clip(arrays["relief_mm"], 0, 1), "viridis")
        row[3].contour(arrays["cell"], levels=[0.5], colors="white", linewidths=0.5)
        row[0].set_ylabel(f"{line['name']}\n{line['split']}\n{line['bore.bone']}", fontsize=8)
        for panel in row:
            panel.set(xticks=[], yticks=[])
    for panel, title in zip(axes[0], TITLES, strict=True):
        panel.set_title(title, fontsize=9)
    with top_file(root, SHEET) as file:
        figure.savefig(file, format="png", metadata={"Software": None})


def _draw(panel: Axes, image: NDArray[np.floating] | NDArray[np.uint8], colours: str) -> None:
    panel.imshow(image, cmap=colours, aspect="auto", interpolation="antialiased")


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
