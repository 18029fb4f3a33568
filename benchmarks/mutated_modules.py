"""Which modules are mutated, which tests are their own, and mutants that tests once let through."""

import re
import subprocess
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("base", "fusion", "modalities", "stitching", "synthetic", "workbench")
MOST_TESTS = 4
"""Test modules of a module: its own and its nearest neighbours."""
NOT_RUN = ("third_party", "docs", "browser")
"""In the paths of tests: they install packages, run whole pages or start a Chromium."""

IMPORTS = re.compile(r"^ *from (endoct[\w.]*) import (\([^)]*\)|.*)$|^ *import (endoct[\w.]*)", re.MULTILINE)
"""What a module imports of the product: read as text, since there are a thousand of them."""


def changed_lines(since: str) -> Mapping[str, frozenset[int]]:
    """Return the product's modules that changed since a commit, each with the numbers of the lines that did."""
    command = ["git", "diff", "--unified=0", "--no-prefix", "--no-renames", "--diff-filter=AM", since, "--", *PACKAGES]
    shown = subprocess.run(command, cwd=ROOT, capture_output=True, check=True).stdout.decode("utf-8", "replace")
    lines: dict[str, set[int]] = {}
    for name, first, many in re.findall(r"^\+\+\+ (\S+\.py)$|^@@ -\S+ \+(\d+)(?:,(\d+))? @@", shown, re.MULTILINE):
        if name:
            changed = lines.setdefault(name, set())
        elif lines:  # a file that is no module may come first
            changed.update(range(int(first), int(first) + int(many or 1)))
    return {name: frozenset(changed) for name, changed in lines.items()}


@cache
def tests_of(module: str) -> tuple[str, ...]:
    """Return the tests of a module: those of its name, those that import it, those of what imports it, of its folder.

    Among those alike the ones come first that share most folders with it, and have fewest of their own.
    """
    path = Path(module)
    own = [f"tests/{folder}/test_{path.stem}.py" for folder in (path.parent, path.parent.parent)]
    tests = dict.fromkeys(name for name in own if (ROOT / name).is_file())
    ring, seen = [module], {module}
    while ring and len(tests) < MOST_TESTS:
        near = [test for test, names in _imports("tests").items() if names & {_dotted(one) for one in ring}]
        tests |= dict.fromkeys(sorted(near, key=lambda test: (-_shared(test, module), len(Path(test).parts), test)))
        ring = sorted({above for one in ring for above in _importers(one)} - seen)
        seen |= set(ring)
    folder = max((test for test in _imports("tests")), key=lambda test: _shared(test, module))
    tests |= dict.fromkeys(test for test in _imports("tests") if Path(test).parent == Path(folder).parent)
    return tuple(tests)[:MOST_TESTS]


def _importers(module: str) -> list[str]:
    return [other for package in PACKAGES for other, names in _imports(package).items() if _dotted(module) in names]


def _shared(test: str, module: str) -> int:
    pairs = zip(Path(test).parts[1:-1], Path(module).parts[:-1], strict=False)
    return sum(one == other for one, other in pairs)


@cache
def _imports(folder: str) -> Mapping[str, frozenset[str]]:
    """Return by module of a folder the full names that it imports, each also as if it were a module."""
    pattern = "test_*.py" if folder == "tests" else "*.py"
    return {
        str(path.relative_to(ROOT)): frozenset(_imported(path.read_text("utf-8")))
        for path in sorted((ROOT / folder).rglob(pattern))
        if not any(word in str(path.relative_to(ROOT)) for word in NOT_RUN) or folder != "tests"
    }


def _imported(source: str) -> Iterator[str]:
    for module, names, whole in IMPORTS.findall(source):
        yield module or whole
        yield from (f"{module}.{name}" for name in re.findall(r"\w+", names))


def _dotted(module: str) -> str:
    return "endoct." + module.removesuffix(".py").removesuffix("/__init__").replace("/", ".")


NAMED: tuple[tuple[str, str, str, str], ...] = (
    (
        "fusion/pair_overlaps.py",
        'one = Surface("", *placement.mask(masks[0], a.panorama.valid))',
        'one = Surface("", placement.mask(masks[0], a.panorama.valid)[0], b.panorama.valid | True)',
        "tests/fusion/test_comparison.py",
    ),
    ("fusion/scoring/cells.py", " & ~side.mask", "", "tests/fusion/scoring/test_budget.py"),
    ("modalities/oct/surface/wall.py", "lead = n_theta // 4", "lead = 0", "tests/modalities/oct/surface/test_wall.py"),
    ("base/numeric/ranks.py", "ERROR_PER_SIGMA = 1.25", "ERROR_PER_SIGMA = 1.0", "tests/base/numeric/test_ranks.py"),
    ("synthetic/draw.py", " - min(0.0, advance)", "", "tests/synthetic/test_draw.py"),
    ("modalities/oct/unroll.py", "(turn - 0.5)", "(turn + 0.5)", "tests/modalities/oct/test_unroll.py"),
)
"""Mutants that tests once let through: module, text, what replaces it, and the tests that must fail."""
