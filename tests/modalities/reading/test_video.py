"""Video files as recordings, in the containers and codecs that cameras and their software write."""

import pickle
import random
import shutil
import subprocess
import sys
from collections import OrderedDict
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import av
import numpy as np
import pytest

from endoct.base.compute.parallel import thread_map
from endoct.base.errors import EndoctError
from endoct.modalities.reading.recording import open_stack
from endoct.modalities.reading.video import ReadVideo
from endoct.modalities.recognition import open_recording, recognise

N = 30
ROWS, COLUMNS = np.mgrid[:64, :96]
CODECS: dict[str, tuple[str, str, dict[str, str]]] = {
    "lossless.mkv": ("ffv1", "bgr0", {"level": "3", "slicecrc": "1"}),
    "grey.mkv": ("ffv1", "gray", {}),
    "grey16.mkv": ("ffv1", "gray16le", {}),
    "bframes.mp4": ("libx264", "yuv420p", {"bf": "3", "g": "12"}),
    "bframes.mkv": ("libx264", "yuv420p", {"bf": "3", "g": "12"}),
    "open-gop.mkv": ("libx264", "yuv420p", {"x264-params": "open-gop=1:bframes=3:keyint=12:log-level=none"}),
    "bframes.avi": ("mpeg4", "yuv420p", {"bf": "2", "g": "12"}),
    "photos.avi": ("mjpeg", "yuvj420p", {}),
    "studio.mov": ("prores_ks", "yuv422p10le", {}),
}


def picture(index: int, deep: bool) -> np.ndarray:
    """A disc that goes round, so that no two frames are alike."""
    angle = 2 * np.pi * index / N
    disc = np.hypot(COLUMNS - 48 - 30 * np.cos(angle), ROWS - 32 - 20 * np.sin(angle)) < 9
    image = (40 + COLUMNS + 80 * disc).astype(np.uint8)
    return image.astype(np.uint16) * 257 if deep else image


def write(path: Path, n: int = N, sound: bool = False) -> Path:
    codec, pixels, options = CODECS[path.name]
    av.logging.set_level(av.logging.PANIC)
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25, options=options)
        stream.width, stream.height, stream.pix_fmt = 96, 64, pixels
        for index in range(n):
            image = picture(index, pixels == "gray16le")
            layout = pixels if pixels.startswith("gray") else "rgb24"
            shown = image if layout != "rgb24" else np.stack([image, image // 2, 255 - image], axis=-1)
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(shown), format=layout)
            frame.pts = index
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def write_sound(path: Path) -> Path:
    with av.open(str(path), "w", format="matroska") as container:
        stream = container.add_stream("pcm_s16le", rate=8000, layout="mono")
        sound = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), format="s16", layout="mono")
        sound.sample_rate = 8000
        container.mux(stream.encode(sound))
        container.mux(stream.encode(None))
    return path


def one_after_the_other(path: Path, layout: str) -> list[np.ndarray]:
    with av.open(str(path)) as container:
        return [frame.to_ndarray(format=layout) for frame in container.decode(video=0)]


@pytest.mark.parametrize("name", CODECS)
def test_frames_are_the_same_in_any_order(name: str, tmp_path: Path) -> None:
    path = write(tmp_path / name)
    deep = "16" in name or "10le" in CODECS[name][1]
    grey = name.startswith("grey")
    layout = ("gray16le" if deep else "gray") if grey else ("rgb48le" if deep else "rgb24")
    expected = one_after_the_other(path, layout)
    stack = open_stack(path)
    assert len(stack) == len(expected) == N
    assert stack.dtype == (np.uint16 if deep else np.uint8)
    assert stack.frame_shape == ((64, 96) if grey else (64, 96, 3))
    order = list(range(N)) * 2
    random.Random(3).shuffle(order)
    for index in order:
        np.testing.assert_array_equal(stack[index], expected[index])
    assert not stack[3].flags.writeable
    again = pickle.loads(pickle.dumps(stack))
    for found, frame in zip(thread_map(lambda frame: frame, again, workers=4), expected, strict=True):
        np.testing.assert_array_equal(found, frame)
    for outside in (N, -1):
        with pytest.raises(IndexError):
            stack[outside]


