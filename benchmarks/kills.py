"""Kills commands at random moments and looks at what is left: ``python benchmarks/kills.py --kills 50 --seed 0``.

Each of `unroll`, `compare`, `export` with `--overwrite` and `dataset` is killed (SIGKILL, all its processes), where an
older output stands already; then the same command runs to its end. A kill has lost something where neither the old nor
the new output stands whole, where a file of the user's next to it has changed, where an output that anybody can see is
half-written, or where the next run leaves anything hidden behind.
"""

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from endoct.workbench.verifying import verify

ENDOCT = Path(sys.executable).with_name("endoct")
COMMANDS = ("unroll", "compare", "dataset", "export")


def prepare(folder: Path) -> None:
    """Make a specimen, an older output of each command, and files of the user's next to them."""
    run(folder, ["simulate", "-o", "specimen", "--preset", "learning", "--seed", "3"])
    for command in COMMANDS:
        run(folder, arguments(command))
    for place in (folder, folder / "set"):
        (place / "thesis.tex").write_text("years of work")


def arguments(command: str, count: int = 2) -> list[str]:
    """Return the command line of ``command``."""
    return {
        "unroll": ["unroll", "specimen/oct", "-o", "out.zarr", "--overwrite"],
        "compare": ["compare", "specimen/endoscope", "specimen/oct", "-o", "result", "--overwrite"],
        "dataset": ["dataset", "-o", "set", "--count", str(count), "--workers", "2"],
        "export": ["export", "result", "-o", "result.ome.zarr", "--overwrite"],
    }[command]


def run(folder: Path, arguments: list[str], kill_after_s: float | None = None) -> float:
    """Run a command, or kill it after a while with all that it has started; return the seconds it took."""
    start = time.monotonic()
    process = subprocess.Popen(
        [ENDOCT, *arguments], cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    try:
        status = process.wait(kill_after_s)
        if status not in (0, 3):
            raise RuntimeError(f"{arguments} ended with {status}")
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    return time.monotonic() - start


def lost(folder: Path) -> list[str]:
    """Say what is not as it should be; nothing, if all is well."""
    wrong = [
        f"{place / 'thesis.tex'} is gone"
        for place in (folder, folder / "set")
        if not (place / "thesis.tex").is_file() or (place / "thesis.tex").read_text() != "years of work"
    ]
    for name in ("out.zarr", "result", "result.ome.zarr", "specimen"):
        if not (folder / name).exists():
            wrong.append(f"{name} is gone")
        elif not verify(folder / name)[0].intact:
            wrong.append(f"{name}: {verify(folder / name)[0].differences}")
    differences = verify(folder / "set")[0].differences  # a set that is not finished lacks specimens, no more
    if differences.altered or differences.added or any("specimens" not in name for name in differences.missing):
        wrong.append(f"set: {differences}")
    return wrong


def hidden(folder: Path) -> list[str]:
    """Return what is hidden below a folder and is no part of a data set."""
    return [str(path) for path in folder.rglob(".*") if path.name not in (".lock", ".written.json", ".zarr")]


def main() -> None:
    """Kill, look, run again, look."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng = random.Random(options.seed)
    folder = Path(tempfile.mkdtemp(prefix="kills-"))
    prepare(folder)
    seconds = {command: run(folder, arguments(command, 4)) for command in COMMANDS}
    count, failures = 4, 0
    print("| kill | command | after | left | after the next run |\n|---|---|---|---|---|", flush=True)
    for kill in range(options.kills):
        command = COMMANDS[kill % len(COMMANDS)]
        count += 2 * (command == "dataset")
        after = rng.uniform(0, 1.05 * seconds[command])
        # a third of the kills in the last tenth, where outputs are put in their places
        after = seconds[command] * rng.uniform(0.9, 1.02) if rng.random() < 1 / 3 else after
        run(folder, arguments(command, count), kill_after_s=after)
        wrong = lost(folder)
        seconds[command] = 0.5 * seconds[command] + 0.5 * run(folder, arguments(command, count))
        again = lost(folder) + hidden(folder)
        failures += bool(wrong or again)
        print(f"| {kill} | {command} | {after:.1f} s | {wrong or 'whole'} | {again or 'whole'} |", flush=True)
    print(f"{options.kills} kills, {failures} with something lost, half-written or stale")
    shutil.rmtree(folder)
    sys.exit(bool(failures))


if __name__ == "__main__":
    main()
