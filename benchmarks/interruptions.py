"""Interrupts commands at random moments (SIGINT, SIGTERM) and looks how long they take to end, and what they leave.

    python benchmarks/interruptions.py commands --count 100 [--seed 0]
    python benchmarks/interruptions.py scheduler --count 50 [--seed 0]

`commands`: each of endoct's, a third of the times with an empty cache of machine code, and a third by three signals. A
command has failed that has not ended after two seconds, prints a trace, or leaves anything but what it keeps.

`scheduler`: `endoct dataset --scheduler` with two workers of an existing cluster, whose scheduler is lost at every
fifth moment; then the same command runs to its end. A set is stranded where that refuses it, where it is another than
one that was made without interruption, or where anything is left in it.
"""

import argparse
import os
import random
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil

from endoct.base.errors import EndoctError
from endoct.workbench import verify

ENDOCT = str(Path(sys.executable).with_name("endoct"))
DASK = str(Path(sys.executable).with_name("dask"))
END_WITHIN_S = 2.0
LONGEST_S = 60.0
SIGNALS = signal.SIGINT, signal.SIGTERM
COMMANDS = {
    "simulate": ["simulate", "-o", "new", "--preset", "learning"],
    "demo": ["demo", "-o", "new", "--preset", "learning"],
    "unroll": ["unroll", "specimen/oct", "-o", "new.zarr"],
    "compare": ["compare", "specimen/endoscope", "specimen/oct", "-o", "new"],
    "report": ["report", "result"],
    "export ome-zarr": ["export", "result", "-o", "new.ome.zarr"],
    "export ply": ["export", "result", "-o", "new.ply", "--vertex-mm", "0.005"],
    "dataset": ["dataset", "-o", "new", "--count", "3", "--workers", "2"],
    "dataset by one": ["dataset", "-o", "new", "--count", "3", "--workers", "1"],
    "bench": ["bench", "segmentation", "--count", "2", "-o", "new"],
    "summarise": ["summarise", "result", "-o", "new"],
    "verify": ["verify", "result"],
    "info": ["info", "specimen/oct"],
    "serve": ["serve", "result", "--port", "0"],
    "help": ["--help"],
}


def main() -> None:
    """Interrupt, look, and say what was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["commands", "scheduler"])
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="of the commands, those whose names begin so")
    options = parser.parse_args()
    rng = random.Random(options.seed)
    folder = Path(tempfile.mkdtemp(prefix="interruptions-"))
    try:
        if options.what == "commands":
            failures = interrupt_commands(folder, options.count, rng, options.only)
        else:
            failures = interrupt_data_sets(folder, options.count, rng)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    sys.exit(bool(failures))


def interrupt_commands(folder: Path, count: int, rng: random.Random, only: str) -> int:
    """Interrupt each command in turn; return how many failed."""
    run(folder, ["simulate", "-o", "specimen", "--preset", "learning", "--seed", "3"])
    run(folder, ["compare", "specimen/endoscope", "specimen/oct", "-o", "result"])
    names = [name for name in COMMANDS if name.startswith(only)]
    seconds = {name: took(folder, COMMANDS[name]) for name in names}
    failures, slowest = 0, dict.fromkeys(names, 0.0)
    print("| command | signal after | ended after | status | wrong |\n|---|---|---|---|---|", flush=True)
    for number in range(count):
        name = names[number % len(names)]
        before = everything(folder)
        environment = {"NUMBA_CACHE_DIR": str(folder / f"compiled-{number}")} if rng.random() < 1 / 3 else {}
        after_s = rng.uniform(0, seconds[name])
        number_sent = rng.choice(SIGNALS)
        process = start(folder, COMMANDS[name], environment)
        time.sleep(after_s)
        sent = time.monotonic()
        process.send_signal(number_sent)
        for _ in range(rng.choice([0, 0, 2])):
            time.sleep(rng.uniform(0, 0.1))
            process.send_signal(rng.choice(SIGNALS))
        status, said = end(process)
        ended_s = time.monotonic() - sent
        children = still_running(process.pid)
        shutil.rmtree(folder / f"compiled-{number}", ignore_errors=True)
        wrong = [] if ended_s <= END_WITHIN_S else ["late"]
        wrong += ["a trace"] if "Traceback" in said or "Exception ignored" in said else []
        wrong += [f"goes on: {child}" for child in children]
        new = sorted(everything(folder) - before)
        if status and new and not is_whole(folder):
            wrong.append(f"left: {', '.join(new[:6])}")
        clear(folder)
        slowest[name] = max(slowest[name], ended_s)
        failures += bool(wrong)
        print(
            f"| {name} | {number_sent.name} {after_s:.2f} s | {ended_s:.2f} s | {status} | {'; '.join(wrong)} |",
            flush=True,
        )
        if "a trace" in wrong:
            print(said[-3000:], flush=True)
    print(
        f"{count} interruptions, {failures} failed; the slowest end of each, s: "
        + ", ".join(f"{name} {worst:.2f}" for name, worst in slowest.items())
    )
    return failures


def interrupt_data_sets(folder: Path, count: int, rng: random.Random) -> int:
    """Interrupt data sets that the workers of a cluster make; return how many were stranded."""
    arguments = ["dataset", "--count", "2", "--seed", "5"]
    start_s = time.monotonic()
    run(folder, [*arguments, "-o", "whole", "--workers", "2"])
    longest_s = time.monotonic() - start_s
    stranded = 0
    print("| moment | what | ended after | then | wrong |\n|---|---|---|---|---|", flush=True)
    with cluster() as (port, lose_scheduler):
        command = [*arguments, "-o", "set", "--scheduler", f"tcp://127.0.0.1:{port}"]
        for number in range(count):
            after_s = rng.uniform(0, longest_s)
            process = start(folder, command, {})
            time.sleep(after_s)
            sent = time.monotonic()
            if number % 5 == 4:
                what = "scheduler lost"
                lose_scheduler()
            else:
                chosen = rng.choice(SIGNALS)
                what = chosen.name
                process.send_signal(chosen)
            status, said = end(process)
            ended_s = time.monotonic() - sent
            wrong = ["a trace"] if "Traceback" in said else []
            if status == 130 and ended_s > END_WITHIN_S:
                wrong.append("late")
            if rng.random() < 0.5:
                time.sleep(rng.uniform(0, 4))  # workers finish what they were at, or not
            again = subprocess.run([ENDOCT, *command], cwd=folder, capture_output=True, text=True, check=False)
            if again.returncode:
                wrong.append(f"stranded: {again.stderr.strip().splitlines()[-1]}")
            elif different := differences(folder / "whole", folder / "set"):
                wrong.append(f"another set: {different}")
            stranded += bool(wrong)
            print(
                f"| {after_s:.1f} s | {what} | {ended_s:.2f} s | {again.returncode} | {'; '.join(wrong)} |", flush=True
            )
            if "a trace" in wrong:
                print(said[-3000:], flush=True)
            settle(folder / "set")
    print(f"{count} interruptions, {stranded} stranded")
    return stranded


@contextmanager
def cluster() -> Iterator[tuple[int, object]]:
    """Yield the port of a scheduler with two workers, and what ends all three and starts them anew."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    running: list[subprocess.Popen[bytes]] = []

    def begin() -> None:
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        scheduler = [DASK, "scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard"]
        worker = [DASK, "worker", f"tcp://127.0.0.1:{port}", "--nthreads", "1", "--nworkers", "2", "--no-dashboard"]
        running[:] = [subprocess.Popen(one, **quiet) for one in (scheduler, worker)]  # type: ignore[call-overload]
        time.sleep(4)

    def finish() -> None:
        running[0].kill()
        running[1].terminate()
        for one in running:
            one.wait()

    def lose_scheduler() -> None:
        finish()
        begin()

    begin()
    try:
        yield port, lose_scheduler
    finally:
        finish()


