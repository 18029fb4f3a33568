"""Sound recordings, as small as readers take them: TIFF, ``.npy``, images, videos, and folders with a sidecar."""

import io
from collections.abc import Iterator
from fractions import Fraction
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.frame_faults.videos import with_edits
from benchmarks.fuzz.archives import zipped
from benchmarks.fuzz.trees import Seed
from tests.modalities.thorlabs_writer import Oct, raw_file

OCT_TOML = """modality = "oct"
axial_pixel_mm = 0.005
pullback_pitch_mm = 0.2
bore_diameter_mm = 2.5
capillary_outer_diameter_mm = 1.7
travel = "out"
handedness = "mirrored"
intensity = "log"
db_per_count = 0.25
scan = "step"
medium_index = 1.0
first_sample_mm = 0.1
theta_origin_rad = 0.5
"""
ENDOSCOPE_TOML = """modality = "endoscope"
bore_diameter_mm = 2.5
feed_pitch_mm = 0.2
visible_length_mm = 1.0
outer_rim = "ahead"
travel = "in"
annulus = {x = 16.0, y = 16.0, inner_px = 4.0, outer_px = 12.0}
cone_half_angle_deg = 45.0
focal_px = 60.0
mirror_distance_mm = 1.5
distortion = [0.01, 0.0, 0.0]
positions_mm = [0.0, 0.2, 0.4]
frame_rate_hz = 25.0
feed_speed_mm_s = 5.0
"""


def noise(*shape: int, dtype: str = "u1", seed: int = 0) -> NDArray[Any]:
    """Return samples that no codec makes nothing of."""
    values = np.random.default_rng(seed).integers(0, 200, shape)
    return values.astype(dtype)


NOT_READ = ("jpeg2000", "lzma", "planar")


def tiff_seeds() -> Iterator[Seed]:
    """Yield TIFFs of every kind that tifffile writes and people have."""
    grey, colour = noise(3, 6, 8), noise(3, 6, 8, 3)
    kinds: dict[str, tuple[NDArray[Any], dict[str, Any]]] = {
        "plain": (grey, {"metadata": None}),
        "shaped": (grey, {}),
        "big": (grey, {"bigtiff": True}),
        "msb": (noise(3, 6, 8, dtype="u2"), {"byteorder": ">", "metadata": None}),
        "imagej": (grey, {"imagej": True}),
        "ome": (grey, {"ome": True}),
        "float": (noise(3, 6, 8, dtype="f4"), {"predictor": 3, "compression": "zlib"}),
        "zlib": (grey, {"compression": "zlib", "predictor": 2}),
        "lzw": (grey, {"compression": "lzw", "rowsperstrip": 2}),
        "packbits": (grey, {"compression": "packbits"}),
        "zstd": (noise(3, 6, 8, dtype="u2"), {"compression": "zstd"}),
        "jpeg": (noise(2, 16, 16), {"compression": "jpeg"}),
        "jpeg2000": (noise(2, 16, 16), {"compression": "jpeg2000"}),
        "lzma": (grey, {"compression": "lzma"}),
        "tiled": (noise(2, 20, 24), {"tile": (16, 16), "compression": "zlib"}),
        "rgb": (colour, {"photometric": "rgb", "metadata": None}),
        "planar": (noise(2, 3, 6, 8), {"photometric": "rgb", "planarconfig": "separate", "compression": "zlib"}),
        "rgba": (noise(2, 6, 8, 4), {"photometric": "rgb", "extrasamples": ["unassalpha"], "compression": "zlib"}),
        "one page": (noise(6, 8), {"metadata": None}),
        "bits": (noise(2, 6, 8) > 99, {"metadata": None, "compression": "zlib"}),
        "labels": (noise(6, 8, dtype="u4"), {}),
        "white as 0": (noise(2, 6, 8, dtype="u2"), {"photometric": "miniswhite", "compression": "zlib"}),
        "palette": (grey, {"photometric": "palette", "colormap": noise(3, 256, dtype="u2") * 257}),
        "turned": (grey, {"extratags": [(274, "H", 1, 6, False)], "metadata": None}),
    }
    for name, (samples, options) in kinds.items():
        try:
            files = {"pullback.tif": tiff(samples, **options)}
            yield Seed(f"tiff {name}", "pullback.tif", files, refused=name in NOT_READ)
        except Exception:  # noqa: BLE001  a codec that this build does not write
            continue


