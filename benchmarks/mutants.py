"""Small faults put into the modules that decide a score, a place or a doubt: which share of them their tests catch.

    python -m benchmarks.mutants [--each 4] [--seed 0] [--only fusion/scoring …] [-o FILE]      or --named

A mutant is one change of one module: a comparison turned round, an operator exchanged, a number changed, a ``not``
lost, a filter that no longer wraps. It is caught where a test of its own module fails. Mutants are drawn with a seed,
equally many of every module, and tried in a copy of the tree. Texts of messages are left as they are.
"""

import argparse
import ast
import copy
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from benchmarks.mutated_modules import NAMED, TESTS

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("base", "fusion", "modalities", "stitching", "synthetic", "workbench")
LONGEST_S = 180.0

COMPARED: Mapping[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
AT_EDGE: Mapping[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt,
}  # fmt: skip
OPERATED: Mapping[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult,
    ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd, ast.BitXor: ast.BitOr, ast.Pow: ast.Mult, ast.Mod: ast.Add,
}  # fmt: skip
CALLED: Mapping[str, str] = {
    "min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "any": "all", "all": "any",
    "argmin": "argmax", "argmax": "argmin", "sin": "cos", "cos": "sin", "floor": "ceil", "ceil": "floor",
    "mean": "median", "median": "mean",
}  # fmt: skip
FUNCTIONS = ("mean", "median")
"""Arrays have one as a method, and not the other."""
WORDS: Mapping[str, str] = {"wrap": "nearest", "grid-wrap": "nearest", "nearest": "wrap"}


@dataclass(frozen=True)
class Mutant:
    """One change: ``source`` of the whole module, what it was and became, and in which line.

    ``computed``: whether in a function; else it is a setting, such as a limit.
    """

    module: str
    line: int
    before: str
    after: str
    source: str
    tests: tuple[str, ...]
    computed: bool = True


def main() -> int:
    """Return 1 where fewer than wanted are caught."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mutants", description=__doc__)
    parser.add_argument("--each", type=int, default=4, help="mutants of every module")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", default=None, help="modules that begin so")
    parser.add_argument("--named", action="store_true", help="those that tests once let through")
    parser.add_argument("--least", type=float, default=0.85, help="share that must be caught")
    parser.add_argument("--unchecked", action="store_true", help="the tests are known to pass without any")
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    modules = [name for name in TESTS if not options.only or name.startswith(tuple(options.only))]
    mutants = list(named() if options.named else drawn(modules, options.each, options.seed))
    random.Random(options.seed).shuffle(mutants)  # a run that is broken off is a sample as well
    caught: dict[bool, list[bool]] = {True: [], False: []}
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as scratch:
        tree = copied_tree(Path(scratch) / "tree")
        for tests in () if options.unchecked else dict.fromkeys(mutant.tests for mutant in mutants):
            if fails(tree, tests):
                raise SystemExit(f"{' '.join(tests)} fail without any mutant")
        for mutant in mutants:
            is_caught = tried(tree, mutant)
            caught[mutant.computed].append(is_caught)
            said = f"{'caught' if is_caught else 'LIVES '} {'' if mutant.computed else '(setting) '}"
            said += f"{mutant.module}:{mutant.line}  {mutant.before} → {mutant.after}"
            print(said, flush=True)
            if options.output:
                with options.output.open("a", encoding="utf-8") as lines:
                    print(said, file=lines)
    for what, some in (("computations", caught[True]), ("settings", caught[False])):
        print(f"{what}: {sum(some)} of {len(some)} caught, {sum(some) / max(len(some), 1):.0%}")
    share = sum(map(sum, caught.values())) / max(len(mutants), 1)
    print(f"{share:.0%} of {len(mutants)} in {time.monotonic() - began:.0f} s")
    return int(share < (1 if options.named else options.least))


def named() -> Iterator[Mutant]:
    """Yield the mutants that tests once let through."""
    for module, before, after, tests in NAMED:
        source = (ROOT / module).read_text("utf-8")
        if source.count(before) != 1:
            raise SystemExit(f"{module} no longer has {before!r}: name another mutant that does the same")
        line = source[: source.index(before)].count("\n") + 1
        yield Mutant(module, line, before.strip(), after.strip() or "nothing", source.replace(before, after), (tests,))


def drawn(modules: list[str], each: int, seed: int) -> Iterator[Mutant]:
    """Yield ``each`` mutants of every module, or as many as there are, in the order of their lines."""
    for module in modules:
        tree = ast.parse((ROOT / module).read_text("utf-8"))
        nodes = [node for node, _ in _code(tree)]
        all_ = [(k, change) for k, node in enumerate(nodes) for change in range(len(list(_changes(node))))]
        some = random.Random(f"{seed} {module}").sample(all_, min(each, len(all_)))
        yield from (_mutant(module, tree, *which) for which in sorted(some, key=lambda one: nodes[one[0]].lineno))


def _mutant(module: str, tree: ast.Module, k: int, change: int) -> Mutant:
    """Return the mutant of which the expression ``k`` of a module is changed in one way."""
    changed = copy.deepcopy(tree)
    node, computed = _code(changed)[k]
    before = ast.unparse(node)
    list(_changes(node))[change]()
    source = ast.unparse(ast.fix_missing_locations(changed))
    return Mutant(module, node.lineno, before, ast.unparse(node), source, TESTS[module], computed)


def _code(tree: ast.Module) -> list[tuple[ast.expr, bool]]:
    """Return what a module computes: expressions in functions, and settings outside them, with which of the two."""
    return list(_computed(tree, inside=False))


LEFT_OUT = ast.Raise | ast.Assert | ast.JoinedStr | ast.Import | ast.ImportFrom


def _computed(tree: ast.AST, *, inside: bool) -> Iterator[tuple[ast.expr, bool]]:
    inside = inside or isinstance(tree, ast.FunctionDef | ast.Lambda)
    for name, value in ast.iter_fields(tree):
        if name in ("annotation", "returns", "decorator_list"):
            continue
        for node in value if isinstance(value, list) else [value]:
            if not isinstance(node, ast.AST) or isinstance(node, LEFT_OUT):
                continue
            if isinstance(node, ast.expr) and (inside or isinstance(node, ast.Constant)):
                yield node, inside
            yield from _computed(node, inside=inside)


def _changes(node: ast.expr) -> Iterator["Change"]:
    """Yield what can be done to an expression, in place."""
    match node:
        case ast.Compare(ops=[operator], comparators=[other]):
            kind = type(operator)
            yield Change(node, "ops", [COMPARED[kind]()])
            if kind in AT_EDGE and isinstance(other, ast.Constant) and type(other.value) is int:
                yield Change(node, "ops", [AT_EDGE[kind]()])
        case ast.BinOp(op=operator) if type(operator) in OPERATED:
            yield Change(node, "op", OPERATED[type(operator)]())
        case ast.BoolOp(op=operator):
            yield Change(node, "op", ast.Or() if isinstance(operator, ast.And) else ast.And())
        case ast.UnaryOp(op=operator, operand=operand):
            yield Change(node, "operand", ast.UnaryOp(operator, operand))
        case ast.IfExp():
            yield Change(node, "test", ast.UnaryOp(ast.Not(), node.test))
        case ast.Attribute(attr=name, value=value) if name in CALLED and (_is_numpy(value) or name not in FUNCTIONS):
            yield Change(node, "attr", CALLED[name])
        case ast.Call(func=ast.Name(id=name)) if name in CALLED:
            yield Change(node.func, "id", CALLED[name])
        case ast.Constant(value=bool() as value):
            yield Change(node, "value", not value)
        case ast.Constant(value=int() as value):
            yield Change(node, "value", value + 1)
        case ast.Constant(value=float() as value):
            yield Change(node, "value", 2 * value if value else 1.0)
        case ast.Constant(value=str() as value) if value in WORDS:
            yield Change(node, "value", WORDS[value])


def _is_numpy(node: ast.expr) -> bool:
    return isinstance(node, ast.Name) and node.id == "np"


@dataclass(frozen=True, eq=False)
class Change:
    """Gives a field of a node another value."""

    node: ast.AST
    field: str
    value: object

    def __call__(self) -> None:
        setattr(self.node, self.field, self.value)


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


def tried(tree: Path, mutant: Mutant) -> bool:
    """Return whether tests fail with a mutant in its place in ``tree``."""
    file = tree / mutant.module
    sound, made = file.read_bytes(), file.stat().st_mtime_ns
    file.write_text(mutant.source, "utf-8")
    try:
        return fails(tree, mutant.tests)
    finally:
        file.write_bytes(sound)
        os.utime(file, ns=(made, made))  # what was compiled of it holds again


def fails(tree: Path, tests: tuple[str, ...]) -> bool:
    """Return whether tests fail in ``tree``; those that do not end do."""
    environment = os.environ | {"PYTHONPATH": str(tree / ".typing"), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-m", "not slow", "-p", "no:cacheprovider", "-n0", *tests]
    try:
        done = subprocess.run(command, cwd=tree, env=environment, capture_output=True, timeout=LONGEST_S, check=False)
    except subprocess.TimeoutExpired:
        return True
    if done.returncode > 2:  # less than 0: it crashed
        raise SystemExit(f"{' '.join(command)} ended with {done.returncode}: {done.stdout.decode()[-2000:]}")
    return done.returncode != 0


if __name__ == "__main__":
    sys.exit(main())
