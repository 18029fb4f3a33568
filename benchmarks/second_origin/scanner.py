"""A CT scanner of its own: an edge-enhancing kernel on a turned lattice, bone that is uneven, noise with streaks."""

import numpy as np
from numpy.random import Generator
from scipy import ndimage

from benchmarks.second_origin.bone import REACH_MM, Bone, Floats, frame
from endoct.modalities.ct.ct_volume import CtVolume

FINER = 2
AIR_HU = -1010.0
ENHANCED, WIDER = 0.35, 3.0
"""By how much the kernel lifts edges, over a blur as many times wider."""


def scanned(bone: Bone, bore: Floats, length_mm: float, noise_hu: float, rng: Generator) -> CtVolume:
    """Return the CT of the bone around a bore (4, 4), before drilling, with noise of that rms."""
    steps = _steps(rng)
    ends = bore[:3, 3] + np.array([[0.0], [length_mm]]) * bore[:3, 2]
    along = ends @ np.linalg.inv(steps)
    reach = REACH_MM / np.linalg.norm(steps, axis=1)
    low, high = along.min(axis=0) - reach, along.max(axis=0) + reach
    shape = np.ceil(high - low).astype(int)
    fine_steps = steps / FINER
    origin = low @ steps
    k, j, i = (np.arange(n * FINER) - (FINER - 1) / 2 for n in shape[::-1])
    share = np.empty((k.size, j.size, i.size), np.float32)
    plane = j[:, None, None] * fine_steps[1] + i[:, None] * fine_steps[0] + origin
    for row, at in enumerate(k):
        share[row] = bone.share(plane + at * fine_steps[2])
    fine_mm = np.linalg.norm(fine_steps, axis=1)[::-1]
    texture = ndimage.gaussian_filter(rng.standard_normal(share.shape, dtype=np.float32), 0.9 / fine_mm)
    solid = rng.uniform(1000, 1900) * (1 + 0.08 * texture / texture.std())
    hu = (solid + share * (AIR_HU - solid)).astype(np.float32)
    sigma = rng.uniform(0.4, 0.7) / 2.355 / fine_mm
    hu = ndimage.gaussian_filter(hu, sigma)
    hu += np.float32(ENHANCED) * (hu - ndimage.gaussian_filter(hu, WIDER * sigma))
    voxels = hu.reshape(shape[2], FINER, shape[1], FINER, shape[0], FINER).mean(axis=(1, 3, 5))
    voxels += noise_hu * _noise(voxels.shape, rng)
    return CtVolume(np.clip(np.rint(voxels), -1024, 3071).astype(np.int16), origin, steps[::-1], "lps", "second origin")


def _steps(rng: Generator) -> Floats:
    """Return the steps along i, j and k as rows: 0.25 to 0.35 mm in the slices, a little more between them."""
    turned = frame(np.zeros(3), rng)[:3, :3].T
    across = rng.uniform(0.25, 0.35)
    return np.asarray(turned * np.array([across, across, rng.uniform(1.0, 1.3) * across])[:, None])


def _noise(shape: tuple[int, ...], rng: Generator) -> Floats:
    """Return noise of rms 1: fine in the slices, half of its variance in streaks."""
    fine = ndimage.gaussian_filter(rng.standard_normal(shape, dtype=np.float32), (0.4, 0.7, 0.7))
    streaks = ndimage.gaussian_filter(rng.standard_normal(shape, dtype=np.float32), (0.4, 0.5, 3.0))
    both = fine / fine.std() + streaks / streaks.std()
    return np.asarray(both / both.std())
