"""What a header says of samples and places, beside what the stream holds: TIFF by tifffile, videos by PyAV."""

from collections.abc import Callable, Mapping
from fractions import Fraction
from pathlib import Path
from random import Random
from typing import Any

import av
import imagecodecs
import numpy as np
import tifffile

from benchmarks.frame_faults.drawn import PITCH_MM, RATE_HZ, Truth, drawn, missing, with_sidecar

Write = Callable[[Path, Random], Truth]
_TYPES = ("u1", "u2", "u4", "i1", "i2", "i4", "f2", "f4", "f8")
_UNEVEN = "frames-uneven"


def _packed(rng: Random, dtype: np.dtype[Any]) -> dict[str, Any]:
    """Return how tifffile is to lay samples out: byte order, compression, predictor, strips or tiles."""
    how: dict[str, Any] = {"byteorder": rng.choice("<>"), "bigtiff": rng.random() < 0.3}
    how["compression"] = rng.choice((None, "zlib", "lzw", "packbits", "zstd"))
    if how["compression"] not in (None, "packbits") and dtype.kind in "ui" and rng.random() < 0.5:
        how["predictor"] = True
    how |= rng.choice(({}, {"rowsperstrip": rng.randint(1, 48)}, {"tile": (16, 32)}))
    return how


def samples(folder: Path, rng: Random) -> Truth:
    """B-scans of any type, signed or not, packed in any way."""
    truth, dtype = drawn(rng), np.dtype(rng.choice(_TYPES))
    frames = truth.frames.astype(np.int64) - (128 if dtype.kind != "u" else 0)
    grey = "miniswhite" if dtype in (np.uint8, np.uint16) and rng.random() < 0.3 else "minisblack"
    stored = frames if grey == "minisblack" else np.iinfo(dtype).max - frames
    how = _packed(rng, dtype)
    if dtype == np.float16:
        how["compression"] = None if how["compression"] == "packbits" else how["compression"]
    tifffile.imwrite(folder / "p.tif", stored.astype(dtype), photometric=grey, metadata=rng.choice((None, {})), **how)
    with_sidecar(folder, "oct")
    return Truth(frames, truth.places_mm)


def _blocks(rng: Random) -> Truth:
    """Return frames in colour, of blocks that coding with losses leaves as they are, (n, rows, columns, 3)."""
    truth = drawn(rng)
    seed = np.random.default_rng(rng.randrange(1 << 32))
    colours = seed.integers(30, 226, (len(truth.frames), 3, 4, 3)).repeat(16, axis=1).repeat(16, axis=2)
    return Truth(colours.astype(np.uint8), truth.places_mm, "endoscope", exact=False)


def jpegs(folder: Path, rng: Random) -> Truth:
    """Colours as JPEG in TIFF: the stream says, by its marker or its components, whether they are RGB or YCbCr."""
    truth = _blocks(rng)
    stream_is, header = rng.choice(("jfif", "adobe", "rgb")), rng.choice((2, 6))
    for k, frame in enumerate(truth.frames):
        data = imagecodecs.jpeg8_encode(
            frame, level=95, **({"colorspace": "RGB", "outcolorspace": "RGB"} if stream_is == "rgb" else {})
        )
        if stream_is == "adobe":
            data = data[:2] + b"\xff\xee\0\x0eAdobe\0d\0\0\0\0\1" + data[20:]
        path, how = folder / f"f{k:03d}.tif", {"rowsperstrip": 48, "compression": "jpeg", "photometric": "ycbcr"}
        with tifffile.TiffWriter(path) as writer:
            writer.write(iter([data]), shape=frame.shape, dtype=np.uint8, metadata=None, **how)
        with tifffile.TiffFile(path, mode="r+") as tiff:
            tiff.pages[0].tags[262].overwrite(header)
    with_sidecar(folder, "endoscope")
    return truth


def ycbcr(folder: Path, rng: Random) -> Truth:
    """Colours as Y, Cb, Cr, not as JPEG, with as many of each or fewer."""
    truth = _blocks(rng)
    parts, packed = rng.choice(((1, 1), (2, 1), (2, 2))), rng.choice((None, "packbits", "zlib", "lzw"))
    to_ycbcr = np.array([[0.299, 0.587, 0.114], [-0.1687, -0.3313, 0.5], [0.5, -0.4187, -0.0813]])
    for k, frame in enumerate(truth.frames):
        stored = np.clip(frame @ to_ycbcr.T + [0, 128, 128], 0, 255).astype(np.uint8)
        path = folder / f"f{k:03d}.tif"
        tifffile.imwrite(path, stored, photometric="ycbcr", compression=packed, metadata=None)
        with tifffile.TiffFile(path, mode="r+") as tiff:
            tiff.pages[0].tags[530].overwrite(parts)
    with_sidecar(folder, "endoscope")
    return truth


def imagej(folder: Path, rng: Random) -> Truth:
    """A stack of ImageJ with its calibration: none, a line, or a curve."""
    truth, dtype = drawn(rng), np.dtype(rng.choice(("u1", "u2", "f4")))
    c0, c1 = rng.choice((0.0, -32768.0, -128.0, 10.5)), rng.choice((1.0, 1.0, 0.5, 2.0, -1.0))
    function = rng.choice((None, 20, 0, 0, 0, 1, 8, 21))
    lines = ["ImageJ=1.54f", f"images={len(truth.frames)}", f"slices={len(truth.frames)}", "unit=pixel"]
    lines += [] if function is None else [f"cf={function}", f"c0={c0}", f"c1={c1}", "vunit=Gray value"]
    text = "\n".join([*lines, "loop=false", ""])
    stored = truth.frames.astype(dtype)
    tifffile.imwrite(folder / "p.tif", stored, description=text, metadata=None, **_packed(rng, dtype))
    with_sidecar(folder, "oct")
    shown = c0 + c1 * truth.frames.astype(np.float64) if function not in (None, 20) else truth.frames
    return Truth(shown, truth.places_mm)


