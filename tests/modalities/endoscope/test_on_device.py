"""Strips of frames by torch against the reference, on torch's CPU device."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from tolerances import ON_DEVICE_LIGHT_REL

from endoct.modalities.contract import Frame, FrameStream
from endoct.modalities.endoscope.calibration import EndoscopeCalibration
from endoct.modalities.endoscope.plugin import ENDOSCOPE, EndoscopeModality
from endoct.modalities.recognition import open_recording

ON_TORCH = EndoscopeModality().on_device("cpu")
Surveyed = tuple[FrameStream, EndoscopeCalibration]


@pytest.fixture(scope="module")
def surveyed(quick_specimen: Path) -> Surveyed:
    _, stream = open_recording(quick_specimen / "endoscope")
    return stream, ENDOSCOPE.survey(stream, ENDOSCOPE.parameters())


def assert_same(frame: Frame, calibration: EndoscopeCalibration, least: float, most: float) -> None:
    """Assert that torch makes the same strip, of which a share between ``least`` and ``most`` is valid."""
    expected, found = ENDOSCOPE.unroll(frame, calibration), ON_TORCH.unroll(frame, calibration)
    assert found.intensity.dtype == expected.intensity.dtype
    np.testing.assert_array_equal(found.valid, expected.valid)
    assert least < expected.valid.mean() < most
    np.testing.assert_allclose(found.intensity, expected.intensity, rtol=ON_DEVICE_LIGHT_REL)
    np.testing.assert_array_equal(found.weight, expected.weight)


def test_every_frame_is_the_same(surveyed: Surveyed) -> None:
    stream, calibration = surveyed
    for i in range(0, len(stream), 5):
        assert_same(stream[i], calibration, 0.9, 1)


def test_so_it_is_where_pixels_are_saturated_or_outside_the_image(surveyed: Surveyed) -> None:
    stream, calibration = surveyed
    samples = stream[3].samples.copy()
    samples[::40, 100:300] = 255
    frame = Frame(3, samples, stream[3].z_mm)
    assert_same(frame, calibration, 0.5, 0.95)
    assert_same(frame, replace(calibration, shift_px=(60.3, 150.8)), 0.2, 0.9)


def test_so_it_is_under_dirt_across_the_seam_and_by_another_exposure(surveyed: Surveyed) -> None:
    stream, calibration = surveyed
    usable = calibration.flat.usable.copy()
    usable[5:20, :30] = usable[10:30, -17:] = usable[:, 400:420] = False
    log_light = calibration.flat.log_light - np.float32(0.5) * ~usable
    flat = replace(calibration.flat, usable=usable, log_light=log_light)
    exposure = calibration.exposure + 0.3
    assert_same(stream[3], replace(calibration, flat=flat, exposure=exposure), 0.5, 0.95)


def test_memory_of_the_device_that_runs_out_is_that(surveyed: Surveyed, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> torch.Tensor:
        raise torch.OutOfMemoryError("CUDA out of memory")

    stream, calibration = surveyed
    monkeypatch.setattr(torch, "from_numpy", full)
    with pytest.raises(MemoryError, match="device cpu"):
        ON_TORCH.unroll(stream[3], calibration)
