"""The figure of a calibration: what was measured, with the model's line, a panel each."""

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from endoct.modalities.tube.measurement import Measurement
from endoct.workbench.exporting.mark import BLANK

COLUMNS = 3
PANEL_IN = 3.2, 2.5
LINE_IN = 0.2
DPI = 150
MOST_POINTS = 4000


def figure_path(output: Path) -> Path:
    """Return where the figure of the calibration ``output`` lies."""
    return output.with_suffix(".png")


def write_figure(measured: Measurement, path: Path) -> None:
    """Write the panels of a calibration as PNG, and its quantities with their standard errors below."""
    rows = -(-len(measured.panels) // COLUMNS)
    text_in = LINE_IN * len(measured.quantities)
    size = COLUMNS * PANEL_IN[0], rows * PANEL_IN[1] + text_in + 0.3
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    places = figure.add_gridspec(
        rows + 1, COLUMNS, height_ratios=[PANEL_IN[1]] * rows + [0.2 * len(measured.quantities)]
    )
    for k, panel in enumerate(measured.panels):
        axes = figure.add_subplot(places[k // COLUMNS, k % COLUMNS])
        some = slice(None, None, max(1, panel.x.size // MOST_POINTS))
        axes.plot(panel.x[some], panel.y[some], ".", markersize=2, color="0.45")
        if panel.line is not None:
            order = np.argsort(panel.line[:, 0])
            axes.plot(*panel.line[order].T, "-", linewidth=1, color="tab:red")
        axes.set_title(panel.title, fontsize=8)
        axes.set_xlabel(panel.x_label, fontsize=7)
        axes.set_ylabel(panel.y_label, fontsize=7)
        axes.tick_params(labelsize=6)
    axes = figure.add_subplot(places[rows, :])
    axes.axis("off")
    lines = [f"{each.title}: {each.value:.6g} ± {each.sigma:.2g} {each.unit}" for each in measured.quantities]
    axes.text(0, 1, "\n".join(lines), fontsize=7, va="top", family="monospace", transform=axes.transAxes)
    figure.savefig(path, dpi=DPI, format="png", metadata={"Software": BLANK})