def test_lossless_frames_are_exact(tmp_path: Path) -> None:
    stack = open_stack(write(tmp_path / "grey16.mkv"))
    for index in (17, 4):
        np.testing.assert_array_equal(stack[index], picture(index, deep=True))


def cut(part: float) -> Callable[[Path], None]:
    def apply(path: Path) -> None:
        data = path.read_bytes()
        path.write_bytes(data[: int(part * len(data))])

    return apply


def overwrite(path: Path) -> None:
    data = bytearray(path.read_bytes())
    half = len(data) // 2
    data[half : half + 400] = bytes(byte ^ 0x5A for byte in data[half : half + 400])
    path.write_bytes(bytes(data))


@pytest.mark.parametrize(
    ("name", "spoil", "said"),
    [
        ("lossless.mkv", cut(0.5), "is truncated"),
        ("lossless.mkv", cut(0.98), "is truncated"),
        ("lossless.mkv", cut(0.0), "is empty"),
        ("lossless.mkv", cut(0.002), ""),
        ("lossless.mkv", overwrite, "cannot be decoded"),
        ("bframes.mp4", cut(0.5), "is no readable video"),
        ("bframes.mp4", cut(0.02), ""),
        ("bframes.avi", cut(0.5), "copy or export it again"),
        ("photos.avi", cut(0.5), "is truncated; found"),
        ("lossless.mkv", lambda path: path.write_text("Dear reader, this is no video."), "is no readable video"),
        ("lossless.mkv", lambda path: write_sound(path), "sound"),
    ],
)
def test_what_is_no_whole_video_is_told(name: str, spoil: Callable[[Path], Any], said: str, tmp_path: Path) -> None:
    path = write(tmp_path / name)
    spoil(path)

    def read_all() -> None:
        stack = open_stack(path)
        for index in range(len(stack)):
            stack[index]

    with pytest.raises(EndoctError) as caught:
        read_all()
    assert said in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_folder_with_one_video_is_an_endoscope_recording(tmp_path: Path) -> None:
    folder = tmp_path / "endoscope"
    folder.mkdir()
    write(folder / "lossless.mkv")
    with pytest.raises(EndoctError, match="no annulus"):  # a video of anything is not taken for an endoscope's
        recognise(folder)
    (folder / "acquisition.toml").write_text(
        'modality = "endoscope"\nbore_diameter_mm = 2.5\nvisible_length_mm = 1.0\n'
        "frame_rate_hz = 25\nfeed_speed_mm_s = 5.0\n"
    )
    assert (
        recognise(folder).manifest.name == recognise(folder / "lossless.mkv", "endoscope").manifest.name == "endoscope"
    )
    _, stream = open_recording(folder)
    assert len(stream) == N
    assert stream[4].z_mm == pytest.approx(0.8), "5 mm/s at 25 Hz"
    shutil.copy(folder / "lossless.mkv", folder / "again.mkv")
    with pytest.raises(EndoctError, match=r"more than one recording.*2 .npy files or videos"):
        open_recording(folder)


