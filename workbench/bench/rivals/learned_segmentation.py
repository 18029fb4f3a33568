"""Find cells with classifiers that learned from walls with truth: a random forest, and endoct's own eye alone.

The forest works as the trainable segmentation of ilastik (Berg et al. 2019) and Weka (Arganda-Carreras et al. 2017).
Filters of several widths describe every sample, and scikit-learn's forest votes. When first called, it learns from toy
walls of the tuning seeds: one forest for depth, one for brightness. It is the same forest on every machine.
"""

from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Image, Mask
from endoct.base.numeric.circle import gaussian, masked_gaussian
from endoct.fusion.evidence.evidence import clipped, prepare
from endoct.fusion.evidence.side import Side
from endoct.fusion.segmentation.by_eye import cells_by_eye, view_of
from endoct.fusion.segmentation.cleaning import clean
from endoct.fusion.segmentation.parameters import SegmentParameters
from endoct.stitching.panorama import Panorama
from endoct.workbench.bench.cases.toy_walls import RANGES, toy_panorama
from endoct.workbench.bench.task import Declined, NotInstalled, draw

SEEDS = range(0, 100, 2)
SAMPLES_OF_A_WALL = 400
WIDTHS_MM = (0.01, 0.02, 0.04, 0.08, 0.16, 0.32)
TREES, LEAST_IN_LEAF = 40, 10


def random_forest(panorama: Panorama) -> Mask:
    """Return the cells of most votes of a forest that learned from toy walls, cleaned as ours, bool (n_z, n_theta).

    Raises :class:`NotInstalled` without scikit-learn.
    """
    forest = _forest("intensity" if panorama.depth_mm is None else "depth")
    evidence, p = prepare(panorama), SegmentParameters()
    mask = np.zeros(panorama.grid.shape, np.bool_)
    mask[evidence.valid] = forest.predict_proba(_features(panorama)[evidence.valid])[:, 1] > 0.5
    return clean(mask, evidence.dz_mm, evidence.column_mm, p) & evidence.valid


def learned_eye(panorama: Panorama) -> Mask:
    """Return what endoct's learned eye takes for cells, sure or not, bool (n_z, n_theta).

    Raises :class:`Declined` where there is no eye for such panoramas, or they are too coarse for it.
    """
    parameters = SegmentParameters()
    view = view_of(Side(panorama.modality, panorama), parameters) if panorama.depth_mm is None else None
    if view is None:
        raise Declined("no eye was trained for such panoramas")
    return cells_by_eye(view, parameters)[0].mask


@cache
def _forest(modality: str) -> Any:
    """Return scikit-learn's classifier, trained on toy walls of a ``modality``, "depth" or "intensity"."""
    try:
        from sklearn.ensemble import RandomForestClassifier
    except ImportError as error:
        raise NotInstalled("scikit-learn") from error
    features, cells = (np.concatenate(parts) for parts in zip(*_lessons(modality), strict=True))
    forest = RandomForestClassifier(TREES, min_samples_leaf=LEAST_IN_LEAF, random_state=0, n_jobs=1)
    return forest.fit(features, cells)


def _lessons(modality: str) -> Iterator[tuple[NDArray[np.float32], NDArray[np.bool_]]]:
    """Yield features and truth of some samples of every wall to learn from, as many of cells as of the rest."""
    for seed in SEEDS:
        drawn = {name: float(value) for name, value in draw(seed, 0, RANGES).items()}
        panorama, cell = toy_panorama(seed, 0, modality, drawn)
        features, random = _features(panorama), np.random.default_rng(seed)
        for of_cell in (True, False):
            samples = np.flatnonzero(panorama.valid & (cell == of_cell))
            some = random.choice(samples, min(samples.size, SAMPLES_OF_A_WALL // 2), replace=False)
            yield features.reshape(-1, features.shape[-1])[some], np.full(some.size, of_cell)


def _features(panorama: Panorama) -> NDArray[np.float32]:
    """Return what describes every sample, float32 (n_z, n_theta, n): filters on the circle, widths in mm.

    At each width these are the smoothed evidence, how much it varies, and its slope. Where there is depth, the
    brightness is described too. The noise of the whole wall follows for each.
    """
    evidence = clipped(prepare(panorama))
    images = [evidence.values]
    if panorama.depth_mm is not None:
        brightness = panorama.intensity - np.median(panorama.intensity[panorama.valid])
        images.append(np.where(panorama.valid, brightness, 0).astype(np.float32))
    valid, described = evidence.valid, []
    for image in images:
        for width_mm in WIDTHS_MM:
            sigmas = width_mm / evidence.dz_mm, width_mm / evidence.column_mm
            smooth = masked_gaussian(image, valid, *sigmas)
            spread = masked_gaussian((image - smooth) ** 2, valid, *sigmas)
            described += [smooth, np.sqrt(spread), _slope(smooth, sigmas)]
        noise = np.median(np.abs(np.diff(image, axis=1))[valid[:, 1:]])
        described.append(np.full(image.shape, noise, np.float32))
    return np.stack(described, axis=-1).astype(np.float32)


def _slope(image: Image, sigmas: tuple[float, float]) -> Image:
    """Return the length of the gradient of a smooth image per width of its smoothing."""
    wider = gaussian(image, *sigmas)
    down = np.gradient(wider, axis=0) * sigmas[0]
    around = (np.roll(wider, -1, axis=1) - np.roll(wider, 1, axis=1)) / 2 * sigmas[1]
    return np.asarray(np.hypot(down, around), dtype=np.float32)
