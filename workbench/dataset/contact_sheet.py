"""A picture of some specimens of a data set, to look at before anything is done with it."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from endoct.workbench.dataset.files import top_file
from endoct.workbench.dataset.reading import Specimens

NAME = "contact_sheet.png"
N_SPECIMENS = 8
TITLES = ("B-scan, depth × A-scan", "OCT from above, slice × A-scan", "endoscope", "true depth, z × θ (cells outlined)")


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
    with top_file(root, NAME) as file:
        figure.savefig(file, format="png", metadata={"Software": None})


def _draw(panel: Axes, image: NDArray[np.floating] | NDArray[np.uint8], colours: str) -> None:
    panel.imshow(image, cmap=colours, aspect="auto", interpolation="antialiased")
