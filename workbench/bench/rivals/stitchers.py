"""How one would place the strips with a whole program for stitching: OpenCV's, m2stitch and multiview-stitcher.

These see θ as a circle, as every strip is continued by some columns at either end. What they take for a bad pair is "I
do not know". ``…_prepared`` get strips without what is the same in every strip and in every row, as ours does.
"""

import contextlib
import io
import warnings
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image
from endoct.base.numeric.circle import pad_circle
from endoct.stitching.strip import Strip
from endoct.workbench.bench.rivals.stitching import (
    UNKNOWN,
    Shift,
    grey,
    images_of_strips,
    of_images,
    poses_of,
    prepared,
    row_mm,
)
from endoct.workbench.bench.task import Declined, NotInstalled
from endoct.workbench.bench.tasks.stitching import StripPoses

AROUND = 32
"""Columns by which a strip is continued at either end."""
ENLARGED, LEAST_CONFIDENCE = 3, 0.3
"""OpenCV's features are as large as a strip of 64 rows, so strips are enlarged for them."""
LEAST_AREA = 0.3
"""OpenCV fits affine maps; one that shrinks a strip to less is none."""
M2_LEAST_CORRELATION, M2_UNCERTAIN_PERCENT, M2_FARTHEST_PERCENT = 0.1, 45.0, 60.0
LEAST_QUALITY = 0.55
"""Pairs are trusted above this rank correlation, by which multiview-stitcher judges its own."""


def opencv_scans_prepared(strips: Sequence[Strip], nominal_pitch_mm: float) -> StripPoses:
    """OpenCV: its stitcher for scans, on prepared strips, enlarged, continued around, pair after pair."""
    around = [pad_circle(image, AROUND) for image in grey(prepared(strips))]
    images = [cv2.resize(image, None, fx=ENLARGED, fy=ENLARGED, interpolation=cv2.INTER_CUBIC) for image in around]
    shifts = []
    for pair in pairwise(images):
        places = _scanned(pair)
        x, y = places[1] - places[0] if len(places) == 2 else (np.nan, np.nan)
        shifts.append((float(y), float(x), True) if np.isfinite([x, y]).all() else UNKNOWN)
    return poses_of(shifts, strips, nominal_pitch_mm)


def _scanned(images: Sequence[NDArray[Any]]) -> dict[int, Coordinates]:
    """Return (x, y) of the middle of every image that OpenCV's stitcher can place, px before they were enlarged."""
    cv2.setRNGSeed(0)
    stitcher = cv2.Stitcher.create(cv2.Stitcher_SCANS)
    stitcher.setRegistrationResol(-1)
    stitcher.setPanoConfidenceThresh(LEAST_CONFIDENCE)
    try:
        if stitcher.estimateTransform([cv2.merge([image] * 3) for image in images]) != cv2.Stitcher_OK:
            return {}
    except cv2.error:  # of maps that cannot be inverted
        return {}
    middle = np.array([images[0].shape[1] / 2, images[0].shape[0] / 2, 1.0])
    places = {}
    for k, camera in zip(np.asarray(stitcher.component()).ravel(), stitcher.cameras(), strict=True):
        to_image = np.asarray(camera.R, np.float64)
        if np.isfinite(to_image).all() and LEAST_AREA < abs(np.linalg.det(to_image)) < 1 / LEAST_AREA:
            places[int(k)] = (np.linalg.inv(to_image) @ middle)[:2] / ENLARGED
    return places


def m2stitch_prepared(strips: Sequence[Strip], nominal_pitch_mm: float) -> StripPoses:
    """m2stitch (Fukai 2022), which is MIST (Chalfoun et al. 2017) in Python, on prepared strips.

    MIST is for grids of tiles with neighbours on two sides, so every strip is cut into two halves that overlap.
    """
    try:
        with _quiet():
            import m2stitch
    except ImportError as error:
        raise NotInstalled("m2stitch") from error
    images, rows = prepared(strips), nominal_pitch_mm / row_mm(strips)
    if rows < 0:  # it wants the first tile on top
        images = images[::-1]
    n, half = len(images), images.shape[2] // 2
    around = pad_circle(images, AROUND)
    tiles = np.stack([around[:, :, first : first + half + 2 * AROUND] for first in (0, half)], axis=1)
    index = np.stack(np.meshgrid(np.arange(n), [0, 1], indexing="ij"), axis=-1).reshape(-1, 2)
    try:
        with _quiet():
            grid, _ = m2stitch.stitch_images(
                tiles.reshape(2 * n, *tiles.shape[2:]),
                position_indices=index,
                position_initial_guess=index * [abs(rows), half],
                overlap_diff_threshold=M2_FARTHEST_PERCENT,
                pou=M2_UNCERTAIN_PERCENT,
                ncc_threshold=M2_LEAST_CORRELATION,
                full_output=True,
                row_col_transpose=False,
            )
    except AssertionError as error:
        raise Declined(f"m2stitch gave up: {error}") from error
    places = grid[["y_pos", "x_pos"]].to_numpy(np.float64).reshape(n, 2, 2).mean(axis=1)
    sure = grid["top_valid3"].to_numpy(np.bool_).reshape(n, 2)[1:].any(axis=1)
    shifts = np.diff(places, axis=0)
    if rows < 0:
        shifts, sure = -shifts[::-1], sure[::-1]
    known = [(float(y), float(x), bool(is_known)) for (y, x), is_known in zip(shifts, sure, strict=True)]
    return poses_of(known, strips, nominal_pitch_mm)


def _multiview_stitcher(images: Image, strips: Sequence[Strip], nominal_pitch_mm: float) -> StripPoses:
    """Register neighbours where the nominal pitch lets them overlap, and place them one by one (Albert 2024)."""
    try:
        with _quiet():
            import dask
            from multiview_stitcher import msi_utils, registration, spatial_image_utils
    except ImportError as error:
        raise NotInstalled("multiview-stitcher") from error
    rows, key = nominal_pitch_mm / row_mm(strips), "nominal"
    views = []
    for k, image in enumerate(images):
        view = spatial_image_utils.get_sim_from_array(
            pad_circle(image, AROUND),
            dims=["y", "x"],
            scale={"y": 1.0, "x": 1.0},
            translation={"y": k * rows, "x": 0.0},
            transform_key=key,
        )
        views.append(msi_utils.get_msim_from_sim(view, scale_factors=[]))
    pairs = [(k, k + 1) for k in range(len(views) - 1)]
    with _quiet(), dask.config.set(scheduler="single-threaded"):
        found = registration.register(
            views,
            transform_key=key,
            new_transform_key="registered",
            reg_channel_index=0,
            pairs=pairs,
            pre_registration_pruning_method=None,
            groupwise_resolution_method="shortest_paths",
            return_dict=True,
        )
    quality = found["pairwise_registration"]["metrics"]["qualities"]
    moved = np.array([np.asarray(each, np.float64).reshape(3, 3)[:2, 2] for each in found["params"]])
    shifts: list[Shift] = [
        (rows + float(y), float(x), float(np.ravel(quality[pair])[0]) > LEAST_QUALITY)
        for (y, x), pair in zip(np.diff(moved, axis=0), pairs, strict=True)
    ]
    return poses_of(shifts, strips, nominal_pitch_mm)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep progress bars and warnings of libraries to themselves."""
    with warnings.catch_warnings(), contextlib.redirect_stderr(io.StringIO()):
        warnings.simplefilter("ignore")
        yield


multiview_stitcher = of_images(images_of_strips, _multiview_stitcher)
multiview_stitcher_prepared = of_images(prepared, _multiview_stitcher)
