"""Jobs to be done as fast as possible, of the sizes that rigs record, made of small simulated recordings.

A recording of any length and size is made of a small one: its frames are resized and repeated, with noise.
"""

import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tifffile
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import map_coordinates

from endoct.base.arrays import Coordinates, Image
from endoct.modalities.contract import Frame
from endoct.modalities.endoscope.calibration import EndoscopeCalibration
from endoct.modalities.endoscope.mirror.band import Circles
from endoct.modalities.oct.spectra.reconstruction import Counts, sample_places
from endoct.modalities.reading.recording import open_stack
from endoct.modalities.recognition import open_recording
from endoct.workbench.bench.task import rng_of
from endoct.workbench.pipeline.truth import Truth

JOBS = "pullback", "strips", "threshold", "alignment", "spectra"
N_DEPTH = 512
N_SAMPLES = 1024
CHIRP = np.polynomial.Polynomial([-0.48, 1.25467, -2.017e-4, -4.6e-8])
"""The even wavenumber that each pixel of a spectrometer sees: a fit to the vectors of a Telesto."""
REFLECTORS = 6
Frames = Callable[[int], NDArray[Any]]
"""Returns one frame by its index."""


@dataclass(frozen=True, eq=False)
class Work:
    """A job for one method.

    Attributes: ``job``, its kind; ``given``, what there is to start from; ``repeats``, how many timed runs are wanted;
    ``amount`` of slices, frames, images or pairs in one run.
    """

    job: str
    given: tuple[Any, ...]
    repeats: int
    amount: int = 1


@dataclass(frozen=True, eq=False)
class View:
    """Where an image of the mirror shows the rows and columns of its strip.

    ``centre_px`` (x, y) of the mirror's ring, whose outer rim has the radius ``rim_px``; ``r_px`` (n_rows,) and
    ``angle_rad`` (n_theta,) of the strip's samples around it.
    """

    centre_px: tuple[float, float]
    rim_px: float
    r_px: Coordinates
    angle_rad: Coordinates


def repeated_truth(truth: Truth, count: int, n_ascans: int) -> Truth:
    """Return the truth of a pullback whose slices were repeated, forth and back, at ``n_ascans`` a slice."""
    of: Mapping[str, Any] = truth.recording["oct"]
    n = len(of["z_mm"])
    places = [place_of(k, n, forth_and_back=True) for k in range(count)]
    longer = {
        name: [values[place] for place in places] if isinstance(values, list) and len(values) == n else values
        for name, values in of.items()
    }
    longer = {**longer, "n_ascans": n_ascans, "lost_ascans": []}
    return replace(truth, recording={**truth.recording, "oct": longer})


def write_pullback(specimen: Path, slices: int, ascans: int, folder: Path) -> Path:
    """Write ``slices`` × ``ascans`` × :data:`N_DEPTH` u16 made of a specimen's pullback; return the new folder."""
    write_recording(specimen, "oct", slices, ascans, folder, "uint16")
    return folder


