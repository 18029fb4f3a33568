"""How one would align two panoramas with learned matchers: kornia's DISK (Tyszkiewicz 2020) and LoFTR (Sun 2021).

Their weights come from a file that the user names in an environment variable; nothing is fetched. As the rivals by
features of OpenCV do, they see A continued around by half a turn at either end. Either polarity of B is tried, and
RANSAC fits a similarity to the matches.
"""

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from endoct.base.arrays import Coordinates, Image
from endoct.base.errors import EndoctError
from endoct.base.files.files import open_regular
from endoct.fusion.geometry.alignment import Alignment, NotAligned
from endoct.stitching.panorama import Panorama
from endoct.workbench.bench.rivals.alignment import FEWEST_MATCHES, NO_MATCHES, Matched, best_of, by_matches
from endoct.workbench.bench.task import NotInstalled

DISK_WEIGHTS, LOFTR_WEIGHTS = "ENDOCT_DISK_WEIGHTS", "ENDOCT_LOFTR_WEIGHTS"
DISK_PX, LOFTR_PX = 2, 4
"""Pixels in samples of A: neither was trained on images as large as the panoramas."""
FEATURES, RATIO = 4096, 0.95


def disk(a: Panorama, b: Panorama) -> Alignment | NotAligned:
    """DISK's features, matched both ways by kornia with Lowe's ratio."""
    weights = _weights(DISK_WEIGHTS, "the file of DISK's weights", "extractor")
    import torch
    from kornia.feature import DISK, match_smnn

    model = _loaded(DISK(), weights, DISK_WEIGHTS)

    def described(image: Image) -> Any:
        given = torch.from_numpy(image)[None, None].repeat(1, 3, 1, 1)
        with torch.inference_mode():
            return model(given, FEATURES, pad_if_not_divisible=True)[0]

    def matcher(image_a: Image) -> Callable[[Image], Matched]:
        of_a = described(image_a)

        def match(image_b: Image) -> Matched:
            of_b = described(image_b)
            if min(len(of_a.keypoints), len(of_b.keypoints)) < FEWEST_MATCHES:
                return NO_MATCHES
            with torch.inference_mode():
                _, pairs = match_smnn(of_b.descriptors, of_a.descriptors, RATIO)
            return _points(of_b.keypoints[pairs[:, 0]]), _points(of_a.keypoints[pairs[:, 1]])

        return match

    return best_of(a, b, by_matches(matcher), DISK_PX)


def loftr(a: Panorama, b: Panorama) -> Alignment | NotAligned:
    """LoFTR's matches, without a detector."""
    weights = _weights(LOFTR_WEIGHTS, "the file of LoFTR's weights", "state_dict")
    import torch
    from kornia.feature import LoFTR

    model = _loaded(LoFTR(pretrained=None), weights, LOFTR_WEIGHTS)

    def whole(image: Image) -> Any:  # multiples of eight, as LoFTR wants it
        rows, columns = (size // 8 * 8 for size in image.shape)
        return torch.from_numpy(np.ascontiguousarray(image[:rows, :columns]))[None, None]

    def match(image_b: Image, image_a: Image) -> Matched:
        with torch.inference_mode():
            matches = model({"image0": whole(image_b), "image1": whole(image_a)})
        return _points(matches["keypoints0"]), _points(matches["keypoints1"])

    return best_of(a, b, by_matches(lambda image_a: partial(match, image_a=image_a)), LOFTR_PX)


def _weights(variable: str, of: str, part: str) -> Any:
    """Return the weights in the file that an environment variable names, which may lie in a ``part`` of it.

    Raises :class:`NotInstalled` where none is named, :class:`EndoctError` where it cannot be read.
    """
    path = os.environ.get(variable)
    if not path:
        raise NotInstalled(of, f"set {variable} to its path")
    import torch

    try:
        with open_regular(Path(path)) as file:
            weights = torch.load(file, map_location="cpu", weights_only=True)
    except Exception as error:
        raise EndoctError(
            "the weights of a matcher cannot be read",
            found=f"{path}: {' '.join(str(error).split())[:100]}",
            expected="a file of torch.save that holds tensors only",
            remedy=f"set {variable} to such a file",
        ) from error
    return weights.get(part, weights)


def _loaded(model: Any, weights: Any, variable: str) -> Any:
    try:
        model.load_state_dict(weights)
    except (RuntimeError, TypeError, AttributeError) as error:
        raise EndoctError(
            "these are weights of another network",
            found=" ".join(str(error).split())[:100],
            expected=f"those of {type(model).__name__}",
            remedy=f"set {variable} to their file",
        ) from error
    return model.eval()


def _points(keypoints: Any) -> Coordinates:
    return np.asarray(keypoints.numpy(), np.float64)
