"""Kills commands at random moments and looks at what is left: ``python benchmarks/kills.py --kills 50 --seed 0``.

Each of `unroll`, `compare`, `export`, `calibrate`, `train` with `--overwrite`, `dataset`, `bench make` and the saving
of a mask is killed (SIGKILL, all its processes), where an older output stands already; then the same command runs to
its end. A kill has lost something where neither the old nor the new output stands whole, where a file of the user's
next to it has changed, where an output that anybody can see is half-written, or where the next run leaves anything
hidden behind. ``--commands`` names some of them.
"""

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable
from pathlib import Path

from PIL import Image

from endoct.base.errors import EndoctError
from endoct.fusion.segmentation.learned.network import load_eye
from endoct.workbench.bench.published.specimen_set import check_specimen, read_set
from endoct.workbench.verifying import verify

ENDOCT = Path(sys.executable).with_name("endoct")
COMMANDS = ("unroll", "compare", "dataset", "export", "calibrate", "train", "make", "mask")
GROWING = {"dataset": 2, "make": 1, "mask": 1}
"""By how much the output of a command grows from one kill to the next."""
MAKE = """
import sys
sys.path.insert(0, "tests")
from pathlib import Path
from published_sets import tiny
from endoct.workbench.bench.published import making
from endoct.workbench.running.progress import SilentStages
if __name__ == "__main__":
    making.load_definition = lambda name: tiny(int(sys.argv[2]))
    making._check_published = lambda listed: None
    making.make_set(Path(sys.argv[1]), "endoct-bench-2", workers=2, stages=SilentStages())
"""
"""Makes a set of few, small specimens; `endoct bench make` takes hours."""
MASK = """
import sys
from pathlib import Path
import numpy as np
from endoct.base.errors import EndoctError
from endoct.stitching.grid import SurfaceGrid
from endoct.workbench.page.drawn_masks import _write
grid = SurfaceGrid.full_circle(400, 2048, z0_mm=0.5, dz_mm=0.02, radius_mm=1.25)
mask = np.random.default_rng(1).random(grid.shape) > 0.5
for k in range(int(sys.argv[2])):
    if not (Path(sys.argv[1]) / "masks" / "oct" / f"anna_{k}.png").exists():
        _write(Path(sys.argv[1]), "oct", f"anna_{k}", mask, grid)
"""
"""Saves the masks that are missing, as the page does."""


def prepare(folder: Path, commands: list[str]) -> None:
    """Make specimens, an older output of each command, and files of the user's next to them."""
    run(folder, ["simulate", "-o", "specimen", "--preset", "learning", "--seed", "3"])
    if "calibrate" in commands:
        run(folder, ["simulate", "-o", "tube", "--preset", "tube", "--seed", "30"])
    if "compare" not in commands and {"mask", "export"} & {*commands}:
        run(folder, arguments("compare"))
    for command in commands:
        run(folder, arguments(command))
    NEEDED.update(STANDING & {path.name for path in folder.iterdir()})
    for place in (folder, *(folder / name for name in ("set",) if (folder / name).is_dir())):
        (place / "thesis.tex").write_text("years of work")


def arguments(command: str, count: int = 2) -> list[str]:
    """Return the command line of ``command``."""
    return {
        "calibrate": [
            "calibrate",
            "endoscope",
            "tube/endoscope",
            "--target",
            "tube/tube.toml",
            "-o",
            "cited.toml",
            "--overwrite",
        ],
        "train": ["train", "-o", "eye", "--bores", "1", "--steps", "1", "--batch", "1", "--overwrite"],
        "make": ["-c", MAKE, "bench", str(count)],
        "mask": ["-c", MASK, "result", str(20 * count)],
        "unroll": ["unroll", "specimen/oct", "-o", "out.zarr", "--overwrite"],
        "compare": ["compare", "specimen/endoscope", "specimen/oct", "-o", "result", "--overwrite"],
        "dataset": ["dataset", "-o", "set", "--count", str(count), "--workers", "2"],
        "export": ["export", "result", "-o", "result.ome.zarr", "--overwrite"],
    }[command]


def run(folder: Path, arguments: list[str], kill_after_s: float | None = None) -> float:
    """Run a command, or kill it after a while with all that it has started; return the seconds it took."""
    start = time.monotonic()
    process = subprocess.Popen(
        [sys.executable if arguments[0] == "-c" else ENDOCT, *arguments],
        cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[1] / "tests")},
    )  # fmt: skip
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
        if place.is_dir()
        and (not (place / "thesis.tex").is_file() or (place / "thesis.tex").read_text() != "years of work")
    ]
    for name in sorted(NEEDED):
        if not (folder / name).exists():
            wrong.append(f"{name} is gone")
        elif not verify(folder / name)[0].intact:
            wrong.append(f"{name}: {verify(folder / name)[0].differences}")
    if (folder / "set").is_dir():
        differences = verify(folder / "set")[0].differences  # one that is not finished lacks specimens, no more
        if differences.altered or differences.added or any("specimens" not in name for name in differences.missing):
            wrong.append(f"set: {differences}")
    return wrong + [f"{name}: {error}" for name, look in LOOKS.items() if (error := _refused(look, folder / name))]


def _refused(look: Callable[[Path], object], path: Path) -> str:
    """Return why an output of a kind of its own cannot be read, "" where it can or is none of this run's."""
    if path not in MADE and not path.exists():
        return ""
    MADE.add(path)
    try:
        look(path)
    except (EndoctError, ValueError, OSError) as error:
        return str(error)
    return ""


def _look_at_cited(path: Path) -> None:
    if not tomllib.loads(path.read_text())["standard_errors"]:
        raise ValueError("it is empty")
    Image.open(path.with_suffix(".png")).load()


def _look_at_eye(path: Path) -> None:
    load_eye(path / "endoscope.safetensors")
    json.loads((path / "card.json").read_text())


def _look_at_bench(path: Path) -> None:
    for entry in read_set(path).specimens:
        check_specimen(path, entry)


def _look_at_masks(path: Path) -> None:
    for mask in path.glob("*.png"):
        Image.open(mask).load()
        tomllib.loads(mask.with_suffix(".toml").read_text())["z0_mm"]


MADE: set[Path] = set()
LOOKS: dict[str, Callable[[Path], object]] = {
    "cited.toml": _look_at_cited,
    "eye": _look_at_eye,
    "bench": _look_at_bench,
    "result/masks/oct": _look_at_masks,
}
STANDING = {"specimen", "out.zarr", "result", "result.ome.zarr", "eye"}
NEEDED: set[str] = set()
"""Those of them that were made must stand whole, whatever is killed."""


def hidden(folder: Path) -> list[str]:
    """Return what is hidden below a folder and is no part of a data set."""
    return [str(path) for path in folder.rglob(".*") if path.name not in (".lock", ".written.json", ".zarr")]


def main() -> None:
    """Kill, look, run again, look."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--commands", nargs="+", default=[*COMMANDS], choices=COMMANDS)
    options = parser.parse_args()
    rng, commands = random.Random(options.seed), options.commands
    folder = Path(tempfile.mkdtemp(prefix="kills-"))
    prepare(folder, commands)
    seconds = {command: run(folder, arguments(command, 3)) for command in commands}
    counts, failures = dict.fromkeys(commands, 3), 0
    print("| kill | command | after | left | after the next run |\n|---|---|---|---|---|", flush=True)
    for kill in range(options.kills):
        command = commands[kill % len(commands)]
        counts[command] += GROWING.get(command, 0)
        count = counts[command]
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
