"""How much memory, and how long, `endoct unroll` needs for recordings of ever more slices or frames.

    python benchmarks/unroll_memory.py [--counts 150 1500] [--side oct|endoscope] [--ascans 256] [--width 256]
                                       [--seed 1000] [--specimen DIR] [--keep DIR] [--endoct PROGRAM]

One specimen is simulated (or taken from ``--specimen``), thinned to ``--ascans`` a slice or ``--width`` columns an
image, and repeated until there are enough: slices forth and back, so that neighbours stay alike, frames from
the start again. Each gets noise of its own, of one count. Files are written one frame at a time; the program runs in a
process of its own, whose largest resident set is what counts. The first row is a process that only imports what the
command does: the interpreter's and the libraries' own. What grows from one row to the next, by slice, is printed
next to the size of the panorama's own arrays of one slice, and of what is recorded. Seconds are those of the clock and
of the processors.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tifffile
from numpy.typing import NDArray

from endoct.modalities.recording import open_stack

Frames = Callable[[int], NDArray[Any]]
IMPORTED = "import xarray, zarr, endoct.workbench.api, endoct.modalities.{}.plugin"
BYTES_OF_PANORAMA = {"oct": 13, "endoscope": 9}  # a sample: float32 of intensity, weight and depth, and valid


def thinned(specimen: Path, side: str, ascans: int, width: int) -> tuple[int, Frames]:
    """Return how many frames the simulated recording has, and what reads one of them made small."""
    stack = open_stack(specimen / side if side == "endoscope" else specimen / side / "pullback.tif")

    def frame(index: int) -> NDArray[Any]:
        image = np.ascontiguousarray(stack[index])
        size = (ascans, image.shape[0]) if side == "oct" else (width, round(width * image.shape[0] / image.shape[1]))
        return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))

    return len(stack), frame


def repeated(n: int, frame: Frames, count: int, forth_and_back: bool) -> Iterator[NDArray[Any]]:
    """Yield ``count`` frames of ``n``, each with noise of its own."""
    for k in range(count):
        turn, place = divmod(k, n)
        image = frame(n - 1 - place if forth_and_back and turn % 2 else place)
        noise = np.random.default_rng(k).integers(-1, 2, image.shape)
        top = np.iinfo(image.dtype).max if image.dtype.kind == "u" else np.inf
        yield np.clip(image + noise, 0, top).astype(image.dtype)


def write(specimen: Path, side: str, count: int, ascans: int, width: int, folder: Path) -> int:
    """Write a recording of ``count`` frames with its sidecar; return its bytes."""
    n, frame = thinned(specimen, side, ascans, width)
    first = frame(0)
    folder.mkdir(parents=True)
    shutil.copy(specimen / side / "acquisition.toml", folder)
    tifffile.imwrite(
        folder / "recording.tif",
        repeated(n, frame, count, forth_and_back=side == "oct"),
        shape=(count, *first.shape),
        dtype=first.dtype,
        photometric="rgb" if first.ndim == 3 else "minisblack",
        bigtiff=count * first.nbytes > 2**31,
    )
    return count * int(first.nbytes)


def measured(command: list[str]) -> tuple[float, float, float]:
    """Run a command; return its largest resident set, MB, and seconds of clock and processors. Exits where it fails."""
    start = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)} failed with {process.returncode}")
    peak = usage.ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    return peak / 1e6, time.perf_counter() - start, usage.ru_utime + usage.ru_stime


def main() -> None:
    """Print a row for each number of slices or frames."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--counts", type=int, nargs="+", default=[150, 1500])
    parser.add_argument("--side", choices=["oct", "endoscope"], default="oct")
    parser.add_argument("--ascans", type=int, default=256)
    parser.add_argument("--width", type=int, default=256)
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--specimen", type=Path)
    parser.add_argument("--keep", type=Path, help="folder for the recordings and panoramas")
    parser.add_argument("--endoct", default=str(Path(sys.executable).with_name("endoct")))
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        root = arguments.keep or Path(scratch)
        specimen = arguments.specimen or root / "specimen"
        if not specimen.exists():
            measured(
                [arguments.endoct, "simulate", "-o", str(specimen), "--preset", "quick", "--seed", str(arguments.seed)]
            )
        print(" frames  recorded     peak  seconds  processor  a frame more  of panorama  of recording")
        python = str(Path(arguments.endoct).with_name(Path(sys.executable).name))
        peak_mb, seconds, busy = measured([python, "-c", IMPORTED.format(arguments.side)])
        print(f"{'none':>7} {'':>9} {peak_mb:>5.0f} MB {seconds:>8.1f} {busy:>10.1f}")
        before = None
        for count in sorted(arguments.counts):
            recording = (
                root / f"{arguments.side}-{count}-{arguments.ascans if arguments.side == 'oct' else arguments.width}"
            )
            panorama = root / f"{recording.name}.zarr"
            if not recording.exists():
                write(specimen, arguments.side, count, arguments.ascans, arguments.width, recording)
            recorded = (recording / "recording.tif").stat().st_size
            command = [arguments.endoct, "unroll", str(recording), "-o", str(panorama), "--overwrite"]
            peak_mb, seconds, busy = measured(command)
            row = f"{count:>7} {recorded / 1e6:>6.0f} MB {peak_mb:>5.0f} MB {seconds:>8.1f} {busy:>10.1f}"
            if before is not None:
                more = (peak_mb - before[1]) / (count - before[0]) * 1e3
                stored = samples_of(panorama) * BYTES_OF_PANORAMA[arguments.side] / count / 1e3
                row += f" {more:>10.1f} kB {stored:>9.1f} kB {recorded / count / 1e3:>10.1f} kB"
            print(row, flush=True)
            before = count, peak_mb


def samples_of(panorama: Path) -> int:
    """Return how many samples a panorama on disk has."""
    import xarray as xr

    with xr.open_zarr(panorama, chunks=None) as store:
        return int(store["intensity"].size)


if __name__ == "__main__":
    main()