def survey_square(
    specimen: Path, side_px: int, count: int, folder: Path
) -> tuple[Sequence[Frame], EndoscopeCalibration]:
    """Return ``count`` frames of ``side_px``² in memory, and what a survey of them measured.

    The middle of a specimen's frames, resized, and repeated from the start again where there are too few.
    """
    stack = open_stack(specimen / "endoscope")
    images = [_square(np.asarray(stack[k % len(stack)]), side_px) for k in range(count)]
    shape = stack.frame_shape
    folder.mkdir(parents=True)
    sidecar = (specimen / "endoscope" / "acquisition.toml").read_text(encoding="utf-8")
    larger = side_px / min(shape[:2])
    lines = [_scaled(line, larger) for line in sidecar.splitlines()]
    (folder / "acquisition.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    tifffile.imwrite(folder / "frames.tif", np.stack(images), photometric="rgb" if len(shape) == 3 else "minisblack")
    manifest, stream = open_recording(folder)
    modality = manifest.load()
    calibration: EndoscopeCalibration = modality.survey(stream, modality.parameters())
    return [stream[index] for index in range(len(stream))], calibration


def _scaled(line: str, factor: float) -> str:
    key, _, value = line.partition(" = ")
    return f"focal_px = {float(value) * factor:.6f}" if key == "focal_px" else line


def _square(image: NDArray[Any], side_px: int) -> NDArray[Any]:
    height, width = image.shape[:2]
    side = min(height, width)
    top, left = (height - side) // 2, (width - side) // 2
    return np.asarray(cv2.resize(image[top : top + side, left : left + side], (side_px, side_px)))


def view_of(calibration: EndoscopeCalibration, index: int) -> View:
    """Return where frame ``index`` shows its strip, which has the rows of the panorama that it sees."""
    c = calibration
    annulus, from_centre_mm = _circles(c, index)
    return View(
        (annulus.outer_x_px, annulus.outer_y_px),
        annulus.outer_px,
        c.optics.r_px(from_centre_mm),
        np.mod(c.image_angle(index, c.grid.theta_rad), 2 * np.pi),
    )


def sampled_strip(frame: Frame, calibration: EndoscopeCalibration) -> Image:
    """Return the brightness of a frame on the rows and columns of its strip, each read once, float32."""
    c = calibration
    annulus, from_centre_mm = _circles(c, frame.index)
    circles = Circles(annulus, c.optics.r_px(from_centre_mm))
    columns, rows = circles.pixel_map(c.image_angle(frame.index, c.grid.theta_rad))
    return np.asarray(map_coordinates(grey(frame), [rows, columns], order=1, mode="nearest"), np.float32)


def grey(frame: Frame) -> Image:
    """Return the mean of a frame's channels, float32."""
    samples = np.asarray(frame.samples, np.float32)
    return samples.mean(axis=2, dtype=np.float32) if samples.ndim == 3 else samples


def _circles(c: EndoscopeCalibration, index: int) -> tuple[Any, Coordinates]:
    half_mm, centre_mm = float(c.strip_z_mm[-1]), float(c.z_mm[index])
    first, last = np.searchsorted(c.row_z_mm, [centre_mm - half_mm, centre_mm + half_mm])
    z_mm = c.row_z_mm[first : max(last, first + 1)]
    return c.annuli[index].with_drift(*c.drift_px).moved(*c.shift_px), z_mm - centre_mm


def relief_of_cells(seed: int, index: int, n: int) -> Image:
    """Return ``n`` depths as of a wall of which cells cover a fifth, mm, float32."""
    rng = rng_of(seed, index, "threshold")
    return np.asarray(np.where(rng.random(n) < 0.2, 0.4, 0.0) + rng.exponential(0.03, n), np.float32)


def raw_spectra(seed: int, index: int, ascans: int) -> tuple[Counts, Coordinates]:
    """Return (spectra, places): a slice of counts, u16 (ascans, 1024), and where even wavenumbers lie among them.

    Each A-scan shows some reflectors, at depths that vary around the turn, and noise.
    """
    rng = rng_of(seed, index, "spectra")
    wavenumber = CHIRP(np.arange(N_SAMPLES, dtype=np.float64))
    turn = 2 * np.pi * np.arange(ascans) / ascans
    lamp = 1500 * np.exp(-0.5 * ((wavenumber / N_SAMPLES - 0.5) / 0.3) ** 2)
    fringes = rng.normal(0, 0.02, (ascans, N_SAMPLES)).astype(np.float32)
    for depth in rng.uniform(40, 300, REFLECTORS):
        cycles = (depth + 20 * np.sin(turn + rng.uniform(0, 2 * np.pi))) / N_SAMPLES
        phase = 2 * np.pi * (np.outer(cycles, wavenumber) + rng.random(ascans)[:, np.newaxis])
        fringes += np.float32(0.02) * np.cos(phase.astype(np.float32))
    counts = np.rint(lamp.astype(np.float32) * (1 + fringes))
    return np.clip(counts, 0, 4095).astype(np.uint16), sample_places(wavenumber, "wavenumber")


def levels_db(spectra: Counts, places: Coordinates, background: Coordinates) -> Image:
    """Return the levels (A-scan, depth) of spectra the plain way, A-scan for A-scan; 0 dB is a cosine of amplitude 1.

    Less the background, at even wavenumbers by a cubic spline, Hann window, Fourier transform, logarithm.
    """
    samples = np.arange(places.size)
    seen = np.isfinite(places)
    weights = np.zeros(places.size)
    weights[seen] = np.hanning(np.count_nonzero(seen))
    weights *= 2 / weights.sum()
    at = np.where(seen, places, 0.0)
    rows = np.empty((len(spectra), places.size // 2), np.float32)
    for row, spectrum in zip(rows, spectra, strict=True):
        even = CubicSpline(samples, spectrum - background)(at)
        row[:] = 20 * np.log10(np.abs(np.fft.rfft(even * weights)[:-1]) + 1e-9)
    return rows


def resized(specimen: Path, side: str, width: int) -> tuple[int, Frames]:
    """Return how many frames a simulated recording has, and what reads one at ``width`` A-scans or columns.

    A B-scan keeps its depth samples, an image its shape.
    """
    stack = open_stack(specimen / side / "pullback.tif" if side == "oct" else specimen / side)

    def frame(index: int) -> NDArray[Any]:
        image = np.ascontiguousarray(stack[index])
        rows = image.shape[0] if side == "oct" else round(width * image.shape[0] / image.shape[1])
        how = cv2.INTER_AREA if width < image.shape[1] else cv2.INTER_LINEAR
        return np.asarray(cv2.resize(image, (width, rows), interpolation=how))

    return len(stack), frame


def place_of(k: int, n: int, *, forth_and_back: bool) -> int:
    """Return which of ``n`` frames is the ``k``-th of a recording that repeats them."""
    turn, place = divmod(k, n)
    return n - 1 - place if forth_and_back and turn % 2 else place


def repeated(n: int, frame: Frames, count: int, *, forth_and_back: bool) -> Iterator[NDArray[Any]]:
    """Yield ``count`` frames of ``n``, each with noise of its own, one count up or down."""
    for k in range(count):
        image = frame(place_of(k, n, forth_and_back=forth_and_back))
        noise = np.random.default_rng(k).integers(-1, 2, image.shape)
        top = np.iinfo(image.dtype).max if image.dtype.kind == "u" else np.inf
        yield np.clip(image + noise, 0, top).astype(image.dtype)


def write_recording(specimen: Path, side: str, count: int, width: int, folder: Path, dtype: str | None = None) -> int:
    """Write a recording of ``count`` frames with its sidecar into a new ``folder``; return the bytes of its samples.

    Slices go forth and back, so that neighbours stay alike, frames from the start again. ``dtype``: of the samples;
    default: as simulated.
    """
    n, frame = resized(specimen, side, width)
    first = frame(0)
    kind = np.dtype(dtype or first.dtype)
    frames = repeated(n, frame, count, forth_and_back=side == "oct")
    n_bytes = count * first.size * kind.itemsize
    folder.mkdir(parents=True)
    shutil.copy(specimen / side / "acquisition.toml", folder)
    tifffile.imwrite(
        folder / "recording.tif",
        (frame.astype(kind, copy=False) for frame in frames),
        shape=(count, *first.shape),
        dtype=kind,
        photometric="rgb" if first.ndim == 3 else "minisblack",
        bigtiff=n_bytes > 2**31,
    )
    return n_bytes
