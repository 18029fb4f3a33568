"""How one would align two panoramas with a learned matcher: kornia's LoFTR (Sun 2021).

Its weights come from a file that the user names in an environment variable; nothing is fetched. As the rivals by
features of OpenCV do, it sees A continued around by half a turn at either end. Either polarity of B is tried, and
RANSAC fits a similarity to the matches.
"""

import os
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from endoct.base.arrays import Coordinates, Image
from endoct.base.errors import EndoctError
from endoct.base.files.files import open_regular
from endoct.fusion.geometry.alignment import Alignment, NotAligned
from endoct.stitching.panorama import Panorama
from endoct.workbench.bench.rivals.alignment import Matched, best_of, by_matches
from endoct.workbench.bench.task import NotInstalled

LOFTR_WEIGHTS, LOFTR_PX = "ENDOCT_LOFTR_WEIGHTS", 4
"""Pixels in samples of A: it was not trained on images as large as the panoramas."""


def loftr(a: Panorama, b: Panorama) -> Alignment | NotAligned:
    """LoFTR's matches, without a detector."""
    weights = _weights()
    import torch
    from kornia.feature import LoFTR

    model = _loaded(LoFTR(pretrained=None), weights)

    def whole(image: Image) -> Any:  # multiples of eight, as LoFTR wants it
        rows, columns = (size // 8 * 8 for size in image.shape)
        return torch.from_numpy(np.ascontiguousarray(image[:rows, :columns]))[None, None]

    def match(image_b: Image, image_a: Image) -> Matched:
        with torch.inference_mode():
            matches = model({"image0": whole(image_b), "image1": whole(image_a)})
        return _points(matches["keypoints0"]), _points(matches["keypoints1"])

    return best_of(a, b, by_matches(lambda image_a: partial(match, image_a=image_a)), LOFTR_PX)


def _weights() -> Any:
    """Return the weights in the file that the environment variable names.

    Raises :class:`NotInstalled` where none is named, :class:`EndoctError` where it cannot be read.
    """
    path = os.environ.get(LOFTR_WEIGHTS)
    if not path:
        raise NotInstalled("the file of LoFTR's weights", f"set {LOFTR_WEIGHTS} to its path")
    import torch

    try:
        with open_regular(Path(path)) as file:
            weights = torch.load(file, map_location="cpu", weights_only=True)
    except Exception as error:
        raise EndoctError(
            "the weights of a matcher cannot be read",
            found=f"{path}: {' '.join(str(error).split())[:100]}",
            expected="a file of torch.save that holds tensors only",
            remedy=f"set {LOFTR_WEIGHTS} to such a file",
        ) from error
    return weights.get("state_dict", weights)


def _loaded(model: Any, weights: Any) -> Any:
    try:
        model.load_state_dict(weights)
    except (RuntimeError, TypeError, AttributeError) as error:
        raise EndoctError(
            "these are weights of another network",
            found=" ".join(str(error).split())[:100],
            expected=f"those of {type(model).__name__}",
            remedy=f"set {LOFTR_WEIGHTS} to their file",
        ) from error
    return model.eval()


def _points(keypoints: Any) -> Coordinates:
    return np.asarray(keypoints.numpy(), np.float64)
