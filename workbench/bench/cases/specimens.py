"""Simulated specimens and folders of the user's own as cases, also bores whose cells are all of one size.

The simulator draws cells from 0.2 to 1.5 mm at once; cells of one size allow sweeps over that size.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import cast

import numpy as np
import tifffile
from numpy.random import Generator

from endoct.base.arrays import Mask
from endoct.base.errors import EndoctError
from endoct.base.files.scratch import TemporaryFolder
from endoct.fusion.geometry.placement import IN_PLACE, Placement, check_same_bore
from endoct.modalities.reading.recording import IMAGE_SUFFIXES
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import is_panorama, load_panorama
from endoct.synthetic.bone.drawn_cells import CutWall, draw_holes
from endoct.synthetic.sample.parameters import Bore, Cell
from endoct.synthetic.sample.presets import PRESETS, PresetName
from endoct.synthetic.sample.ranges import PARTS, choices, default_ranges
from endoct.workbench.bench.task import Range, rng_of
from endoct.workbench.pipeline.truth import load_truth, true_cells, true_pose

PRESET_WORDS: tuple[str, ...] = tuple(PRESETS)
MODALITIES: Sequence[str] = ("oct", "endoscope")

BLACK_SLICES, CELL_MM = "black_slices", "cell_mm"
OWN_DIFFICULTIES: Mapping[str, Range] = {BLACK_SLICES: (0.0, 0.3), CELL_MM: (0.2, 1.5)}
DIFFICULTIES: Mapping[str, Range] = {
    **OWN_DIFFICULTIES,
    **{f"{part}.{name}": range_ for part, model in PARTS.items() for name, range_ in default_ranges(model).items()},
    **{f"{part}.{name}": words for part, model in PARTS.items() for name, words in choices(model).items()},
}
"""A simulated specimen can differ from its preset in these, by default within these ranges.

They are the share of the OCT's slices that are black and the one size of all its cells. Any parameter that ``endoct
simulate --vary`` takes is one as well.
"""
LEAST_MM = 0.2
DEPTHS_MM = (0.05, 1.5)
DEEPEST = 1.1
"""Depth over opening; this and the depths are those between which the phantom's holes are drawn."""
TRIES = 20
"""Tries for each cell that would be needed if no two met."""


def simulated(
    preset: str, seed: int, index: int, difficulties: Mapping[str, float | str] | None = None, *, ct: bool = False
) -> TemporaryFolder:
    """Return a temporary folder with one specimen; the first of a seed is that of ``endoct simulate --seed``.

    ``ct``: with a CT of it, ``truth/ct.nii.gz``.
    """
    from endoct.synthetic.draw import Scans, draw
    from endoct.synthetic.specimen import simulate

    difficulties = difficulties or {}
    ranges: dict[str, Range] = {
        name: (value,) if isinstance(value, str) else (float(value), float(value))
        for name, value in difficulties.items()
        if name not in OWN_DIFFICULTIES
    }
    folder = TemporaryFolder("bench")
    try:
        of = seed if index == 0 else 1_000_000 * (1 + seed) + index
        sample = None
        if CELL_MM in difficulties:
            drawn = draw(cast(PresetName, preset), of, ranges=ranges, scans=Scans(ct=ct))
            cells = uniform_cells(rng_of(seed, index, CELL_MM), drawn.bore, float(difficulties[CELL_MM]))
            bone = "phantom" if drawn.bore.bone == "network" else drawn.bore.bone  # in which cells are planted
            bore = drawn.bore.model_copy(update={"cells": cells, "bone": bone, "network": None, "density": None})
            sample = drawn.model_copy(update={"bore": bore}).model_dump()
        specimen = Path(folder.name) / "specimen"
        simulate(specimen, preset=cast(PresetName, preset), seed=of, ranges=ranges, sample=sample, ct=ct)
        if share := float(difficulties.get(BLACK_SLICES, 0.0)):
            _blacken(specimen / "oct" / "pullback.tif", share, rng_of(seed, index, BLACK_SLICES))
    except BaseException:
        folder.cleanup()
        raise
    return folder


def _blacken(recording: Path, share: float, rng: np.random.Generator) -> None:
    volume = tifffile.imread(recording)
    volume[rng.permutation(len(volume))[: round(share * len(volume))]] = 0
    tifffile.imwrite(recording, volume)


