"""Small faults put into the product, one at a time: which share of them the tests of the module catch.

    python -m benchmarks.mutants [--count 100] [--seed 0] [--since COMMIT] [--only fusion/scoring …] [-o FILE]

A mutant is one change of one line that changed since a commit. Of all kinds of fault equally many are drawn, by a seed,
each from a module of its own. It is caught where a test of its module, or of a near neighbour, fails that passes
without it. The quickest to prepare run first, and all within ``--seconds`` of processor time.
"""

import argparse
import ast
import importlib
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import pytest
from scipy import stats

from benchmarks.mutated_modules import NAMED, PACKAGES, ROOT, changed_lines, tests_of
from benchmarks.small_faults import KINDS, fault, faults_in

SINCE = "67ffa19"
LOADED = ("numpy", "scipy.ndimage", "scipy.optimize", "scipy.stats", "scipy.signal", "cv2", "numba", "zarr", "pydantic",
          "tyro", "tifffile", "pydicom", "skimage.measure", "jinja2", "rich")  # fmt: skip
"""Loaded once, for all mutants: libraries, never a module of the product."""
COMPILED_S = 20
"""So much longer may the tests of a module take whose machine code is compiled anew."""
SIMULATING = ("base/", "stitching/", "synthetic/")
"""Modules that the specimen which tests share is made by; without a fault in them it is made once for all mutants."""
PER_TEST, LONGEST = 2, 200
"""What has not ended after so many times the time, of the processor and of the clock, does not end."""


@dataclass(frozen=True)
class Mutant:
    """A fault of a kind in a line of a module, the module's ``source`` with it, and the tests that may catch it."""

    kind: str
    module: str
    line: int
    change: str
    source: str
    tests: tuple[str, ...]


def main() -> int:
    """Return 1 where fewer than wanted are caught."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mutants", description=__doc__)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--since", default=SINCE, help="only lines that changed since this commit")
    parser.add_argument("--only", nargs="+", default=[""], help="modules that begin so")
    parser.add_argument("--named", action="store_true", help="those that tests once let through")
    parser.add_argument("--seconds", type=int, default=10, help="processor time of the tests of each")
    parser.add_argument("--least", type=float, default=0.9, help="share that must be caught")
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    lines = {name: some for name, some in changed_lines(options.since).items() if name.startswith(tuple(options.only))}
    mutants = list(named()) if options.named else drawn(lines, options.count, options.seed)
    for name in LOADED:
        importlib.import_module(name)
    caught: dict[str, list[bool]] = {}
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as scratch:
        tree = copied_tree(Path(scratch) / "tree")
        specimen = shared_specimen(Path(scratch) / "quick_specimen")
        for mutant in mutants:
            by = caught_by(tree, mutant, options.seconds, specimen)
            caught.setdefault(mutant.kind, []).append(by is not None)
            said = f"{'LIVES ' if by is None else 'caught'} {mutant.kind:10} {mutant.module}:{mutant.line}  "
            said += f"{mutant.change}" + (f"  by {by}" if by else "")
            print(said, flush=True)
            if options.output:
                with options.output.open("a", encoding="utf-8") as file:
                    print(said, file=file)
    for kind, some in sorted(caught.items()):
        print(f"{kind}: {sum(some)} of {len(some)}")
    k, n = sum(map(sum, caught.values())), len(mutants)
    interval = stats.binomtest(k, n).proportion_ci(method="wilson")
    print(f"{k} of {n}, 95 % interval {interval.low:.0%} to {interval.high:.0%}, {time.monotonic() - began:.0f} s")
    return int(k / n < (1 if options.named else options.least))


def named() -> Iterator[Mutant]:
    """Yield the mutants that tests once let through."""
    for module, before, after, tests in NAMED:
        source = (ROOT / module).read_text("utf-8")
        if source.count(before) != 1:
            raise SystemExit(f"{module} no longer has {before!r}: name another mutant that does the same")
        line = source[: source.index(before)].count("\n") + 1
        changed = f"{before.strip()} → {after.strip() or 'nothing'}"
        yield Mutant("named", module, line, changed, source.replace(before, after), (tests,))


def drawn(lines: Mapping[str, frozenset[int]], count: int, seed: int) -> list[Mutant]:
    """Return ``count`` mutants in ``lines`` by module, of all kinds alike, of no module a second before the last."""
    random_ = random.Random(seed)
    trees = {module: ast.parse((ROOT / module).read_text("utf-8")) for module in sorted(lines)}
    some = {module: [one for one in faults_in(tree) if one[1] in lines[module]] for module, tree in trees.items()}
    mutants: list[Mutant] = []
    used: set[str] = set()
    while len(mutants) < count:
        kind = KINDS[len(mutants) % len(KINDS)]
        having = [module for module, faults in some.items() if any(one[0] == kind for one in faults)]
        module = random_.choice([name for name in having if name not in used] or having)
        used.add(module)
        _, line, *which = random_.choice([one for one in some[module] if one[0] == kind])
        made = fault(trees[module], *which)
        mutants.append(Mutant(kind, module, line, f"{made.before} → {made.after}", made.source, tests_of(module)))
    return mutants


def copied_tree(folder: Path) -> Path:
    """Return a copy of what git knows of the tree, and of what is new in it, with the links by which it is imported."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, capture_output=True, check=True, text=True,
    ).stdout  # fmt: skip
    for name in filter(None, listed.split("\0")):
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name, follow_symlinks=False)
        for compiled in (ROOT / name).parent.glob(f"__pycache__/{Path(name).stem}.*.nb?"):  # else all is compiled anew
            (folder / name).parent.joinpath("__pycache__").mkdir(exist_ok=True)
            shutil.copy2(compiled, (folder / name).parent / "__pycache__")
    links = folder / ".typing" / "endoct"
    links.mkdir(parents=True, exist_ok=True)
    for package in PACKAGES:
        if not (links / package).is_symlink():
            (links / package).symlink_to(Path("../..") / package)
    return folder


