"""Whether values look like Hounsfield units of a head: air near −1000, bone above 300, slices that differ."""

import hashlib
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.doubt import Doubt

LEAST_HU = -500.0
"""A volume that holds values below this has Hounsfield units."""
BONE_HU = 300.0
MOST_HU = 3100.0
"""Bone is not brighter than this; scales of 12 bits end below it."""
LEAST_BONE = 1e-4
"""Least share of the voxels that is bone."""
DARKEST_HU, DARK_SHARE, FEWEST_DARK = -850.0, 0.1, 10
"""The darkest tenth of the air reaches down to this. In cells of a mastoid most voxels hold some bone."""
AIR_HU = (-1100.0, -600.0)
"""Most of what is darker than the second lies above the first, and is air. Scanners differ by 24 HU or more."""
TOO_LOW_HU, MOST_TOO_LOW = -1400.0, 0.005
"""No tissue is darker than the first. Noise and metal are, in no more than the second share of the voxels."""
PEAKED, WIDTH_HU = 0.6, 100.0
"""Of the air, more than the first share lies within the second of one value. Bone does not."""
PERHAPS = "Its values may be shifted or inverted."
SAMPLE = 4_000_000
MOST_COPIES = 0.1
"""Where a larger share of the slices than this is the same, it is a phantom."""


def hounsfield_doubts(voxels: NDArray[Any], name: str) -> tuple[Doubt, ...]:
    """Return what speaks against values (k, j, i) as Hounsfield units of the CT called ``name``."""
    flat = voxels.reshape(-1)
    some = flat[:: max(1, flat.size // SAMPLE)].astype(np.float32)
    padding = float(voxels.min())
    inside = some[some > padding] if padding < AIR_HU[0] else some  # what was never seen has one value
    return (*_of_values(inside, name), *_of_copies(voxels, name))


def _of_values(values: NDArray[np.float32], name: str) -> Iterator[Doubt]:
    if not values.size:
        return
    too_low = float(np.mean(values < TOO_LOW_HU))
    air = values[values < AIR_HU[1]]
    usual = float(np.median(air)) if air.size else 0.0
    darkest = float(np.quantile(air, DARK_SHARE)) if air.size >= FEWEST_DARK else float(values.min())
    bone = float(np.mean(values > BONE_HU))
    if too_low > MOST_TOO_LOW or usual < AIR_HU[0]:
        said = f"{too_low:.1%} of {name} is darker than {TOO_LOW_HU:g} HU, and its air at {usual:.0f}. {PERHAPS}"
        yield Doubt("ct-values-too-low", _signed(said), value=usual, unit="HU", expected=AIR_HU)
    if darkest > DARKEST_HU:
        said = f"Nothing in {name} is as dark as air, −1000 HU: the darkest is at {darkest:.0f}. {PERHAPS}"
        yield Doubt("ct-no-air", _signed(said), value=darkest, unit="HU", expected=(AIR_HU[0], DARKEST_HU))
    bright = values[values > BONE_HU]
    if bright.size and _near(bright, 1000) > PEAKED > (_near(air, -1000) if air.size else 0):
        said = f"What is bright in {name} is nearly all at 1000 HU, as air is at −1000. {PERHAPS}"
        yield Doubt("ct-values-inverted", said, value=float(np.median(bright)), unit="HU")
    if bone < LEAST_BONE:
        said = f"Nothing in {name} is as bright as bone, over {BONE_HU:g} HU. {PERHAPS}"
        yield Doubt("ct-no-bone", said, value=float(values.max()), unit="HU", expected=None)


def _near(values: NDArray[np.float32], at: float) -> float:
    return float(np.mean(np.abs(values - np.float32(at)) < WIDTH_HU))


def _of_copies(voxels: NDArray[Any], name: str) -> Iterator[Doubt]:
    at: dict[bytes, list[int]] = {}
    for k, slice_ in enumerate(voxels):
        if slice_.min() < slice_.max():
            at.setdefault(hashlib.blake2b(slice_.tobytes(), digest_size=16).digest(), []).append(k)
    copies = [places for places in at.values() if len(places) > 1]
    count = sum(len(places) - 1 for places in copies)
    if 0 < count <= max(1, MOST_COPIES * sum(map(len, at.values()))):
        first, second = copies[0][:2]
        said = f"Slices {first + 1} and {second + 1} of {name} are the same to the last voxel: one may be a copy."
        yield Doubt("ct-slices-copied", said, value=float(count), unit="slices", expected=0.0)


def _signed(text: str) -> str:
    return text.replace(" -", " −")
