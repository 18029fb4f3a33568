"""Makes one data set in four ways, and says whether they agree and how long each took.

    python benchmarks/dataset_scaling.py --count 200 [--preset learning] [--seed 1000] [--keep DIR] [--again]

By one process; by two workers; by two workers of which one gets SIGKILL when half is done; and by a `dask scheduler`
with two `dask worker` processes on loopback. Every file is hashed anew here, but for the records, which hold times.
A specimen counts as made once for each record file that appeared, so one made twice shows even where both
are the same. Of the seconds of the whole command, the start is what passes until the first specimen is begun: loading
the program, and for workers their cluster; work is what passes from there until the last record; the end makes the
manifest. The efficiency of two workers is that of the work, and of the whole command next to it. Either says little
where other work runs at the same time: then the processor time of the two runs differs (of an existing cluster it is
the client's), and so does that of one process at the beginning and once more at the end, which --again adds.
"""

import argparse
import hashlib
import json
import math
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import psutil

ENDOCT = str(Path(sys.executable).with_name("endoct"))
DASK = str(Path(sys.executable).with_name("dask"))
Watch = Callable[[psutil.Process, int], None]


@dataclass(frozen=True)
class Run:
    """What one way gave; of its ``seconds``, ``start`` passed before the first specimen was begun, ``work`` after."""

    seconds: float
    start: float
    work: float
    cpu_seconds: float
    appeared: int
    files: dict[str, str]
    scratch_left: int


def make(root: Path, options: list[str], watch: Watch) -> Run:
    """Run `endoct dataset`; call ``watch`` with its process and the number of records that have appeared."""
    start, cpu = time.perf_counter(), cpu_of_children()
    process = psutil.Popen([ENDOCT, "dataset", "-o", str(root), *options, "--json"], stdout=subprocess.DEVNULL)
    seen: set[tuple[str, int]] = set()
    begun, last = math.inf, 0.0
    while True:
        ended = process.poll() is not None
        appeared = {(path.name, path.stat().st_ino) for path in root.glob("records/*.json")} - seen
        if appeared:
            last = time.perf_counter() - start
            begun = min(begun, *(last - seconds_of(root / "records" / name) for name, _ in appeared))
            seen |= appeared
        if ended:
            break
        watch(process, len(seen))
        time.sleep(0.05)
    seconds = time.perf_counter() - start
    if process.returncode:
        sys.exit(f"endoct dataset {' '.join(options)} ended with {process.returncode}")
    scratch = sum(path.name.startswith(".making") for path in root.rglob(".*"))
    return Run(seconds, begun, last - begun, cpu_of_children() - cpu, len(seen), hashes(root), scratch)


def seconds_of(record: Path) -> float:
    """Return how long the specimen of a record took to make."""
    return float(json.loads(record.read_text(encoding="utf-8"))["seconds"])


def cpu_of_children() -> float:
    """Return the processor time of all processes that this one has waited for, and of those they have."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def hashes(root: Path) -> dict[str, str]:
    """Return sha256 by path of every file but the records and the lock."""
    files = [path for path in root.rglob("*") if path.is_file() and path.name != ".lock"]
    return {
        path.relative_to(root).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in files
        if path.parent != root / "records"
    }


def kill_at(count: int, killed: list[int]) -> Watch:
    """Return a watch that sends SIGKILL to one worker, which is at work, when ``count`` records are there."""

    def watch(process: psutil.Process, records: int) -> None:
        if records >= count and not killed:
            workers = [p for p in process.children(recursive=True) if "spawn_main" in " ".join(p.cmdline())]
            busiest = max(workers, key=lambda p: sum(p.cpu_times()[:2]))
            os.kill(busiest.pid, signal.SIGKILL)
            killed.append(busiest.pid)

    return watch


@contextmanager
def cluster(folder: Path) -> Iterator[str]:
    """Run a scheduler and two workers on loopback, as a user would start them; yield the scheduler's address."""
    address_file = folder / "scheduler.json"
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": environment, "cwd": folder}
    scheduler = [
        DASK,
        "scheduler",
        "--host",
        "127.0.0.1",
        "--port",
        "0",
        "--no-dashboard",
        "--scheduler-file",
        str(address_file),
    ]
    worker = [
        DASK,
        "worker",
        "--scheduler-file",
        str(address_file),
        "--host",
        "127.0.0.1",
        "--nthreads",
        "1",
        "--no-dashboard",
    ]
    with ExitStack() as stack:
        for command in (scheduler, worker, worker):
            process = subprocess.Popen(command, **quiet)
            stack.callback(process.wait, 30)
            stack.callback(process.terminate)
            deadline = time.monotonic() + 60
            while not address_file.exists():
                if time.monotonic() > deadline:
                    sys.exit("the scheduler did not start within a minute")
                time.sleep(0.1)
        yield json.loads(address_file.read_text())["address"]


