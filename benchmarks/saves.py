"""Saves landmarks on a page whose folder is replaced or deleted meanwhile.

    python benchmarks/saves.py --count 100

The folder is replaced by renaming, by an output with ``--overwrite``, or it is deleted, at a random moment about that
of the save. A save is lost where it was answered as done and lies nowhere, unless it was deleted with its folder; it is
misplaced where it lies in a folder of another comparison, in one that was made anew, or anywhere without having been
answered as done.
"""

import argparse
import json
import random
import shutil
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from http.client import HTTPConnection
from pathlib import Path

import uvicorn

from endoct.base.errors import EndoctError
from endoct.base.files.contents import output_digest
from endoct.base.files.output import new_output
from endoct.workbench import api
from endoct.workbench.page.serving import listening_socket, page_or_table
from endoct.workbench.running.outputs import COMPARISON

APART_S = 0.1
WRITING_S = 0.8
"""What it takes until an output stands in its place, about."""
PLACE = {"theta_rad": 2.0, "z_mm": 1.5}


def by_renaming(result: Path, second: Path) -> None:
    """Move the comparison away and the second one to its place."""
    result.rename(result.with_name("away"))
    second.rename(result)


def by_output(result: Path, second: Path) -> None:
    """Replace the comparison as `endoct compare --overwrite` does."""
    with suppress(EndoctError), new_output(result, COMPARISON, overwrite=True) as scratch:
        shutil.copytree(second, scratch)
    shutil.rmtree(second)


def by_deleting(result: Path, second: Path) -> None:
    """Delete the comparison."""
    shutil.rmtree(result, ignore_errors=True)
    shutil.rmtree(second)


WAYS: tuple[Callable[[Path, Path], None], ...] = (by_renaming, by_output, by_deleting)


@contextmanager
def serving(folder: Path) -> Iterator[int]:
    """Serve the page of ``folder``; yield the port."""
    with listening_socket("127.0.0.1", 0) as listening:
        port = listening.getsockname()[1]
        server = uvicorn.Server(uvicorn.Config(page_or_table(folder)("127.0.0.1", port), log_level="error"))
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
        thread.start()
        try:
            yield port
        finally:
            server.should_exit = True
            thread.join()


def save(port: int, output: str, name: str) -> int:
    """Save a pair with a name as the page of ``output`` does; return the status."""
    pair = {"a": PLACE, "b": PLACE, "role": "correct", "name": name, "sigma_mm": 0.05}
    headers = {"Origin": f"http://127.0.0.1:{port}", "Content-Type": "application/json"}
    connection = HTTPConnection("127.0.0.1", port, timeout=60)
    try:
        connection.request(
            "POST", f"/session.json?of={output}", json.dumps({"pairs": [pair], "based_on": None}), headers
        )
        return connection.getresponse().status
    finally:
        connection.close()


def attempt(
    folder: Path, comparisons: list[Path], way: Callable[[Path, Path], None], rng: random.Random
) -> tuple[int, str]:
    """Save while the folder is replaced; return the status, and what is wrong."""
    result, second = folder / "result", folder / "second"
    for source, place in zip(comparisons, (result, second), strict=True):
        shutil.copytree(source, place)
    first, other, inode = output_digest(result), output_digest(second), result.stat().st_ino
    name = f"{rng.getrandbits(64):x}"
    with serving(result) as port:
        save_after_s = rng.uniform(0, APART_S) + (way is by_output) * rng.uniform(0, WRITING_S)
        replace_after_s = rng.uniform(0, APART_S)
        replacing = threading.Thread(target=lambda: (time.sleep(replace_after_s), way(result, second)))
        replacing.start()
        time.sleep(save_after_s)
        status = save(port, first, name)
        replacing.join()
        late = save(port, first, f"{name} late") if output_digest(result) != first else 410
    found = {path.parent: path.read_text() for path in folder.rglob("session.json")}
    wrong = [f"in {place.name}, of another comparison" for place in found if output_digest(place) == other]
    if way is by_deleting:
        wrong += ["in a folder that was made anew"] * (result.exists() and result.stat().st_ino != inode)
    elif status == 200 and not any(name in text for text in found.values()):
        wrong.append("lost")
    if status != 200 and found:
        wrong.append("saved, but not answered so")
    if late != 410 or any("late" in text for text in found.values()):
        wrong.append(f"answered {late} once it was gone")
    return status, "; ".join(wrong)


def main() -> None:
    """Save, look, and say what was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng = random.Random(options.seed)
    folder = Path(tempfile.mkdtemp(prefix="saves-"))
    for seed in (1, 2):
        api.demo(folder / f"made-{seed}", preset="learning", seed=seed, progress=False)
    comparisons = [folder / f"made-{seed}" / "comparison" for seed in (1, 2)]
    statuses: Counter[str] = Counter()
    failures = 0
    for number in range(options.count):
        way = WAYS[number % len(WAYS)]
        (folder / "trial").mkdir()
        status, wrong = attempt(folder / "trial", comparisons, way, rng)
        statuses[f"{way.__name__}: {status}"] += 1
        failures += bool(wrong)
        if wrong:
            print(f"{number}, {way.__name__}, answered {status}: {wrong}", flush=True)
        shutil.rmtree(folder / "trial")
    shutil.rmtree(folder)
    print(", ".join(f"{name} × {count}" for name, count in sorted(statuses.items())))
    print(f"{options.count} saves, {failures} lost or misplaced")
    sys.exit(bool(failures))


if __name__ == "__main__":
    main()
