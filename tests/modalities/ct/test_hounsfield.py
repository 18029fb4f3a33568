"""Values that are no Hounsfield units are doubted: shifted, inverted, without air or bone; so is a slice's copy."""

import numpy as np
import pytest

from endoct.modalities.ct.hounsfield import hounsfield_doubts

NOISE = np.random.default_rng(7)


def head(noise_hu: float = 60.0, bone_hu: tuple[float, float] = (4.0, 250.0), air: float = 0.3) -> np.ndarray:
    """Return values as of a CT of a temporal bone: air, tissue, bone that differs from place to place."""
    shape = 20, 40, 40
    kind = NOISE.random(shape)
    bone = NOISE.gamma(*bone_hu, shape) + 300
    values = np.where(kind < air, -1000, np.where(kind < 0.7, 40, bone)) + NOISE.normal(0, noise_hu, shape)
    return np.clip(np.rint(values), -1024, 3071).astype(np.int16)


def codes(values: np.ndarray) -> set[str]:
    return {doubt.code for doubt in hounsfield_doubts(values.astype(np.int16), "ct")}


@pytest.mark.parametrize("noise_hu", [5, 60, 150])
def test_a_ct_is_not_doubted(noise_hu: float) -> None:
    values = head(noise_hu)
    assert codes(values) == set()
    padded = values.copy()
    padded[:, :6] = -2048  # what a scanner writes outside of what it saw
    assert codes(padded) == set()
    metal = values.copy()
    metal[3, 4:6, 4:10] = -1900
    assert codes(metal) == set()
    assert codes(head(noise_hu, air=0.004)) == set()


@pytest.mark.parametrize("shift", [-1000, -1024, -400, 300])
def test_a_shift_is_doubted(shift: int) -> None:
    assert codes(head().astype(np.int32) + shift)


def test_inverted_values_are_doubted() -> None:
    assert codes(-head().astype(np.int32))
    assert codes(-head(20, (25.0, 28.0)).astype(np.int32))  # bone as narrow as air, where air would be


def test_bone_is_missed() -> None:
    assert codes(np.minimum(head(), 200)) == {"ct-no-bone"}


def test_a_copy_of_a_slice_is_doubted_and_a_phantom_is_not() -> None:
    values = head()
    values[7] = values[12]
    assert codes(values) == {"ct-slices-copied"}
    assert codes(np.repeat(head()[:1], 20, axis=0)) == set()
    values = head()
    values[:3] = -1000  # nothing in them
    assert codes(values) == set()