def tiff(samples: NDArray[Any], **options: Any) -> bytes:
    import tifffile

    buffer = io.BytesIO()
    if not {"photometric", "ome", "imagej"} & options.keys():
        options["photometric"] = "minisblack"
    tifffile.imwrite(buffer, samples, **options)
    return buffer.getvalue()


def _turned(suffix: str, mode: str) -> bytes:
    """Return an image that is stored turned by 90 degrees."""
    from PIL import Image

    buffer, exif = io.BytesIO(), Image.Exif()
    exif[274] = 6
    grey = Image.fromarray(noise(8, 12))
    coded = grey.quantize(16) if mode == "P" else grey.convert(mode)
    coded.save(buffer, {".jpg": "JPEG"}.get(suffix, "PNG"), exif=exif)
    return buffer.getvalue()


def npy_seeds() -> Iterator[Seed]:
    """Yield ``.npy`` of the shapes and types that are stacks of frames."""
    kinds = (((3, 4, 5), "u1"), ((3, 4, 5), "<f4"), ((3, 4, 5), ">u2"), ((2, 4, 5, 3), "u1"), ((4, 5), "f8"))
    for shape, dtype in kinds:
        yield Seed(f"npy {shape} {dtype}", "pullback.npy", {"pullback.npy": npy(noise(*shape).astype(dtype))})


def npy(array: NDArray[Any]) -> bytes:
    """Return the bytes of an array's ``.npy``."""
    buffer = io.BytesIO()
    np.save(buffer, array)
    return buffer.getvalue()


def image(samples: NDArray[Any], suffix: str = ".png") -> bytes:
    """Return the bytes of an image."""
    import cv2

    return bytes(cv2.imencode(suffix, samples)[1])


def image_seeds() -> Iterator[Seed]:
    """Yield single images and folders of them."""
    for suffix in (".png", ".jpg", ".bmp"):
        for kind, samples in (("grey", noise(6, 8)), ("colour", noise(6, 8, 3))):
            yield Seed(f"{kind} {suffix}", f"a{suffix}", {f"a{suffix}": image(samples, suffix)})
    for suffix, mode in ((".jpg", "L"), (".png", "L"), (".png", "LA"), (".png", "P"), (".png", "RGBA")):
        yield Seed(f"{mode} with EXIF {suffix}", f"a{suffix}", {f"a{suffix}": _turned(suffix, mode)})
    for name, header in (("scan.oct", b"<Ocity/>"), ("scan.zip", b"<Other/>")):
        archive = [("Header.xml", header), ("data/Intensity.data", bytes(64))]
        yield Seed(f"archive {name}", name, {name: zipped(archive)}, refused=True)
    deep = noise(6, 8, dtype="u2") * 300
    yield Seed("deep png", "a.png", {"a.png": image(deep)})
    yield Seed("alpha png", "a.png", {"a.png": image(noise(6, 8, 4))})
    bits = (noise(6, 8) > 99).astype(np.uint8) * 255
    yield Seed("palette", "a.png", {"a.png": _palette_png(bits)})
    for suffix in (".png", ".jpg", ".bmp"):
        frames = {f"frame_{k:04d}{suffix}": image(noise(6, 8, seed=k), suffix) for k in range(3)}
        yield Seed(f"folder of {suffix}", "", frames)
    pages = {f"frame_{k}.tif": tiff(noise(6, 8, seed=k), metadata=None) for k in range(3)}
    yield Seed("folder of tiff", "", pages)
    yield Seed("folder with a tiff", "", {"x.tif": tiff(noise(3, 6, 8)), "angles.npy": npy(noise(3))})


def _palette_png(samples: NDArray[Any]) -> bytes:
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(samples).convert("P").save(buffer, "PNG")
    return buffer.getvalue()


