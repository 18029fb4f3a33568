"""What a comparison's folder holds of each side alone: its panorama, pictures of its frames, and their figures."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from endoct.stitching.panorama import Panorama
from endoct.stitching.store import load_panorama, save_panorama
from endoct.workbench.pipeline.sample_frames import copy_sample_frames, save_sample_frames
from endoct.workbench.pipeline.unrolling import Unrolled
from endoct.workbench.report.pictures import PICTURES, load_pictures

if TYPE_CHECKING:
    from endoct.workbench.report.figures.rendered import Drawn


@dataclass(frozen=True)
class SidePart:
    """A side by ``name``: its panorama, and what pictures of its frames come from.

    That is the recording as it was unrolled, or the store of a panorama; None where there are none.
    """

    name: str
    panorama: Panorama
    pictured: Unrolled | Path | None


def write_sides(folder: Path, sides: Sequence[SidePart]) -> None:
    """Write ``panoramas`` and ``pictures`` of ``sides`` into ``folder``.

    Nothing here depends on how the sides lie on each other: it can be done while that is found out.
    """
    for side in sides:
        save_panorama(side.panorama, folder / "panoramas" / f"{side.name}.zarr")
        if isinstance(side.pictured, Unrolled):
            save_sample_frames(side.pictured, folder, side.name)
        elif side.pictured is not None:
            copy_sample_frames(side.pictured, folder, side.name)


def draw_sides(folder: Path, names: Sequence[str]) -> "list[Drawn]":
    """Return the figures that show one side alone, of what :func:`write_sides` wrote into ``folder``."""
    from endoct.workbench.report.figures.of_one import drawings_of_side, drawn  # only who draws loads matplotlib
    from endoct.workbench.report.side_findings import alone

    pictures = load_pictures(folder / PICTURES)
    panoramas = {name: load_panorama(folder / "panoramas" / f"{name}.zarr") for name in names}
    found = [replace(alone(panoramas[name], pictures.get(name, {})), name=name) for name in names]
    return drawn(one for side in found for one in drawings_of_side(side))
