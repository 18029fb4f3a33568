"""The files of a specimen: both recordings, the truth, and what else was asked for.

Sidecars hold what the operator would have written down.
"""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np
import tifffile
from numpy.typing import NDArray

from endoct.base.compute.parallel import Progress
from endoct.base.compute.worker_process import WorkerProcess
from endoct.base.errors import EndoctError
from endoct.synthetic.bone.baked_maps import part_of_wall
from endoct.synthetic.ct_scan import write_ct, write_lines
from endoct.synthetic.endoscope.camera import StoredFrame
from endoct.synthetic.labels.specimen_labels import write_labels
from endoct.synthetic.model import Bscans, Model, build_model, rendering
from endoct.synthetic.oct.bscan import CHIRP, OFFSET, SAMPLES, write_spectra
from endoct.synthetic.sample.parameters import Sample
from endoct.synthetic.sample.presets import PRESETS
from endoct.synthetic.truth import write_truth

TomlValue = str | float | list[float] | Mapping[str, str | float]
PROGRESS_EVERY_S = 0.2
ALL_TAKEN = 0.99
"""A recording counts as done to this share at most until the frames that were taken last are written."""
FRAME_RATE_HZ = 25
"""Videos are written to play at this rate."""
ENCODER_OPTIONS = {"level": "3", "coder": "rice", "slices": "4", "slicecrc": "1", "g": "1"}
"""Videos are FFV1 in Matroska.

FFV1 (RFC 9043) is lossless, also for RGB and grey, so a video holds the very pixels that a folder of PNG would. It
codes every frame on its own, so that any can be read without the others. Archives use it, and VLC, Fiji (through its
FFMPEG plug-in), Python and all else built on FFmpeg read it. H.264 and MPEG-4 change the pixels, and their encoders
need not give the same bytes on every machine. Matroska is written without its random identifiers and dates, so the same
frames give the same bytes.
"""


def oct_sidecar(sample: Sample) -> dict[str, TomlValue]:
    """Return the keys of ``oct/acquisition.toml``; what the operator does not know is left out or "unknown"."""
    oct_ = sample.oct
    keys: dict[str, TomlValue] = {
        "modality": "oct",
        "axial_pixel_mm": oct_.axial_pixel_mm,
        "pullback_pitch_mm": PRESETS[sample.preset].pitch_mm,
        "bore_diameter_mm": sample.bore.diameter_mm,
        "capillary_outer_diameter_mm": oct_.capillary_outer_diameter_mm,
        "travel": oct_.stated_travel,
        "handedness": ("same" if oct_.sense > 0 else "mirrored") if oct_.states_handedness else "unknown",
        "intensity": "log",
        "db_per_count": oct_.db_per_count,
        "scan": oct_.scan,
        "medium_index": 1.0,
    }
    if (tube := sample.bore.tube) is not None:  # what is to be measured is not stated, or roughly
        capillary_mm = oct_.capillary_outer_diameter_mm + tube.capillary_error * tube.sigma_capillary_mm
        return keys | {
            "axial_pixel_mm": oct_.axial_pixel_mm * tube.axial_pixel_factor,
            "pullback_pitch_mm": PRESETS[sample.preset].pitch_mm * tube.pitch_factor,
            "capillary_outer_diameter_mm": capillary_mm,
            "handedness": "unknown",
            "standard_errors": {"capillary_outer_diameter_mm": tube.sigma_capillary_mm},
        }
    if oct_.states_first_sample:
        keys["first_sample_mm"] = oct_.first_sample_mm
    return keys


def spectra_sidecar(sample: Sample) -> dict[str, TomlValue]:
    """Return the keys of ``oct-spectra/acquisition.toml``: in place of what is said of B-scans, of raw spectra."""
    size = PRESETS[sample.preset]
    keys = {key: value for key, value in oct_sidecar(sample).items() if key not in ("intensity", "db_per_count")}
    keys["spectra"] = {
        "file": SAMPLES,
        "samples": 2 * size.n_depth,
        "ascans": size.n_ascans,
        "chirp": CHIRP,
        "offset": OFFSET,
        "electrons_per_count": sample.oct.electrons_per_count,
    }
    return keys


def endoscope_sidecar(sample: Sample) -> dict[str, TomlValue]:
    """Return the keys of ``endoscope/acquisition.toml``."""
    camera = sample.endoscope
    keys: dict[str, TomlValue] = {
        "modality": "endoscope",
        "bore_diameter_mm": sample.bore.diameter_mm,
        "feed_pitch_mm": PRESETS[sample.preset].pitch_mm,
        "visible_length_mm": camera.visible_length_mm,
        "outer_rim": "ahead",
        "travel": camera.stated_travel,
    }
    if sample.bore.tube is not None:  # of an endoscope that is to be calibrated, nothing is known
        del keys["visible_length_mm"], keys["outer_rim"]
        return keys
    if camera.states_optics:
        keys |= {
            "cone_half_angle_deg": camera.half_angle_deg,
            "focal_px": camera.focal_px,
            "mirror_distance_mm": camera.mirror_distance_mm,
            "distortion": [camera.distortion_k1],
        }
    if camera.states_annulus:
        x, y = camera.centre_px[0]
        keys["annulus"] = {"x": x, "y": y, "inner_px": camera.inner_px, "outer_px": camera.outer_px}
    return keys


