"""What a data set holds, for people: the table of all specimens ``manifest.csv``, README, licence and contact sheet.

The contact sheet is a picture of some specimens, to look at before anything is done with the set.
"""

import csv
import heapq
from collections.abc import Iterator
from importlib.resources import files
from io import TextIOWrapper
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from endoct.base.errors import EndoctError
from endoct.base.files.files import spreadsheet_text
from endoct.workbench.dataset.loader import Specimens
from endoct.workbench.dataset.plan import SPLITS, DatasetPlan, Split, Unit, job, split_counts, split_of, units
from endoct.workbench.dataset.set_files import MadeSpecimen, Scalar, read_record, top_file
from endoct.workbench.settings import ranges_text

MANIFEST = "manifest.csv"
SHEET = "contact_sheet.png"
N_SPECIMENS = 8
TITLES = ("B-scan, depth × A-scan", "OCT from above, slice × A-scan", "endoscope", "true depth, z × θ (cells outlined)")


def write_manifest(root: Path, plan: DatasetPlan) -> None:
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


def _specimens(root: Path, plan: DatasetPlan, split: Split) -> Iterator[tuple[MadeSpecimen, Unit]]:
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


def _line(plan: DatasetPlan, made: MadeSpecimen, unit: Unit) -> dict[str, Scalar]:
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


def text(name: str) -> str:
    """Return a text that goes with the set, as it is in ``templates/``."""
    return files(f"{__package__}.templates").joinpath(name).read_text("utf-8")


def readme(plan: DatasetPlan) -> str:
    """Return the README of the set."""
    layout = text("webdataset.md").format(per_shard=plan.specimens_per_shard)
    return text("README.md").format(
        count=plan.count,
        preset=plan.preset,
        seed=plan.seed,
        splits=", ".join(f"{split} {count}" for split, count in split_counts(plan).items()).capitalize(),
        bores=f", and each bore has {plan.recordings_per_bore} recordings" if plan.recordings_per_bore > 1 else "",
        vary=ranges_text(plan.ranges),
        layout=(layout if plan.format == "webdataset" else text("folders.md")).removesuffix("\n"),
    )