def planes(folder: Path, rng: Random) -> Truth:
    """An OME-TIFF whose planes say where the stage stood, or when they were taken: evenly, with gaps, not at all."""
    truth = drawn(rng, 8, 14)
    kept = rng.choice((list(range(len(truth.frames))), missing(rng, len(truth.frames))))
    truth = truth.part(kept)
    axis, unit = rng.choice("ZT"), rng.choice(("mm", "µm", "reference frame", None))
    by_time = axis == "T" and rng.random() < 0.5
    stated = truth.places_mm - truth.places_mm[0]
    if by_time:
        plane = {"DeltaT": (stated / PITCH_MM / RATE_HZ).tolist(), "DeltaTUnit": ["s"] * len(stated)}
    else:
        down = rng.choice((1, -1))
        values = (down * stated * {"µm": 1000, "mm": 1}.get(unit or "", 3.7) + rng.uniform(-50, 50)).tolist()
        plane = {"PositionZ": values} | ({"PositionZUnit": [unit] * len(stated)} if unit else {})
    metadata: dict[str, Any] = {"axes": f"{axis}YX", "Plane": plane}
    tifffile.imwrite(folder / "p.ome.tif", truth.frames, photometric="minisblack", metadata=metadata)
    with_sidecar(folder, "oct")
    return truth.at(stated)


def pixels(folder: Path, rng: Random) -> Truth:
    """Images whose resolution says that pixels are square, or are not."""
    truth = drawn(rng)
    across, down = rng.choice(((72, 72), (300, 300.5), (72, 96), (100, 75), (1, 2)))
    for k, frame in enumerate(truth.frames):
        tifffile.imwrite(folder / f"f{k:03d}.tif", frame, resolution=(across, down), metadata=None)
    with_sidecar(folder, "endoscope")
    doubted = "pixel-aspect-stated" if abs(across / down - 1) > 0.01 else ""
    return Truth(truth.frames, truth.places_mm, "endoscope", doubted=doubted)


_CODED: tuple[tuple[str, str, str, dict[str, str]], ...] = tuple(
    (suffix, codec, layout, options)
    for codec, layout, options, suffixes in (
        ("ffv1", "gray", {}, ("mkv", "avi")),
        ("libx264", "yuv420p", {"crf": "4"}, ("mkv", "mp4", "mov", "avi")),
        ("mpeg4", "yuv420p", {"q:v": "2"}, ("mkv", "mp4", "avi")),
        ("mpeg2video", "yuv420p", {"q:v": "2"}, ("mkv",)),
    )
    for suffix in suffixes
)


def video(folder: Path, rng: Random) -> Truth:
    """A video with or without B-frames, of whole frames or of fields, of pixels that are square or not."""
    truth = drawn(rng, 9, 20)
    blocks = truth.frames[:, ::8, ::8].repeat(8, axis=1).repeat(8, axis=2)
    suffix, codec, layout, options = rng.choice(_CODED)
    reorders = codec != "ffv1" and rng.random() < 0.5
    fields = rng.random() < 0.3 and (suffix == "mkv" or codec == "libx264")
    states_aspect = codec in ("libx264", "mpeg4")  # the others do not write it
    aspect = rng.choice((None, None, Fraction(16, 15), Fraction(4, 3))) if states_aspect else None
    more = {} if codec == "ffv1" else {"bf": "2" if reorders else "0", "g": rng.choice(("4", "12"))}
    if codec == "libx264":
        more["x264-params"] = "log-level=none" + (":tff=1" if fields else "")
    av.logging.set_level(av.logging.PANIC)
    with av.open(str(folder / f"r.{suffix}"), "w") as container:
        stream: Any = container.add_stream(codec, rate=Fraction(int(RATE_HZ)), options=options | more)
        stream.width, stream.height, stream.pix_fmt, stream.thread_count = 64, 48, layout, 1
        if aspect is not None:
            stream.codec_context.sample_aspect_ratio = aspect
        if fields:
            stream.codec_context.field_order = 2
        for k, image in enumerate(blocks):
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="gray")
            frame.pts, frame.time_base = k, Fraction(1, int(RATE_HZ))
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    with_sidecar(folder, "endoscope")
    doubted = "frames-interlaced" if fields else "pixel-aspect-stated" if aspect is not None else ""
    return Truth(blocks, truth.places_mm, "endoscope", exact=False, doubted=doubted)


READABLE: Mapping[str, Write] = {
    "TIFF, samples of any type": samples,
    "TIFF, JPEG against header": jpegs,
    "TIFF, planes of OME": planes,
    "TIFF, pixels": pixels,
}
"""None of these may be refused."""
STREAMS: Mapping[str, Write] = {
    **READABLE,
    "TIFF, YCbCr": ycbcr,
    "TIFF, calibration of ImageJ": imagej,
    "video, order, fields, pixels": video,
}
