"""Videos as the simulator writes them."""

import time
from pathlib import Path

import av
import numpy as np
import pytest

from endoct.base.errors import EndoctError
from endoct.modalities.reading.recording import open_stack
from endoct.synthetic.specimen_files import FRAME_RATE_HZ, write_video

FRAMES = np.random.default_rng(8).integers(0, 256, (7, 48, 64, 3), dtype=np.uint8)


@pytest.mark.parametrize("frames", [FRAMES, FRAMES[..., 0]], ids=["colour", "grey"])
def test_a_video_holds_the_very_frames_and_the_same_bytes_each_time(frames: np.ndarray, tmp_path: Path) -> None:
    write_video(tmp_path / "a.mkv", frames)
    time.sleep(1.1)  # a date in the file would differ
    write_video(tmp_path / "b.mkv", iter(list(frames)))
    assert (tmp_path / "a.mkv").read_bytes() == (tmp_path / "b.mkv").read_bytes()
    stack = open_stack(tmp_path / "a.mkv")
    assert len(stack) == len(frames)
    for index in (5, 0, 6, 2):
        np.testing.assert_array_equal(stack[index], frames[index])
    with av.open(str(tmp_path / "a.mkv")) as container:
        assert container.streams.video[0].average_rate == FRAME_RATE_HZ
        assert all(frame.key_frame for frame in container.decode(video=0)), "any frame is found without others"


def test_what_cannot_be_written_is_told(tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match="without frames"):
        write_video(tmp_path / "none.mkv", [])
    with pytest.raises(EndoctError, match="frame 1 does not fit"):
        write_video(tmp_path / "odd.mkv", [FRAMES[0], FRAMES[1, :32]])
    with pytest.raises(EndoctError, match="cannot be written"):
        write_video(tmp_path / "no" / "folder.mkv", FRAMES)
