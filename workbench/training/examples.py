"""Examples with truth: bores of the simulator, recorded by its endoscope and unrolled like any recording."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch

from endoct.base.compute.parallel import Advance
from endoct.fusion.evidence.evidence import on_grid
from endoct.fusion.evidence.side import Side
from endoct.fusion.segmentation.learned.looking import inputs_of
from endoct.stitching.panorama import Panorama
from endoct.synthetic.bone.wall import build_wall
from endoct.synthetic.draw import draw
from endoct.synthetic.endoscope.camera import stored_frame
from endoct.synthetic.endoscope.lighting import lighting_of
from endoct.synthetic.sample.presets import PresetName
from endoct.synthetic.specimen_files import write_endoscope
from endoct.synthetic.truth import write_truth
from endoct.workbench.pipeline.truth import load_truth, true_cells, true_pose
from endoct.workbench.pipeline.unrolling import open_recording, unroll_recording
from endoct.workbench.running.progress import SilentStages
from endoct.workbench.training.variation import Example

PRESETS: tuple[PresetName, ...] = ("learning", "quick", "mastoid", "hard")
"""Bores take turns."""
FIRST_SEED = 7000


def bores(n: int) -> list[tuple[PresetName, int]]:
    """Return presets and seeds of ``n`` bores."""
    return [(PRESETS[k % len(PRESETS)], FIRST_SEED + k) for k in range(n)]


def examples_of(chosen: list[tuple[PresetName, int]], advance: Advance) -> Iterator[Example]:
    """Yield the examples of bores, one each, in their order."""
    for done, (preset, seed) in enumerate(chosen, 1):
        with TemporaryDirectory() as folder:
            yield _example(preset, seed, Path(folder))
        advance(done / len(chosen))


def _example(preset: PresetName, seed: int, folder: Path) -> Example:
    """Return the example of a bore, which is recorded in ``folder``."""
    sample = draw(preset, seed)
    wall = build_wall(sample)
    maps = wall.maps()
    lighting = lighting_of(sample, maps)
    frames = (stored_frame(sample, maps, lighting, k) for k in range(len(sample.endoscope.z_mm)))
    write_endoscope(folder / "endoscope", sample, frames)
    write_truth(folder / "truth", sample, wall)
    panorama = unroll_recording(open_recording(folder / "endoscope"), SilentStages()).panorama
    truth = load_truth(folder)
    return example_of(panorama, true_cells(truth, true_pose(panorama, truth), panorama))


def example_of(panorama: Panorama, cell: np.ndarray) -> Example:
    """Return what the network is given of ``panorama``, and its true cells; ``cell``, bool (n_z, n_theta)."""
    side = Side(panorama.modality, panorama)
    darkness = side.contrast("dark")
    inputs = inputs_of(darkness, side.parallax)
    truth = replace(darkness, values=cell.astype(np.float32), valid=np.ones(cell.shape, np.bool_))
    share = on_grid(truth, inputs.z_mm, inputs.channels.shape[2]).values
    return Example(torch.from_numpy(inputs.channels), torch.from_numpy(share))
