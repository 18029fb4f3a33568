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
import sys
import tempfile
from pathlib import Path

from endoct.workbench.bench.cases.speed_jobs import write_recording
from endoct.workbench.running.measured import measure_program

IMPORTED = "import xarray, zarr, endoct.workbench.api, endoct.modalities.{}.plugin"
BYTES_OF_PANORAMA = {"oct": 13, "endoscope": 9}  # a sample: float32 of intensity, weight and depth, and valid


def measured(command: list[str]) -> tuple[float, float, float]:
    """Run a command; return its largest resident set, MB, and seconds of clock and processors."""
    run = measure_program(command, None)
    return run.peak_mb, run.seconds[0], run.cpu_seconds[0]


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
