"""Figures of measured points on a line of theory, with what is left between them below."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

from endoct.base.arrays import Coordinates

INK, POINT, REST = "#222222", "#d55e00", "#0072b2"


@dataclass(frozen=True, eq=False)
class Curve:
    """Measured points over x, and the theory there; ``name`` for the legend."""

    x: Coordinates
    measured: Coordinates
    theory: Coordinates
    name: str = ""


@dataclass(frozen=True, eq=False)
class Panel:
    """Curves with the labels of their axes; what is left is shown times ``scale`` in ``rest_unit``."""

    title: str
    x_label: str
    y_label: str
    rest_label: str
    curves: Sequence[Curve]
    scale: float = 1.0
    log: bool = False


def save_panels(path: Path, panels: Sequence[Panel]) -> None:
    """Draw panels side by side, measured and theory above, what is left below."""
    with plt.rc_context({"font.size": 12, "axes.spines.top": False, "axes.spines.right": False}):
        figure, axes = plt.subplots(
            2, len(panels), figsize=(5.2 * len(panels), 5.4), height_ratios=(3, 1), squeeze=False, sharex="col"
        )
        for (above, below), panel in zip(axes.T, panels, strict=True):
            for i, curve in enumerate(panel.curves):
                order = np.argsort(curve.x)
                shade = (POINT, REST, "#009e73")[i % 3] if len(panel.curves) > 1 else POINT
                above.plot(curve.x[order], curve.theory[order], color=INK, lw=1.3, label="theory" if i == 0 else None)
                name = curve.name or "measured"
                above.plot(curve.x, curve.measured, "o", ms=4, color=shade, mfc="none", mew=1.2, label=name)
                below.plot(curve.x, panel.scale * (curve.measured - curve.theory), "o", ms=3, color=shade)
            if panel.log:
                above.set_yscale("log")
            below.axhline(0, color=INK, lw=0.8)
            above.set_title(panel.title, fontsize=12.5)
            above.set_ylabel(panel.y_label)
            below.set_ylabel(panel.rest_label)
            below.set_xlabel(panel.x_label)
            above.legend(frameon=False, fontsize=10.5)
        figure.align_ylabels(axes[:, 0])
        figure.tight_layout()
        save(figure, path)


def save(figure: "matplotlib.figure.Figure", path: Path, colours: int = 64) -> None:
    """Write a figure as PNG with so many colours, and close it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    picture = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])
    picture.quantize(colours, dither=Image.Dither.NONE).save(path, optimize=True)
    plt.close(figure)
