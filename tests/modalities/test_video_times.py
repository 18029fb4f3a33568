"""When the frames of a video were taken: lost frames, edit lists, frames that were dropped; what is whole is read."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from benchmarks.frame_faults.drawn import RATE_HZ
from benchmarks.frame_faults.videos import with_edits, write_video
from endoct.base.errors import EndoctError
from endoct.modalities.reading.recording import open_stack
from endoct.modalities.reading.video_container import is_cut_off
from endoct.modalities.reading.video_index import index_of

N = 12
FRAMES = np.random.default_rng(0).integers(0, 256, (N, 6, 8), dtype=np.uint8).repeat(8, axis=1).repeat(8, axis=2)
EVEN = [k / RATE_HZ for k in range(N)]


@pytest.mark.parametrize("suffix", [".mkv", ".mp4", ".mov", ".avi"])
def test_lost_frames_leave_a_gap_of_time(suffix: str, tmp_path: Path) -> None:
    kept = [k for k in range(N) if not 4 <= k < 7]
    path = write_video(tmp_path / f"r{suffix}", FRAMES[kept], [EVEN[k] for k in kept])
    np.testing.assert_allclose(np.diff(index_of(path).times_s) * RATE_HZ, np.diff(kept), atol=0.03)


@pytest.mark.parametrize("group", [1, 4, 99])
def test_frames_before_a_cut_are_not_shown_and_the_file_is_whole(group: int, tmp_path: Path) -> None:
    path = write_video(tmp_path / "r.mp4", FRAMES, EVEN, shift_s=3 / RATE_HZ, group=group)
    stack = open_stack(path)
    assert len(stack) == N - 3
    for index in (5, 0, 8):
        assert np.abs(stack[index].mean(axis=-1) - FRAMES[index + 3]).mean() < 12


def test_a_piece_cut_out_by_an_edit_list_leaves_a_gap(tmp_path: Path) -> None:
    path = write_video(tmp_path / "r.mp4", FRAMES, EVEN, group=1)
    path.write_bytes(with_edits(path.read_bytes(), [(0, 4), (7, 5)]))
    found = index_of(path)
    assert len(found.times) == 9
    np.testing.assert_allclose(np.diff(found.times_s) * RATE_HZ, np.diff([0, 1, 2, 3, 7, 8, 9, 10, 11]), atol=0.03)
    assert "9 of 12 frames" in found.remarks.notes[0]


def test_pieces_in_another_order_are_doubted(tmp_path: Path) -> None:
    path = write_video(tmp_path / "r.mp4", FRAMES, EVEN, group=1)
    path.write_bytes(with_edits(path.read_bytes(), [(6, 5), (0, 4)]))
    assert [doubt.code for doubt in index_of(path).remarks.doubts] == ["video-edited"]


def test_dropped_frames_of_an_avi_are_no_truncation(tmp_path: Path) -> None:
    kept = [0, 1, 2, 3, 6, 7, 8, 9]
    path = write_video(tmp_path / "r.avi", FRAMES[kept], [EVEN[k] for k in kept], empty=[EVEN[4], EVEN[5]])
    found = index_of(path)
    np.testing.assert_allclose(np.diff(found.times_s) * RATE_HZ, np.diff(kept))
    assert found.remarks.doubts == ()


@pytest.mark.parametrize("suffix", [".mkv", ".avi"])
def test_a_file_that_was_cut_off_is_known_by_its_container(suffix: str, tmp_path: Path) -> None:
    path = write_video(tmp_path / f"r{suffix}", FRAMES, EVEN)
    assert is_cut_off(path) is False
    path.write_bytes(path.read_bytes()[:-300])
    assert is_cut_off(path) is True


def test_a_header_that_states_more_than_a_whole_file_holds_is_doubted(tmp_path: Path) -> None:
    path = write_video(tmp_path / "r.mkv", FRAMES, EVEN)
    data = path.read_bytes()
    at = data.index(b"\x44\x89\x88") + 3  # the duration, as a float of 8 bytes
    path.write_bytes(data[:at] + np.array(9000.0, ">f8").tobytes() + data[at + 8 :])
    (doubt,) = index_of(path).remarks.doubts
    assert (doubt.code, doubt.value) == ("video-shorter-than-stated", N)


@pytest.mark.parametrize(
    ("matrix", "as_displayed"),
    [
        ((0, 1, -1, 0), lambda image: np.rot90(image, -1)),
        ((0, -1, 1, 0), np.rot90),
        ((-1, 0, 0, -1), lambda image: image[::-1, ::-1]),
        ((-1, 0, 0, 1), lambda image: image[:, ::-1]),
        ((1, 0, 0, -1), lambda image: image[::-1]),
    ],
    ids=["a quarter back", "a quarter on", "half a turn", "left to right", "upside down"],
)
def test_frames_are_turned_as_the_file_says(
    matrix: tuple[int, ...], as_displayed: Callable[[np.ndarray], np.ndarray], tmp_path: Path
) -> None:
    path = write_video(tmp_path / "r.mp4", FRAMES, EVEN)
    data = path.read_bytes()
    at = data.index(b"tkhd") + 44
    a, b, c, d = (65536 * value for value in matrix)
    changed = np.array([a, b, 0, c, d, 0, 0, 0, 1 << 30], ">i4").tobytes()
    path.write_bytes(data[:at] + changed + data[at + 36 :])
    stack = open_stack(path)
    assert np.abs(stack[3].mean(axis=-1) - as_displayed(FRAMES[3])).mean() < 12
    assert "put upright" in stack.remarks.notes[0]


def test_a_webm_is_read_and_several_tracks_are_refused(tmp_path: Path) -> None:
    path = write_video(tmp_path / "r.mkv", FRAMES, EVEN).rename(tmp_path / "r.webm")
    assert len(open_stack(tmp_path)) == len(open_stack(path)) == N
    path.rename(tmp_path / "r.dat")
    assert len(open_stack(tmp_path)) == N, "known by its content"
    import av

    with av.open(str(tmp_path / "two.mkv"), "w") as container:
        for _ in range(2):
            stream = container.add_stream("ffv1", rate=25)
            stream.width, stream.height, stream.pix_fmt = 64, 48, "gray"
        for stream in container.streams.video:
            for packet in stream.encode(av.VideoFrame.from_ndarray(FRAMES[0], format="gray")) + stream.encode(None):
                container.mux(packet)
    with pytest.raises(EndoctError, match="several recordings; found 2 tracks"):
        open_stack(tmp_path / "two.mkv")
