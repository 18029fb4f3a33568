"""The stores of endoct in napari as what they are, in mm. Without this napari takes their arrays for one pyramid.

Nothing of napari is imported: it gets functions and plain tuples.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from endoct.base.errors import EndoctError
from endoct.workbench.exporting.image_layers import contrast_of, levels_of, read_level, thinned
from endoct.workbench.exporting.source import Exportable, open_for_export

LayerData = tuple[Any, dict[str, Any], str]
COLOURS = "magenta", "green"


def reader_of(path: str | list[str]) -> Callable[[str], list[LayerData]] | None:
    """Return what reads ``path`` for napari; None where it is no panorama, comparison or truth of endoct's."""
    if not isinstance(path, str):
        return None
    try:
        open_for_export(Path(path))
    except EndoctError:
        return None
    return lambda chosen: layers_of(open_for_export(Path(chosen)))


def layers_of(source: Exportable) -> list[LayerData]:
    """Return (data, how to display it, kind) of every image and of the cells, as napari takes layers.

    Rows are z and columns the arc from θ = 0 on the nominal wall, both in mm; data are pyramids, the finest first.
    """
    levels, grid = levels_of(source.grid), source.grid
    placed = {
        "scale": levels[0].step_mm(grid),
        "translate": levels[0].origin_mm(grid),
        "units": ("mm", "mm"),
        "axis_labels": ("z", "arc of theta"),
        "multiscale": True,
    }
    two = len(source.sides) > 1
    made: list[LayerData] = []
    for layer in source.layers:
        images = [read_level(layer, level, 0, level.shape[0]) for level in levels]
        is_relief = layer.quantity == "relief"
        display = {
            "name": layer.title,
            "contrast_limits": contrast_of(layer),
            "colormap": "viridis" if is_relief else COLOURS[source.sides.index(layer.side)] if two else "gray",
            "blending": "additive",
            "visible": not is_relief or len(source.layers) == 1,
        }
        made.append((images, placed | display, "image"))
    for labels in source.labels:
        if not labels.name.endswith("observed"):  # what is not, is NaN in the images
            ids = labels.read()
            display = {"name": labels.name, "visible": False}
            made.append(([thinned(ids, level) for level in levels], placed | display, "labels"))
    return made
