"""Frames kept without the colours that nobody looks at."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from endoct.modalities.contract import Frame
from endoct.modalities.endoscope.green import full_scale_of, green_frames
from endoct.modalities.endoscope.manifest import EndoscopeAcquisition
from endoct.modalities.endoscope.opening import open_frames


class Colours:
    """A stream of frames in colour, or in grey, that counts how often each is read; red needs one bit more."""

    def __init__(self, *, grey: bool) -> None:
        self.read, self.grey = [0] * 3, grey

    @property
    def acquisition(self) -> EndoscopeAcquisition:
        pytest.fail("what is kept of a frame does not depend on the sidecar")

    def __len__(self) -> int:
        return len(self.read)

    def __getitem__(self, index: int) -> Frame:
        self.read[index] += 1
        samples = np.full((40, 50, 3), (2000, 900 + index, 7), np.uint16)
        return Frame(index, samples[..., 1] if self.grey else samples, 0.2 * index)


@pytest.mark.parametrize("grey", [False, True])
def test_a_frame_is_read_once_and_its_green_kept_with_the_full_scale_of_all(grey: bool) -> None:
    stream = Colours(grey=grey)
    with green_frames(stream) as once:
        for index in (2, 0, 2, 1, 0):
            frame = once[index]
            assert (frame.index, frame.z_mm) == (index, 0.2 * index)
            assert full_scale_of(frame) == full_scale_of(Colours(grey=grey)[index]) == (1023 if grey else 4095)
            np.testing.assert_array_equal(frame.samples, np.full((40, 50), 900 + index, np.uint16))
    assert stream.read == [1, 1, 1]


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_frames_of_a_recording_are_those_of_its_green(tmp_path: Path, dtype: type) -> None:
    rng = np.random.default_rng(3)
    for k in range(3):
        cv2.imwrite(str(tmp_path / f"frame_{k}.png"), rng.integers(0, 200, (40, 50, 3)).astype(dtype))
    acquisition = EndoscopeAcquisition(
        modality="endoscope", bore_diameter_mm=3.0, feed_pitch_mm=0.2, visible_length_mm=1.0, travel="out"
    )
    recording = open_frames(tmp_path, acquisition)
    with green_frames(recording) as once:
        for index in (2, 0, 1, 2):
            whole, kept = recording[index], once[index]
            assert (kept.index, kept.z_mm, full_scale_of(kept)) == (index, whole.z_mm, full_scale_of(whole))
            assert kept.samples.dtype == dtype
            np.testing.assert_array_equal(kept.samples, whole.samples[..., 1])
