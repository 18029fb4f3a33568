"""Writes frames as one video file: FFV1 in Matroska.

FFV1 (RFC 9043) is lossless, also for RGB and grey, so the video holds the very pixels that a folder of PNG would; it
codes every frame on its own, so that any of them can be read without decoding others; it is what archives use, and VLC,
Fiji (through its FFMPEG plug-in), Python and everything else built on FFmpeg read it. H.264 and MPEG-4 change the
pixels, and their encoders need not give the same bytes on every machine. Matroska is written without its random
identifiers and dates, so the same frames give the same bytes.
"""

import itertools
from collections.abc import Iterable
from pathlib import Path

import av
import numpy as np
from av.error import FFmpegError
from numpy.typing import NDArray

from endoct.base.errors import EndoctError

FRAME_RATE_HZ = 25
"""Videos are written to play at this rate."""
ENCODER_OPTIONS = {"level": "3", "coder": "rice", "slices": "4", "slicecrc": "1", "g": "1"}


def write_video(path: Path, frames: Iterable[NDArray[np.uint8]]) -> None:
    """Write frames, u8 (row, column) or (row, column, RGB), all of one shape, as a ``.mkv``.

    The same frames give the same bytes. Raises :class:`EndoctError` where there are none, they differ in shape, or
    the file cannot be written.
    """
    stream_of = iter(frames)
    first = next(stream_of, None)
    if first is None:
        raise EndoctError("a video without frames cannot be written")
    layout, coded = ("gray", "gray") if first.ndim == 2 else ("rgb24", "bgr0")
    try:
        # an open file: FFmpeg could take a name for an address
        with (
            path.open("wb") as file,
            av.open(file, "w", format="matroska", container_options={"fflags": "+bitexact"}) as container,
        ):
            stream = container.add_stream("ffv1", rate=FRAME_RATE_HZ, options=ENCODER_OPTIONS)
            stream.height, stream.width = first.shape[:2]
            stream.pix_fmt = coded
            stream.thread_count = 1
            stream.codec_context.flags |= av.codec.context.Flags.bitexact
            for index, frame in enumerate(itertools.chain([first], stream_of)):
                if frame.shape != first.shape:
                    raise EndoctError(
                        f"frame {index} does not fit the video", found=f"{frame.shape}", expected=f"{first.shape}"
                    )
                picture = av.VideoFrame.from_ndarray(np.ascontiguousarray(frame), format=layout)
                picture.pts = index
                container.mux(stream.encode(picture))
            container.mux(stream.encode(None))
    except (FFmpegError, OSError) as error:
        raise EndoctError(f"{path} cannot be written", found=error.strerror or str(error)) from error