def main() -> None:
    """Make the set in four ways and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--preset", default="learning")
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--keep", type=Path, help="an empty folder to keep the four sets in")
    parser.add_argument("--again", action="store_true", help="make the set by one process once more at the end")
    arguments = parser.parse_args()
    options = ["--count", str(arguments.count), "--preset", arguments.preset, "--seed", str(arguments.seed)]
    killed: list[int] = []
    runs: dict[str, Run] = {}
    with ExitStack() as stack:
        folder = arguments.keep or Path(stack.enter_context(tempfile.TemporaryDirectory()))
        folder.mkdir(parents=True, exist_ok=True)
        ways: dict[str, tuple[list[str], Watch]] = {
            "one process": (["--workers", "1"], lambda *_: None),
            "two workers": (["--workers", "2"], lambda *_: None),
            "two workers, one killed": (["--workers", "2"], kill_at(arguments.count // 2, killed)),
        }
        for name, (more, watch) in ways.items():
            runs[name] = make(folder / name.replace(" ", "-").replace(",", ""), options + more, watch)
            print_row(name, runs[name], arguments.count)
        with tempfile.TemporaryDirectory() as elsewhere, cluster(Path(elsewhere)) as address:
            name = "existing cluster"
            runs[name] = make(folder / "existing-cluster", [*options, "--scheduler", address], lambda *_: None)
            print_row(name, runs[name], arguments.count)
        if arguments.again:
            name = "one process again"
            runs[name] = make(folder / "again", [*options, "--workers", "1"], lambda *_: None)
            print_row(name, runs[name], arguments.count)
    first, second = runs["one process"], runs["two workers"]
    same = all(run.files == first.files for run in runs.values())
    print(f"files in each: {len(first.files)}; the same in all: {'yes' if same else 'NO'}; killed: {len(killed)}")
    print(f"load of the machine now: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    for what, ratio in (("work", first.work / second.work), ("whole command", first.seconds / second.seconds)):
        print(f"one to two workers, {what}: {ratio:.2f} times as fast, efficiency {ratio / 2:.0%}")
    print(f"processor time of two workers over that of one process: {second.cpu_seconds / first.cpu_seconds:.2f}")
    sys.exit(0 if same and killed and all(run.appeared == arguments.count for run in runs.values()) else 1)


def print_row(name: str, run: Run, count: int) -> None:
    """Print the row of one way."""
    rate = 3600 * count / run.work
    print(
        f"{name:26s} {run.seconds:7.1f} s = {run.start:.1f} start + {run.work:.1f} work + "
        f"{run.seconds - run.start - run.work:.1f} end  {run.cpu_seconds:7.1f} s cpu  {rate:6.0f} an hour  "
        f"made {run.appeared} of {count}  made twice {run.appeared - count}  scratch left {run.scratch_left}",
        flush=True,
    )


if __name__ == "__main__":
    main()