def differences(whole: Path, actual: Path) -> str:
    """Say how a set differs from one that was made at once: in anything but records, which hold times."""

    def files(root: Path) -> dict[str, bytes]:
        every = (path for path in root.rglob("*") if path.is_file())
        return {path.relative_to(root).as_posix(): path.read_bytes() for path in every if path.parent.name != "records"}

    one, other = files(whole), files(actual)
    return ", ".join(sorted(name for name in one.keys() | other.keys() if one.get(name) != other.get(name))[:3])


def settle(root: Path) -> None:
    """Remove a set, also where a worker is still writing into it."""
    for _ in range(100):
        shutil.rmtree(root, ignore_errors=True)
        time.sleep(0.1)
        if not root.exists():
            return


def start(folder: Path, arguments: list[str], environment: dict[str, str]) -> "subprocess.Popen[str]":
    """Start a command in a group of its own."""
    return subprocess.Popen(
        [ENDOCT, *arguments], cwd=folder, env={**os.environ, **environment}, text=True, start_new_session=True,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip


def end(process: "subprocess.Popen[str]") -> tuple[int, str]:
    """Wait for a command, and kill it where it does not end; return its status and what it said."""
    try:
        said, _ = process.communicate(timeout=LONGEST_S)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        said, _ = process.communicate()
    return process.returncode, said


def still_running(group: int) -> list[str]:
    """Return what goes on of a command's group half a second later; it is killed then."""
    time.sleep(0.5)
    going_on = []
    for process in psutil.process_iter(["status", "cmdline"]):
        with suppress(psutil.Error, ProcessLookupError):
            if os.getpgid(process.pid) == group and process.info["status"] != psutil.STATUS_ZOMBIE:
                going_on.append(" ".join(process.info["cmdline"])[-80:])
                process.kill()
    return going_on


def is_whole(folder: Path) -> bool:
    """Say whether what a command left is a whole output, a data set that is begun, or the cases of a bench."""
    left = [path for path in folder.iterdir() if re.match(r"\.?(endoct-)?new", path.name)]
    is_begun = [(path / "dataset.json").exists() or path.name == "new.unfinished" for path in left]
    with suppress(EndoctError):
        return all(begun or verify(path)[0].intact for path, begun in zip(left, is_begun, strict=True))
    return False


def run(folder: Path, arguments: list[str]) -> None:
    """Run a command to its end."""
    subprocess.run([ENDOCT, *arguments], cwd=folder, check=True, capture_output=True)


def took(folder: Path, arguments: list[str]) -> float:
    """Return how long a command takes, half a minute at most; of one that serves, until it answers."""
    begun = time.monotonic()
    process = start(folder, arguments, {})
    try:
        if arguments[0] == "serve" and process.stdout:
            process.stdout.readline()
        else:
            process.wait(30)
    except subprocess.TimeoutExpired:
        pass
    seconds = time.monotonic() - begun
    os.killpg(process.pid, signal.SIGKILL) if process.poll() is None else None
    process.communicate()
    clear(folder)
    return seconds


def everything(folder: Path) -> set[str]:
    """Return what lies in the folder and in that for temporary files of endoct's."""
    own = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if "compiled-" not in str(path)}
    return own | {str(path) for path in Path(tempfile.gettempdir()).glob("endoct-*")}


def clear(folder: Path) -> None:
    """Remove what commands made."""
    for path in folder.iterdir():
        if re.match(r"\.?(endoct-)?new", path.name):
            shutil.rmtree(path) if path.is_dir() else path.unlink()


if __name__ == "__main__":
    main()
