"""Frames kept without the colours that nobody looks at."""

import numpy as np
import pytest

from endoct.modalities.contract import Frame
from endoct.modalities.endoscope.light import full_scale_of, green_frames
from endoct.modalities.endoscope.manifest import EndoscopeAcquisition


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