def video_seeds() -> Iterator[Seed]:
    """Yield videos in the containers and codecs that are read."""
    kinds = (
        ("mkv", "ffv1", "gray"), ("mkv", "ffv1", "gray16le"), ("mp4", "mpeg4", "yuv420p"), ("mp4", "libx264",
        "yuv420p"),
        ("avi", "mjpeg", "yuvj420p"), ("avi", "rawvideo", "bgr24"), ("mov", "png", "rgb24"), ("mkv", "libvpx",
        "yuv420p"),
        ("mov", "mjpeg", "yuvj420p"), ("avi", "huffyuv", "rgb24"), ("mov", "qtrle", "rgb24"),
    )  # fmt: skip
    for suffix, codec, pixels in kinds:
        try:
            data = video(suffix, codec, pixels)
        except Exception:  # noqa: BLE001  a codec that this build lacks
            continue
        yield Seed(f"{suffix} {codec} {pixels}", f"a.{suffix}", {f"a.{suffix}": data})
        if (suffix, codec) == ("mp4", "mpeg4"):
            yield Seed("mp4 with edits", "a.mp4", {"a.mp4": with_edits(data, [(0, 1), (2, 2)])})


def video(suffix: str, codec: str, pixels: str, frames: int = 4, size: int = 32) -> bytes:
    import av

    buffer = io.BytesIO()
    kind = {"mkv": "matroska"}.get(suffix, suffix)
    with av.open(buffer, "w", format=kind, options={"fflags": "+bitexact"}) as container:
        stream: Any = container.add_stream(codec, rate=Fraction(25))
        stream.width = stream.height = size
        stream.pix_fmt = pixels
        stream.thread_count = 1
        stream.codec_context.flags |= 1 << 23  # bit-exact
        for k in range(frames):
            frame = av.VideoFrame.from_ndarray(noise(size, size, 3, seed=k // 2) // 8, format="rgb24")
            for packet in stream.encode(frame):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    return buffer.getvalue()


def recording_seeds() -> Iterator[Seed]:
    """Yield recordings with their sidecars, as ``endoct info`` and ``unroll`` take them."""
    oct_ = {"acquisition.toml": OCT_TOML.encode()}
    scope = {"acquisition.toml": ENDOSCOPE_TOML.encode()}
    layered = np.repeat(np.arange(48, dtype=np.uint8)[None, :, None] * 5, 64, axis=2).repeat(3, axis=0)
    frames = {f"frame_{k:04d}.png": image(noise(32, 32, 3, seed=k) // 4) for k in range(3)}
    yield Seed("oct", "", {**oct_, "pullback.tif": tiff(layered, compression="zlib")})
    yield Seed("oct npy", "", {**oct_, "pullback.npy": npy(layered)})
    bare = "\n".join(OCT_TOML.split("\n")[1:4]) + "\ncalibration = 'calibration.toml'\nmodality = 'oct'\n"
    more = b"bore_diameter_mm = 2.5\ncapillary_outer_diameter_mm = 1.7\n"
    calibrated = {"acquisition.toml": bare.replace("bore_diameter_mm = 2.5\n", "").encode(), "calibration.toml": more}
    yield Seed("oct calibrated", "", {**calibrated, "pullback.tif": tiff(layered, compression="zlib")})
    yield Seed("endoscope", "", {**scope, **frames})
    gaps = {f"frame_{k:04d}.png": frames["frame_0000.png"] for k in (0, 1, 2, 3, 4, 7, 8)}
    sidecar = ENDOSCOPE_TOML.replace("positions_mm = [0.0, 0.2, 0.4]\n", "")
    yield Seed("endoscope with gaps", "", {"acquisition.toml": sidecar.encode(), **gaps})
    places, series = ("z0mm", "z0.2mm", "z0.25mm", "z-0.4mm", "z1mm"), ("f (2)", "f (1)", "f")
    for k, names in enumerate((places, series, (*places, "2024-05-01_10-22-59-900"), (*places, *series))):
        images = {f"{name}.png": image(layered[0] + n) for n, name in enumerate(names)}
        yield Seed(f"oct with names {k}", "", {**oct_, **images}, refused=k > 1)
    twins = {f"s{k}{suffix}": image(layered[0] + k, suffix) for k in range(4) for suffix in (".png", ".bmp")}
    yield Seed("oct twice", "", {**oct_, **twins})
    spectra = '[spectra]\nfile = "s.bin"\nsamples = 128\nascans = 64\nchirp = "Chirp.dat"\n'
    stated = (OCT_TOML.replace("db_per_count = 0.25\n", "") + spectra).encode("utf-16")
    chirp = "\r\n".join(f"{k:.6f}" for k in range(128)).encode()
    raw = noise(2 * 64, 128, dtype="<u2").tobytes()
    yield Seed("oct of spectra", "", {"acquisition.toml": stated, "Chirp.dat": chirp, "s.bin": raw})
    slices = {f"slice{k}.png": image(layered[0]) for k in (1, 2, 3, 4, 5, 9)}
    yield Seed("oct of images", "", {**oct_, **slices})
    yield Seed("no sidecar", "", frames, refused=True)
    yield Seed("no sidecar, oct", "", {"pullback.npy": npy(layered)}, refused=True)
    yield Seed("video", "", {"acquisition.toml": sidecar.encode(), "a.mkv": video("mkv", "ffv1", "gray")})


def thorlabs_seeds() -> Iterator[Seed]:
    """Yield ThorImage files of every kind, alone, in a folder with a file a stop, and with a chirp next to them."""
    sidecar = {"acquisition.toml": "\n".join(OCT_TOML.split("\n")[2:5]).encode()}
    layered = np.repeat(np.arange(48, dtype=np.float32)[None, None], 64, axis=1).repeat(3, axis=0)
    levels = Oct(size=(48, 64, 3)).add("Intensity", layered).add("VideoImage", noise(3, 4, dtype="<u4"), Type="Colored")
    turned = Oct(size=(48, 64, 3)).add("Complex", layered.astype(np.complex64))
    spectra, chirp = noise(3, 64, 96, dtype="<u2"), np.arange(96.0)
    kinds: dict[str, tuple[Oct, dict[str, Any]]] = {
        "levels": (levels, {}),
        "levels, packed": (levels, {"compression": 8, "separator": "/", "encoding": "utf-16"}),
        "complex": (turned, {}),
        "spectra": (raw_file(spectra, chirp), {}),
        "spectra with apodisation": (raw_file(spectra, chirp, apodisation=spectra[0][:4]), {"compression": 8}),
        "spectra in one": (Oct(size=(48, 64, 3)).add("Spectral0", spectra).add("Chirp", np.float32(chirp)), {}),
    }
    for name, (made, how) in kinds.items():
        yield Seed(name, "", {**sidecar, "scan.oct": made.bytes(**how)})
    text = "\r\n".join(f"{value:.3f}" for value in chirp).encode()
    yield Seed("chirp next to it", "", {**sidecar, "scan.oct": raw_file(spectra, None).bytes(), "Chirp.dat": text})
    stops = {f"s{k}.oct": raw_file([spectra[k]], chirp, timestamp=k + 1).bytes() for k in range(3)}
    yield Seed("stops", "", {**sidecar, **stops})
    yield Seed("no chirp", "", {**sidecar, "scan.oct": raw_file(spectra, None).bytes()}, refused=True)


def sidecar_seeds() -> Iterator[Seed]:
    """Yield sidecars alone, next to a file that is not looked at."""
    number = count()
    for text in (OCT_TOML, ENDOSCOPE_TOML, OCT_TOML + 'calibration = "calibration.toml"\n'):
        more = {"calibration.toml": b"positions_mm = [0.0, 0.2]\n"} if "calibration" in text else {}
        yield Seed(f"sidecar {next(number)}", "", {"acquisition.toml": text.encode(), **more})


def setting_seeds() -> Iterator[Seed]:
    """Yield settings as on the command line, one a line."""
    lines = "undistort=sine\naxial_pixel_mm=0.005\npositions_mm=[0.0, 0.2]\ntravel=in\nannulus={x=1}\nfeed_pitch_mm=1\n"
    yield Seed("settings", "settings.txt", {"settings.txt": lines.encode()})
    few = "bore_diameter_mm=2.5\nn_theta=256\n"
    yield Seed("few settings", "settings.txt", {"settings.txt": few.encode()})
    vary = "oct.wall_db=6..14\noct.scan=step|helical\nbore.septum_mm=0.1\nendoscope.colour=true|false\n"
    yield Seed("vary", "vary.txt", {"vary.txt": vary.encode()})
