"""Slices warped onto each other by their A-scans."""

from dataclasses import dataclass

import numpy as np

from endoct.modalities.contract import Frame
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.workbench.bench.rivals import ascans


@dataclass
class _Turned:
    """A pullback of one slice, the second time seen by a catheter that was ahead by up to 6° halfway through."""

    acquisition: OctAcquisition

    def __len__(self) -> int:
        return 2

    def __getitem__(self, index: int) -> Frame:
        random = np.random.default_rng(0)
        turn = 2 * np.pi * np.arange(360) / 360 + index * ahead_rad()
        waves = [random.normal(size=(80, 2)) @ np.stack([np.cos(k * turn), np.sin(k * turn)]) for k in range(1, 20)]
        return Frame(index, (100 + 20 * np.sum(waves, axis=0)).T.astype(np.float32), 0.2 * index)


def ahead_rad() -> np.ndarray:
    turn = 2 * np.pi * np.arange(360) / 360
    return np.deg2rad(6) * np.sin(turn / 2) ** 2


def test_a_slice_is_warped_onto_the_same_one_seen_before() -> None:
    sizes = {"axial_pixel_mm": 0.005, "pullback_pitch_mm": 0.2, "bore_diameter_mm": 2.5}
    stream = _Turned(OctAcquisition(modality="oct", intensity="log", capillary_outer_diameter_mm=1.7, **sizes))
    errors = ascans.warped_errors_rad(stream)
    true = ahead_rad() - ahead_rad().mean()
    assert not errors[0].any()
    assert np.abs(errors[1] - true).max() < np.deg2rad(1.2)  # an A-scan is 1°