def shared_specimen(folder: Path) -> Path:
    """Simulate the specimen that tests share into ``folder``, in a process that loads nothing here; return that."""
    made = "import pathlib, sys; from endoct.synthetic.specimen import simulate as of; "
    made += "of(pathlib.Path(sys.argv[1]), preset='quick', seed=1000)"
    subprocess.run([sys.executable, "-c", made, str(folder)], check=True)
    return folder


def caught_by(tree: Path, mutant: Mutant, seconds: int, specimen: Path | None = None) -> str | None:
    """Return the test that fails with a mutant in its place in ``tree`` and passes without, None where none does.

    ``specimen`` is the one that tests share, simulated beforehand.
    """
    seconds += COMPILED_S * ("@compiled" in mutant.source)
    specimen = None if mutant.module.startswith(SIMULATING) else specimen
    file = tree / mutant.module
    sound, made = file.read_bytes(), file.stat().st_mtime_ns
    file.write_text(mutant.source, "utf-8")
    try:
        failed = first_failure(tree, mutant.tests, seconds, specimen)
    finally:
        file.write_bytes(sound)
        os.utime(file, ns=(made, made))  # what was compiled of it holds again
    if failed and first_failure(tree, [failed], seconds, specimen):
        print(f"{failed} fails without a mutant, or takes more than {PER_TEST * seconds} s: it catches nothing")
        return None
    return failed


def first_failure(tree: Path, tests: Sequence[str], seconds: int, specimen: Path | None = None) -> str | None:
    """Return the first test that fails in ``tree``, or does not end, or the module that cannot be loaded."""
    note = tree.parent / "running"
    note.write_text("")
    if (child := os.fork()) == 0:
        status = 1
        with suppress(BaseException):
            status = int(_fails(tree, tests, seconds, note, specimen))
        os._exit(status)
    until = time.monotonic() + LONGEST * seconds
    while not (ended := os.waitpid(child, os.WNOHANG))[0]:
        time.sleep(0.05)
        if time.monotonic() > until:
            os.kill(child, signal.SIGKILL)
    with suppress(ProcessLookupError):  # none of its own processes is left
        os.killpg(child, signal.SIGKILL)
    return (note.read_text() or tests[0]) if ended[1] else None


def _fails(tree: Path, tests: Sequence[str], seconds: int, note: Path, specimen: Path | None) -> bool:
    """Run tests in this process; return whether one failed before the time was up."""
    os.setpgid(0, 0)
    os.chdir(tree)
    silent = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(silent, stream)
    os.environ |= {"PYTHONPATH": str(tree / ".typing"), "OMP_NUM_THREADS": "1"}
    sys.path[:] = [str(tree / ".typing"), *(path for path in sys.path if Path(path or ".").resolve() != ROOT)]
    for name in [name for name in sys.modules if name.split(".")[0] == "benchmarks"]:
        del sys.modules[name]
    resource.setrlimit(resource.RLIMIT_CPU, (int(time.process_time()) + PER_TEST * seconds,) * 2)
    watch = _Watch(note, time.process_time() + seconds, specimen)
    options = ["-x", "-q", "-m", "not slow", "-p", "no:cacheprovider", "-p", "no:xdist"]
    options += ["-W", "ignore::pytest.PytestAssertRewriteWarning"]  # of the libraries that are loaded already
    pytest.main([*options, *tests], plugins=[watch])
    return watch.failed


class _Watch:
    """Has tests with costly fixtures run last, notes which one runs, and ends when the time is up."""

    def __init__(self, note: Path, until: float, specimen: Path | None) -> None:
        self._note, self._until, self._specimen = note, until, specimen
        self.failed = False

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items.sort(key=_is_costly)

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        if self._specimen is not None and (made := getattr(session.config, "_tmp_path_factory", None)) is not None:
            # where tests/conftest.py looks for it; a mutant may spoil it
            shutil.copytree(self._specimen, made.getbasetemp() / "quick_specimen")

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self._note.write_text(nodeid)

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        self.failed |= report.failed

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.failed |= report.failed

    def pytest_runtest_teardown(self, item: pytest.Item) -> None:
        if time.process_time() > self._until:
            item.session.shouldstop = "its time is up"


def _is_costly(item: pytest.Item) -> bool:
    """Say whether a test has a browser, or what is made once for several tests in a folder of its own."""
    fixtures = getattr(item, "_fixtureinfo").name2fixturedefs  # noqa: B009, pytest has no public name for it
    return any(name in ("browser", "page") for name in fixtures) or any(
        one.scope != "function" and "tmp_path_factory" in one.argnames for some in fixtures.values() for one in some
    )


if __name__ == "__main__":
    sys.exit(main())