def tube_file(sample: Sample) -> dict[str, TomlValue]:
    """Return the keys of ``tube.toml``: what is stated of a printed tube; none for bone."""
    bore, tube = sample.bore, sample.bore.tube
    if tube is None:
        return {}
    return {
        "bore_diameter_mm": bore.diameter_mm,
        "outer_diameter_mm": bore.diameter_mm + 3.2,
        "length_mm": bore.length_mm,
        "groove_width_mm": tube.groove_width_mm,
        "helix_width_mm": tube.helix_width_mm,
        "groove_depth_mm": tube.groove_depth_mm,
        "helix_theta_rad": tube.helix_theta_rad,
        "helix_lead_mm": tube.helix_lead_mm,
        "ring_z_mm": [tube.narrow_z_mm, tube.wide_z_mm],
        "ring_width_mm": [tube.narrow_width_mm, tube.wide_width_mm],
        "ring_depth_mm": tube.ring_depth_mm,
        "standard_errors": {
            "bore_diameter_mm": tube.sigma_bore_mm,
            "depth_mm": tube.sigma_depth_mm,
            "z_mm": tube.sigma_z_mm,
        },
    }


def toml(keys: Mapping[str, TomlValue]) -> str:
    """Return ``keys`` (text, numbers, lists and flat tables of these) as TOML, rounded to 6 decimals."""
    return "".join(f"{key} = {_value(value)}\n" for key, value in keys.items())


def _value(value: TomlValue) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_value(inner)}" for key, inner in value.items()) + " }"
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list):
        return "[" + ", ".join(_value(inner) for inner in value) + "]"
    return repr(round(value, 6))


def write_specimen(
    folder: Path, sample: Sample, processes: Sequence[WorkerProcess], progress: Progress, *, labels: bool, spectra: bool
) -> None:
    """Write the files that :func:`endoct.synthetic.specimen.simulate` lists, of ``sample``, into a new ``folder``.

    ``processes`` trace parts of the wall and render frames.
    """
    progress("wall", 0.0)
    parts = [process.call(part_of_wall, sample, k, len(processes)) for k, process in enumerate(processes)]
    model = build_model(sample, [part.result for part in parts])
    progress("wall", 1.0)

    folder.mkdir()
    with ThreadPoolExecutor(1) as pool:
        truth = pool.submit(write_truth, folder / "truth", sample, model.wall)
        write_recordings(folder, model, processes, progress)
        truth.result()
    if sample.bore.tube is not None:
        (folder / "tube.toml").write_text(toml(tube_file(sample)), encoding="utf-8")
    if sample.ct or sample.cone_beam:
        progress("ct", 0.0)
        write_ct(folder / "truth", sample)
        if sample.ct:
            write_lines(folder, sample)
        progress("ct", 1.0)
    workers = 1 + len(processes)
    if spectra:
        advance = partial(progress, "spectra")
        write_spectra(folder / "oct-spectra", sample, model.wall, model.appearance, advance, workers)
        (folder / "oct-spectra" / "acquisition.toml").write_text(toml(spectra_sidecar(sample)), encoding="utf-8")
    if labels:
        write_labels(folder / "truth" / "labels", model, partial(progress, "labels"), workers)


def write_recordings(folder: Path, model: Model, processes: Sequence[WorkerProcess], progress: Progress) -> None:
    """Write ``oct`` and ``endoscope`` into ``folder`` while this process and ``processes`` render them."""
    with ThreadPoolExecutor(2) as pool, rendering(model, processes) as (bscans, frames):
        oct_ = pool.submit(write_oct, folder / "oct", model.sample, bscans.results())
        endoscope = pool.submit(write_endoscope, folder / "endoscope", model.sample, frames.results())
        taken = {"oct": bscans.share_taken, "endoscope": frames.share_taken}
        for title, writing in (("oct", oct_), ("endoscope", endoscope)):
            while wait([writing], timeout=PROGRESS_EVERY_S).not_done:
                for each in [*taken]:
                    progress(each, min(taken[each](), ALL_TAKEN))
            writing.result()
            del taken[title]
            progress(title, 1.0)


def write_oct(folder: Path, sample: Sample, groups: Iterable[Bscans]) -> None:
    """Write ``pullback.tif`` u8 (slice, depth, A-scan) and ``acquisition.toml``; ``groups`` of B-scans in order."""
    folder.mkdir()
    size = PRESETS[sample.preset]
    shape = size.n_slices, size.n_depth, size.n_ascans
    pages = (page for group in groups for page in group)
    with tifffile.TiffWriter(folder / "pullback.tif", bigtiff=math.prod(shape) > 2**32 - 2**25) as tiff:
        tiff.write(pages, shape=shape, dtype=np.uint8, photometric="minisblack", metadata={"axes": "ZYX"})
    (folder / "acquisition.toml").write_text(toml(oct_sidecar(sample)), encoding="utf-8")


def write_endoscope(folder: Path, sample: Sample, frames: Iterable[StoredFrame]) -> None:
    """Write ``frame_0000.png`` … or ``frames.mkv``, and ``acquisition.toml``; ``frames`` in order."""
    folder.mkdir()
    if sample.endoscope.storage == "video":
        write_video(folder / "frames.mkv", cast(Iterable[NDArray[np.uint8]], frames))
    else:
        for i, data in enumerate(cast(Iterable[bytes], frames)):
            (folder / f"frame_{i:04d}.png").write_bytes(data)
    (folder / "acquisition.toml").write_text(toml(endoscope_sidecar(sample)), encoding="utf-8")


def write_video(path: Path, frames: Iterable[NDArray[np.uint8]]) -> None:
    """Write frames, u8 (row, column) or (row, column, RGB), all of one shape, as a ``.mkv``.

    The same frames give the same bytes. Raises :class:`EndoctError` where there are none, they differ in shape, or
    the file cannot be written.
    """
    import av  # only who writes a video loads it

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
    except (av.FFmpegError, OSError) as error:
        raise EndoctError(f"{path} cannot be written", found=error.strerror or str(error)) from error