def truths_of(specimen: Path, panorama: Panorama) -> Mapping[str, Mask]:
    """Return every truth there is for a panorama of one of the specimen's recordings, on its samples, by name.

    A simulated specimen has ``truth/wall.zarr``. Other data have masks, ``truth/MODALITY*.png`` or TIFF. These are
    drawn over the panorama that `endoct unroll` makes, or a sidecar says where they lie. Raises :class:`EndoctError`
    where there is neither.
    """
    if (specimen / "truth" / "wall.zarr").is_dir():
        truth = load_truth(specimen)
        return {"wall": true_cells(truth, true_pose(panorama, truth), panorama)}
    drawn = {}
    for path in sorted((specimen / "truth").glob(f"{panorama.modality}*")):
        if path.suffix.lower() in IMAGE_SUFFIXES:
            drawn[path.stem] = drawn_cells(path, panorama)
    if not drawn:
        raise EndoctError(
            f"{specimen / 'truth'} holds no truth for the {panorama.modality} panorama",
            expected=f"wall.zarr of a simulated specimen, or masks drawn by hand, as {panorama.modality}.png",
        )
    return drawn


def drawn_cells(path: Path, panorama: Panorama) -> Mask:
    """Return the cells of a mask drawn by hand on the panorama's samples, bool (n_z, n_theta)."""
    from endoct.fusion.files.masks import read_mask

    drawn = read_mask(path, like=panorama)
    check_same_bore(panorama.grid.radius_mm, drawn.grid.radius_mm)
    placement = Placement.averaging(drawn.grid, IN_PLACE, panorama.grid)
    cells, _ = placement.mask(drawn.mask, np.ones(drawn.mask.shape, np.bool_))
    return cells


def recordings_in(specimen: Path) -> list[Path]:
    """Return the recordings of a specimen, those of OCT and endoscope first. Raises :class:`EndoctError` for none."""
    recordings = [
        path for path in sorted(specimen.iterdir()) if path.is_dir() and (path / "acquisition.toml").is_file()
    ]
    if not recordings:
        raise EndoctError(f"{specimen} holds no recording", expected="oct/ or endoscope/ with an acquisition.toml")
    return sorted(recordings, key=lambda path: path.name not in MODALITIES)


def load_side(folder: Path, name: str) -> Panorama:
    """Return the panorama ``NAME.zarr`` in a folder, or the recording ``NAME`` unrolled."""
    from endoct.workbench import api  # programs apart from the truth load this module too

    return load_panorama(stored) if is_panorama(stored := folder / f"{name}.zarr") else api.unroll(folder / name)


def uniform_cells(rng: Generator, bore: Bore, opening_mm: float) -> tuple[Cell, ...]:
    """Return drilled holes ``opening_mm`` across that cut away the share of the wall that the ``bore`` wants.

    Holes as the phantom has them, brought to that size, each with the depth that one of that size could have, and
    laid anywhere. Raises :class:`EndoctError` where there is no room for so many.
    """
    wall, holes = CutWall(bore), [_brought_to(hole, opening_mm) for hole in draw_holes(rng, bore)]
    needed = bore.cell_fraction * math.pi * bore.diameter_mm * bore.length_mm / (math.pi / 4 * opening_mm**2)
    for _ in range(TRIES * math.ceil(needed)):
        if wall.enough:
            break
        place = {"z_mm": float(rng.uniform(0, bore.length_mm)), "theta_rad": float(rng.uniform(0, 2 * math.pi))}
        wall.take(holes[int(rng.integers(len(holes)))].model_copy(update=place))
    return wall.all_taken()


def _brought_to(hole: Cell, opening_mm: float) -> Cell:
    slant = math.sqrt(math.cos(hole.lean_rad))  # a leaning hole's opening is an ellipse
    share = math.log(hole.depth_mm / DEPTHS_MM[0]) / math.log(_deepest_mm(hole.diameter_mm / slant) / DEPTHS_MM[0])
    depth_mm = DEPTHS_MM[0] * (_deepest_mm(opening_mm) / DEPTHS_MM[0]) ** min(1.0, share)
    fill_mm = min(depth_mm, hole.fill_mm * depth_mm / hole.depth_mm)
    diameter_mm = max(LEAST_MM, opening_mm * slant)
    return hole.model_copy(update={"diameter_mm": diameter_mm, "depth_mm": depth_mm, "fill_mm": fill_mm})


def _deepest_mm(opening_mm: float) -> float:
    return min(DEPTHS_MM[1], DEEPEST * opening_mm)
