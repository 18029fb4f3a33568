"""Paper, type and colours of all figures, and how they become pictures."""

import io
import re
import struct
import textwrap
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from typing import Any

import numpy as np
from imagecodecs import png_encode
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from matplotlib.transforms import Bbox
from numpy.typing import NDArray
from PIL import Image

from endoct.workbench.report.figures.rendered import Rendered

PAGE_WIDTH_IN = 7.2
"""Text width of a two-column journal page, 183 mm."""

DPI = 250
MOST_EMBEDDED_BYTES = 350_000
"""Bytes of a PNG that a page embeds as it is: line drawings, which a lossy copy would blur."""
EMBEDDED_QUALITY = 84
"""Quality of the JPEG copies of others, as good as WebP of 88 in a tenth of its time; the files in figures/ are
lossless."""
_PAETH = 128
_HEADER_BYTES = 33
"""Bytes of a PNG before its data: its signature, and the chunk that says its size."""
MARGIN_IN = 1.0
"""Paper around what is placed, for labels: nothing is cut off, and what stays white is trimmed."""

_STYLE: Any = {  # Any: matplotlib types its keys as literals
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "axes.labelsize": 7.5,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "legend.fontsize": 7.0,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "hatch.linewidth": 0.5,
    "axes.titlelocation": "left",
    "text.parse_math": False,  # a name may have "$" in it; logarithmic axes: number_decades
    "axes.titley": 1.0,  # fixed: matplotlib would measure every label to find a place for it
}

# Okabe and Ito's palette: colour-blind readers can distinguish them, and so can readers of a grey print
ORANGE, BLUE, GREEN, VERMILION, PURPLE, SKY = "#E69F00", "#0072B2", "#009E73", "#D55E00", "#CC79A7", "#56B4E9"
YELLOW = "#F0E442"
INK, PAPER = "#3a3a3a", "#f4f4f2"
NOT_OBSERVED, HATCH = "#b9d0f2", "#7f9fd0"
"""Colours of what was not observed: blue enough to differ from bright samples where there is no room for hatching."""
PLACES = (PURPLE, ORANGE, BLUE)

INTENSITY_COLOURS, DEPTH_COLOURS = "gray", "magma_r"
"""Perceptually uniform both; depth runs from the pale of bone to black, so that cells are dark in every panel."""
MASK_COLOURS = ListedColormap([PAPER, INK])


def journal_style() -> AbstractContextManager[None]:
    """Return the context in which every figure is made and drawn: small type and thin lines."""
    return rc_context(_STYLE)


def number_decades(axis: Axis, within: Sequence[float] = (1.0, 2.0, 5.0)) -> None:
    """Write plain numbers at each decade of a logarithmic axis, times ``within``."""
    axis.set_major_locator(LogLocator(subs=within))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def new_figure(width_in: float, height_in: float) -> Figure:
    """Return an empty figure with a canvas of its own: no global state, safe in any thread.

    It has :data:`MARGIN_IN` of paper more on every side. Axes are put into it by :func:`place`: matplotlib's layout
    engines measure every label several times, which took longer than all else of a report together.
    """
    return Figure(figsize=(width_in + 2 * MARGIN_IN, height_in + 2 * MARGIN_IN), dpi=DPI)


def place(figure: Figure, left_in: float, top_in: float, width_in: float, height_in: float) -> Axes:
    """Return new axes whose frame lies so far from the left and the top of a :func:`new_figure`'s paper."""
    paper_width_in, paper_height_in = figure.get_size_inches()
    bottom_in = paper_height_in - MARGIN_IN - top_in - height_in
    return figure.add_axes(
        (
            (MARGIN_IN + left_in) / paper_width_in,
            bottom_in / paper_height_in,
            width_in / paper_width_in,
            height_in / paper_height_in,
        )
    )


def width_of(axes: Axes) -> float:
    """Return the width of ``axes`` in inches."""
    return float(axes.get_position(original=True).width * axes.figure.bbox.width / DPI)


Keep = Callable[[Figure, str, Bbox], None]
"""Takes a figure, its name, and where in inches on its paper there is ink."""
_KEEP: ContextVar[Keep | None] = ContextVar("_KEEP", default=None)


