"""Simulated specimens and folders of the user's own as cases."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import cast

import numpy as np

from endoct.base.arrays import Mask
from endoct.base.errors import EndoctError
from endoct.base.files.scratch import TemporaryFolder
from endoct.fusion.geometry.placement import IN_PLACE, Placement, check_same_bore
from endoct.modalities.reading.recording import IMAGE_SUFFIXES
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import is_panorama, load_panorama
from endoct.synthetic.sample.presets import PRESETS, PresetName
from endoct.synthetic.sample.ranges import PARTS, choices, default_ranges
from endoct.workbench.bench.task import Range
from endoct.workbench.pipeline.truth import load_truth, true_cells, true_pose

PRESET_WORDS: tuple[str, ...] = tuple(PRESETS)
MODALITIES: Sequence[str] = ("oct", "endoscope")

DIFFICULTIES: Mapping[str, Range] = {
    **{f"{part}.{name}": range_ for part, model in PARTS.items() for name, range_ in default_ranges(model).items()},
    **{f"{part}.{name}": words for part, model in PARTS.items() for name, words in choices(model).items()},
}
"""What ``endoct simulate --vary`` takes: a simulated specimen can differ in it, by default within these ranges."""


def simulated(
    preset: str, seed: int, index: int, difficulties: Mapping[str, float | str] | None = None, *, ct: bool = False
) -> TemporaryFolder:
    """Return a temporary folder with one specimen; the first of a seed is that of ``endoct simulate --seed``.

    ``ct``: with a CT of it, ``truth/ct.nii.gz``.
    """
    from endoct.synthetic.specimen import simulate

    ranges: dict[str, Range] = {
        name: (value,) if isinstance(value, str) else (float(value), float(value))
        for name, value in (difficulties or {}).items()
    }
    folder = TemporaryFolder("bench")
    try:
        of = seed if index == 0 else 1_000_000 * (1 + seed) + index
        simulate(Path(folder.name) / "specimen", preset=cast(PresetName, preset), seed=of, ranges=ranges, ct=ct)
    except BaseException:
        folder.cleanup()
        raise
    return folder


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
