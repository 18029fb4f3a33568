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
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tifffile
from numpy.typing import NDArray

from endoct.modalities.reading.recording import open_stack

IMPORTED = "import xarray, zarr, endoct.workbench.api, endoct.modalities.{}.plugin"
BYTES_OF_PANORAMA = {"oct": 13, "endoscope": 9}  # a sample: float32 of intensity, weight and depth, and valid
WATCHED = """
import os, sys, time
start = time.perf_counter()
process = os.posix_spawn(sys.argv[1], sys.argv[1:], os.environ, file_actions=[(os.POSIX_SPAWN_DUP2, 2, 1)])
_, status, used = os.wait4(process, 0)
print(used.ru_maxrss, time.perf_counter() - start, used.ru_utime + used.ru_stime)
sys.exit(os.waitstatus_to_exitcode(status))
"""


def measured(command: list[str]) -> tuple[float, float, float]:
    """Run a command; return its largest resident set, MB, and seconds of clock and processors.

    Not as a child of this process: on Linux the largest resident set of a program begins with that of its parent.
    """
    run = subprocess.run([sys.executable, "-c", WATCHED, *command], stdout=subprocess.PIPE, text=True, check=True)
    resident, seconds, busy = map(float, run.stdout.split())
    return resident * (1 if sys.platform == "darwin" else 1024) / 1e6, seconds, busy


def write_recording(specimen: Path, side: str, count: int, width: int, folder: Path) -> None:
    """Write a recording of ``count`` slices of ``width`` A-scans, or frames of so many columns, with its sidecar.

    Slices keep their depth samples, frames their shape.
    """
    stack = open_stack(specimen / side / "pullback.tif" if side == "oct" else specimen / side)
    first = np.asarray(stack[0])
    size = width, len(first) if side == "oct" else round(width * len(first) / first.shape[1])
    how = cv2.INTER_AREA if width < first.shape[1] else cv2.INTER_LINEAR

    def frames() -> Iterator[NDArray[Any]]:
        for k in range(count):
            image = np.ascontiguousarray(stack[place_of(k, len(stack), forth_and_back=side == "oct")])
            enlarged = cv2.resize(image, size, interpolation=how)
            noise = np.random.default_rng(k).integers(-1, 2, enlarged.shape)
            yield np.clip(enlarged + noise, 0, np.iinfo(image.dtype).max).astype(image.dtype)

    folder.mkdir(parents=True)
    shutil.copy(specimen / side / "acquisition.toml", folder)
    shape = count, *size[::-1], *first.shape[2:]
    tifffile.imwrite(
        folder / "recording.tif",
        frames(),
        shape=shape,
        dtype=first.dtype,
        photometric="rgb" if first.ndim == 3 else "minisblack",
        bigtiff=np.prod(shape) * first.itemsize > 2**31,
    )


def place_of(k: int, n: int, *, forth_and_back: bool) -> int:
    """Return which of ``n`` frames is the ``k``-th of a recording that repeats them."""
    turn, place = divmod(k, n)
    return n - 1 - place if forth_and_back and turn % 2 else place


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
                width = arguments.ascans if arguments.side == "oct" else arguments.width
                write_recording(specimen, arguments.side, count, width, recording)
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