def svg_of(figure: Figure, inked: Bbox) -> bytes:
    """Return what is ``inked`` of a figure as SVG; its text stays text, and the same figure gives the same bytes."""
    file = io.BytesIO()
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "endoct"}):
        figure.savefig(file, format="svg", metadata={"Date": None}, bbox_inches=inked)
    return file.getvalue()


@contextmanager
def handed_to(keep: Keep) -> Iterator[None]:
    """Have every figure that is rendered within the block handed to ``keep``, and no picture made of it."""
    token = _KEEP.set(keep)
    try:
        yield
    finally:
        _KEEP.reset(token)


def render(figure: Figure, name: str) -> Rendered:
    """Return ``figure`` as a picture with its white margins trimmed; without pixels where it is :func:`handed_to`."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    # trimmed here: matplotlib's own trimming draws everything twice
    pixels = np.asarray(canvas.buffer_rgba())
    inked = pixels.view(np.uint32)[..., 0] != np.uint32(0xFFFFFFFF)
    rows, columns = np.flatnonzero(inked.any(axis=1)), np.flatnonzero(inked.any(axis=0))
    margin = round(0.04 * DPI)
    top, left = max(0, rows[0] - margin), max(0, columns[0] - margin)
    bottom, right = rows[-1] + margin + 1, columns[-1] + margin + 1
    if (keep := _KEEP.get()) is not None:
        high = pixels.shape[0]
        keep(figure, name, Bbox([[left / DPI, (high - bottom) / DPI], [right / DPI, (high - top) / DPI]]))
        return Rendered(name, (right - left) / DPI, b"", None)
    trimmed = np.ascontiguousarray(pixels[top:bottom, left:right, :3])
    png = _png(trimmed)
    return Rendered(name, trimmed.shape[1] / DPI, png, _jpeg(trimmed) if len(png) > MOST_EMBEDDED_BYTES else None)


def _jpeg(pixels: NDArray[np.uint8]) -> bytes:
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "JPEG", quality=EMBEDDED_QUALITY, subsampling="4:4:4")
    return file.getvalue()


def _png(pixels: NDArray[np.uint8]) -> bytes:
    """Return ``pixels`` (row, column, RGB) as a PNG that says how large it is printed.

    One filter serves all rows. To try every filter, as Pillow does, takes twice the time for a hundredth of the size.
    """
    png = bytes(png_encode(pixels, level=1, filter=_PAETH))
    per_metre = round(DPI / 0.0254)
    content = b"pHYs" + struct.pack(">IIB", per_metre, per_metre, 1)
    chunk = struct.pack(">I", len(content) - 4) + content + struct.pack(">I", zlib.crc32(content))
    return png[:_HEADER_BYTES] + chunk + png[_HEADER_BYTES:]


def hatch_not_observed(axes: Axes) -> None:
    """Hatch the background of ``axes``, which shows where nothing is drawn, as not observed."""
    axes.patch.set(facecolor=NOT_OBSERVED, edgecolor=HATCH, hatch="//////", linewidth=0)


def bar_under(axes: Axes, image: ScalarMappable, label: str) -> None:
    """Draw a horizontal colour bar into ``axes``."""
    bar = axes.figure.colorbar(image, cax=axes, orientation="horizontal", extend="both")
    bar.set_label(label, fontsize=7, labelpad=1)
    bar.ax.tick_params(labelsize=6.5, length=2)
    bar.outline.set_linewidth(0.5)


def unit_of(label: str) -> str:
    """Return what stands in the last parentheses of an axis label, "" where there are none."""
    found = re.search(r"\(([^()]*)\)\s*$", label)
    return found.group(1) if found else ""


def wrapped(text: str, width_in: float) -> str:
    """Return ``text`` in lines that fit over a panel of ``width_in``, at the size of titles."""
    return "\n".join(textwrap.wrap(text, max(12, round(width_in * 14))))


def letters(count: int) -> Sequence[str]:
    """Return (a), (b), …: how panels are referred to."""
    return [f"({chr(ord('a') + k)})" for k in range(count)]