def test_no_manifest_loads_the_decoder() -> None:
    code = (
        "import sys, endoct.modalities.endoscope.manifest\n"
        "import endoct.modalities.reading.recording\n"
        "print('av' in sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "False"


def encoded(
    path: Path,
    codec: str,
    pixels: str,
    *,
    aspect: Fraction | None = None,
    field_order: int = 0,
    flags: int = 0,
    **options: str,
) -> Path:
    av.logging.set_level(av.logging.PANIC)
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream(codec, rate=25, options=options)
        stream.width, stream.height, stream.pix_fmt = 96, 64, pixels
        if aspect is not None:
            stream.codec_context.sample_aspect_ratio = aspect
        stream.codec_context.flags |= flags
        if field_order:
            stream.codec_context.field_order = field_order
        for index in range(N):
            frame = av.VideoFrame.from_ndarray(picture(index, False), format="gray").reformat(format=pixels)
            frame.pts = index
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def test_a_video_of_woven_fields_is_doubted(tmp_path: Path) -> None:
    woven = encoded(tmp_path / "a.mkv", "libx264", "yuv420p", **{"x264-params": "tff=1:log-level=none"})
    whole = encoded(tmp_path / "b.mkv", "libx264", "yuv420p", **{"x264-params": "log-level=none"})
    by_frames = encoded(tmp_path / "c.mp4", "mpeg4", "yuv420p", flags=0x2004_0000)  # coded and searched by fields
    for path, expected in ((woven, ["frames-interlaced"]), (by_frames, ["frames-interlaced"]), (whole, [])):
        stack = open_stack(path)
        assert [doubt.code for doubt in stack.remarks.doubts] == expected
        assert [doubt.code for doubt in pickle.loads(pickle.dumps(stack)).remarks.doubts] == expected


def test_fields_that_the_container_alone_states_are_doubted(tmp_path: Path) -> None:
    for order, expected in ((2, ["frames-interlaced"]), (1, [])):
        path = encoded(tmp_path / f"{order}.mkv", "ffv1", "gray", field_order=order)
        assert [doubt.code for doubt in open_stack(path).remarks.doubts] == expected


def test_frames_without_times_of_showing_are_refused(tmp_path: Path) -> None:
    reordered = encoded(tmp_path / "a.avi", "libx264", "yuv420p", bf="2", g="12", **{"x264-params": "log-level=none"})
    with pytest.raises(EndoctError, match=r"no times at which they are shown.*B-frames.*ffv1 OUT.mkv"):
        open_stack(reordered)
    in_order = encoded(tmp_path / "b.avi", "libx264", "yuv420p", bf="0", **{"x264-params": "log-level=none"})
    assert [nearest(frame) for frame in map(open_stack(in_order).__getitem__, range(N))] == list(range(N))


def nearest(frame: np.ndarray) -> int:
    """Return which picture a frame, with losses, shows."""
    seen = frame[..., 0].astype(float)
    return int(np.argmin([np.abs(seen - picture(k, False)).mean() for k in range(N)]))


@pytest.mark.parametrize("name", ["a.mp4", "a.mkv", "a.avi"])
def test_the_aspect_of_pixels_of_a_video(name: str, tmp_path: Path) -> None:
    how = {"bf": "0", "x264-params": "log-level=none"}
    path = encoded(tmp_path / name, "libx264", "yuv420p", aspect=Fraction(16, 15), **how)
    assert open_stack(path).pixel_aspect == pytest.approx(16 / 15)
    assert open_stack(encoded(tmp_path / f"b{name}", "libx264", "yuv420p", **how)).pixel_aspect == 1


def stamped(*stamps: int | None) -> list[Any]:
    return [SimpleNamespace(pts=stamp, dts=None, is_corrupt=False) for stamp in stamps]


def test_a_frame_is_met_by_its_time_whatever_comes_between() -> None:
    """Frames without a time, of a time that the index has not, and from before are passed over."""
    frames = stamped(None, 0, 5, 10, 0, 20, 30)
    frames[5].pts, frames[5].dts = None, 20  # its time of decoding counts instead
    index = SimpleNamespace(times=np.array([0, 10, 20, 30]), kept=2)
    of: Any = SimpleNamespace(_ahead=iter(frames), _index=index, n_frames=4, _next=0, _recent=OrderedDict())
    assert ReadVideo._walk(of, 2) is frames[5]
    assert (of._next, list(of._recent)) == (3, [1, 2])
    assert ReadVideo._walk(of, 3) is frames[6]
    assert list(of._recent) == [2, 3]
    assert ReadVideo._walk(of, 4) is None
    assert of._ahead is None
