"""Small faults are what they are said to be, of all kinds alike, and each module's own tests come first."""

import ast
from pathlib import Path

import pytest

from benchmarks import mutants, mutated_modules
from benchmarks.mutants import drawn, named
from benchmarks.mutated_modules import NAMED, ROOT
from benchmarks.small_faults import KINDS, fault, faults_in

SOURCE = """
LIMIT = 0.5
def of(a_mm, b: int = 3, *, found=None) -> float:
    \"\"\"Return 7.\"\"\"
    if not found and b > 2:
        raise ValueError(f"{b + 1}", 2 + 2)
    rows = [-row[1:, -1] for row in zip(a_mm, b, strict=True) if row]
    return max(a_mm * 2.0, b - 1, rows_mm.size) if np.any(rows) else np.deg2rad(b)
"""
EXPECTED = {
    ("constant", "0.5", "1.0"), ("constant", "3", "4"), ("branch", "not found and b > 2", "True"),
    ("branch", "not found and b > 2", "False"), ("branch", "not found and b > 2", "not found or b > 2"),
    ("branch", "not found", "found"), ("comparison", "b > 2", "b <= 2"), ("comparison", "b > 2", "b >= 2"),
    ("constant", "2", "3"), ("sign", "-row[1:, -1]", "row[1:, -1]"), ("index", "1", "2"), ("branch", "row", "True"),
    ("branch", "row", "False"), ("unit", "a_mm", "a_mm * 1000"), ("operation", "max", "min"),
    ("operation", "a_mm * 2.0", "a_mm / 2.0"), ("constant", "2.0", "4.0"), ("sign", "b - 1", "b + 1"),
    ("constant", "1", "2"), ("branch", "np.any(rows)", "True"), ("branch", "np.any(rows)", "False"),
    ("operation", "np.any", "np.all"), ("unit", "np.deg2rad(b)", "b"),
}  # fmt: skip


def test_every_fault_is_one_change_of_its_kind() -> None:
    tree = ast.parse(SOURCE)
    sound = ast.unparse(tree).splitlines()
    made = [(kind, line, fault(tree, *which)) for kind, line, *which in faults_in(tree)]
    assert {(kind, one.before, one.after) for kind, _, one in made} == EXPECTED
    for kind, line, one in made:
        assert (one.kind, one.line) == (kind, line)
        assert one.computed == (one.before != "0.5")
        changed = one.source.splitlines()
        assert len(changed) == len(sound)
        assert sum(before != after for before, after in zip(sound, changed, strict=True)) == 1
    assert ast.unparse(tree).splitlines() == sound


def test_all_kinds_are_drawn_alike_by_a_seed_from_lines_that_changed() -> None:
    lines = {name: frozenset(range(40, 400)) for name in ("fusion/scoring/cells.py", "fusion/scoring/intervals.py")}
    lines |= {name: frozenset(range(400)) for name in ("base/numeric/circle.py", "stitching/grid.py")}
    first = drawn(lines, 21, seed=3)
    assert [one.kind for one in first] == [*KINDS] * 3
    assert {one.module for one in first[:4]} <= set(lines)
    assert all(one.line >= 40 for one in first if "scoring" in one.module)
    assert [one.source for one in drawn(lines, 21, seed=3)] == [one.source for one in first]
    assert [one.source for one in drawn(lines, 21, seed=4)] != [one.source for one in first]
    for one in first:
        assert one.source != ast.unparse(ast.parse((ROOT / one.module).read_text("utf-8")))


@pytest.mark.parametrize(
    ("module", "first"),
    [
        ("fusion/pose/finding.py", "tests/fusion/pose/test_finding.py"),
        ("fusion/registration/equations.py", "tests/fusion/registration/test_bending.py"),  # which imports it
        ("modalities/dicom/samples.py", "tests/modalities/dicom/"),  # of what imports what imports it
        ("workbench/report/figures/surfaces.py", "tests/workbench/report/"),  # nothing but its folder
    ],
)
def test_the_tests_of_a_module_are_the_nearest(module: str, first: str) -> None:
    tests = mutated_modules.tests_of(module)
    assert tests[0].startswith(first)
    assert 1 < len(tests) <= 4
    assert all((ROOT / test).is_file() for test in tests)


def test_what_was_let_through_once_is_still_there() -> None:
    assert [one.module for one in named()] == [module for module, *_ in NAMED]


def test_who_fails_is_named_and_who_passes_is_not(tmp_path: Path) -> None:
    """In a tree of its own: a test that passes, one that fails, one that goes on for ever."""
    tree = tmp_path / "tree"
    (tree / "tests").mkdir(parents=True)
    (tree / "pyproject.toml").write_text("[tool.pytest.ini_options]\nmarkers = ['slow']\n")
    (tree / "one.py").write_text("VALUE = 1\n")
    (tree / "tests" / "test_one.py").write_text(
        "import sys\nsys.path.insert(0, '.')\nimport one\n"
        "def test_sum():\n    assert one.VALUE + 1 == 2\n"
        "def test_ends():\n    while one.VALUE == 3: pass\n"
        "def test_has_the_specimen(tmp_path_factory):\n"
        "    assert (tmp_path_factory.getbasetemp() / 'quick_specimen' / 'oct').is_dir()\n"
    )
    (tmp_path / "specimen" / "oct").mkdir(parents=True)
    tests = ("tests/test_one.py",)
    assert mutants.first_failure(tree, tests, 1, tmp_path / "specimen") is None
    assert (mutants.first_failure(tree, tests, 1) or "").endswith("test_has_the_specimen")
    for source, by in (("VALUE = 2\n", "test_sum"), ("VALUE =\n", "")):
        mutant = mutants.Mutant("constant", "one.py", 1, "", source, tests)
        assert (mutants.caught_by(tree, mutant, 1, tmp_path / "specimen") or "").endswith(
            f"::{by}" if by else "test_one.py"
        )
        assert (tree / "one.py").read_text() == "VALUE = 1\n"
