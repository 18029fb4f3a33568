"""Small faults of seven kinds, each one change of one expression: what a slip of the pen makes of a line.

``sign``: plus and minus exchanged, a minus lost. ``operation``: another operator, ``max`` for ``min``, ``cos`` for
``sin``, an edge that does not wrap. ``comparison``: turned round, or off by the edge. ``constant``: a number changed.
``index``: one place further. ``branch``: a condition that always or never holds, ``and`` for ``or``. ``unit``: a
length, an angle or a time taken for one in another unit. Texts of messages are left as they are.
"""

import ast
import copy
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

KINDS = ("sign", "operation", "comparison", "constant", "index", "branch", "unit")
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
UNITS: Mapping[str, float] = {"mm": 1000, "um": 0.001, "px": 2, "rad": 57.3, "deg": 0.01745, "s": 1000, "hz": 0.001}
"""By the ending of a name: the factor by which the unit next to its own is smaller."""
ANGLES = ("deg2rad", "rad2deg", "radians", "degrees")
LEFT_OUT = ast.Raise | ast.Assert | ast.JoinedStr | ast.Import | ast.ImportFrom
SHAPED = ("size", "shape", "ndim", "dtype")
"""Of an array in any unit these are the same."""
NO_LENGTH = ("called", "shaped")
NOT_CODE = ("annotation", "returns", "decorator_list")


@dataclass(frozen=True)
class Fault:
    """A change of a module: of which kind and line, what was there and what became of it, and all of its new source.

    ``computed``: whether in a function; else it is a setting, such as a limit.
    """

    kind: str
    line: int
    before: str
    after: str
    source: str
    computed: bool


@dataclass(frozen=True)
class Spot:
    """An expression of a module; ``role``: "index", "test", "called", "shaped" or none. ``computed``: as of a fault."""

    node: ast.expr
    role: str
    computed: bool


def faults_in(tree: ast.Module) -> list[tuple[str, int, int, int]]:
    """Return the faults that a module can have: kind, line, and two numbers by which :func:`fault` makes it."""
    return [
        (kind, spot.node.lineno, number, change)
        for number, spot in enumerate(_spots(tree))
        for change, (kind, _) in enumerate(_changes(spot))
    ]


def fault(tree: ast.Module, number: int, change: int) -> Fault:
    """Return one of the faults of a module; ``tree`` stays as it is."""
    changed = copy.deepcopy(tree)
    spot = list(_spots(changed))[number]
    kind, new = list(_changes(spot))[change]
    before, after = ast.unparse(spot.node), ast.unparse(ast.fix_missing_locations(ast.copy_location(new, spot.node)))
    whole = _Exchange(spot.node, new).visit(changed)
    return Fault(kind, spot.node.lineno, before, after, ast.unparse(ast.fix_missing_locations(whole)), spot.computed)


class _Exchange(ast.NodeTransformer):
    def __init__(self, old: ast.expr, new: ast.expr) -> None:
        self._old, self._new = old, new

    def visit(self, node: ast.AST) -> ast.AST:
        result: ast.AST = self._new if node is self._old else self.generic_visit(node)
        return result


def _spots(tree: ast.AST, role: str = "", *, computed: bool = False) -> Iterator[Spot]:
    """Yield the expressions of a module's code, those in functions and the numbers outside."""
    computed = computed or isinstance(tree, ast.FunctionDef | ast.Lambda)
    for name, value in ast.iter_fields(tree):
        for node in value if isinstance(value, list) else [value]:
            if name in NOT_CODE or not isinstance(node, ast.AST) or isinstance(node, LEFT_OUT):
                continue
            if isinstance(node, ast.keyword) and node.arg == "strict":  # it says what is so anyhow
                continue
            inner = _role(tree, name, role)
            if isinstance(node, ast.expr) and (computed or isinstance(node, ast.Constant)):
                yield Spot(node, inner, computed)
            yield from _spots(node, inner, computed=computed)


def _role(above: ast.AST, name: str, role: str) -> str:
    match above, name:
        case (ast.Subscript(), "slice") | (ast.keyword(arg="axis"), "value"):
            return "index"
        case ((ast.If() | ast.IfExp()), "test") | (ast.comprehension(), "ifs"):
            return "test"
        case ast.Call(), "func":
            return "called"
        case (ast.Attribute(attr=attribute), "value") if attribute in SHAPED:
            return "shaped"
        case ((ast.Slice() | ast.Tuple() | ast.UnaryOp()), _) if role == "index":
            return role
    return ""


def _changes(spot: Spot) -> Iterator[tuple[str, ast.expr]]:
    """Yield what can become of an expression, each with the kind of its fault."""
    node = spot.node
    if spot.role == "test":
        yield from (("branch", ast.Constant(value)) for value in (True, False))
    match node:
        case ast.Compare(ops=[operator], comparators=[other]):
            kind = type(operator)
            yield "comparison", ast.Compare(node.left, [COMPARED[kind]()], [other])
            if kind in AT_EDGE and isinstance(other, ast.Constant) and type(other.value) is int:
                yield "comparison", ast.Compare(node.left, [AT_EDGE[kind]()], [other])
        case ast.BinOp(left=left, op=operator, right=right) if type(operator) in OPERATED:
            is_sum = isinstance(operator, ast.Add | ast.Sub)
            yield "sign" if is_sum else "operation", ast.BinOp(left, OPERATED[type(operator)](), right)
        case ast.UnaryOp(op=ast.USub(), operand=operand) if spot.role != "index":
            yield "sign", operand
        case ast.BoolOp(op=operator, values=values):
            yield "branch", ast.BoolOp(ast.Or() if isinstance(operator, ast.And) else ast.And(), values)
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            yield "branch", operand
        case ast.Call(func=ast.Attribute(attr=name), args=[angle]) if name in ANGLES:
            yield "unit", angle
        case ast.Attribute(attr=name, value=of) if name in CALLED and (_is_numpy(of) or name not in FUNCTIONS):
            yield "operation", ast.Attribute(of, CALLED[name], node.ctx)
        case ast.Name(id=name) if spot.role == "called" and name in CALLED:
            yield "operation", ast.Name(CALLED[name], node.ctx)
        case ast.Name(id=name, ctx=ast.Load()) | ast.Attribute(attr=name, ctx=ast.Load()) if spot.role not in NO_LENGTH:
            stem, _, unit = name.rpartition("_")
            if stem and unit in UNITS and not name.isupper():
                yield "unit", ast.BinOp(node, ast.Mult(), ast.Constant(UNITS[unit]))
        case ast.Constant(value=bool() as value):
            yield "branch", ast.Constant(not value)
        case ast.Constant(value=int() as value):
            yield "index" if spot.role == "index" else "constant", ast.Constant(value + 1)
        case ast.Constant(value=float() as value):
            yield "constant", ast.Constant(2 * value if value else 1.0)
        case ast.Constant(value=str() as value) if value in WORDS:
            yield "operation", ast.Constant(WORDS[value])


def _is_numpy(node: ast.expr) -> bool:
    return isinstance(node, ast.Name) and node.id == "np"
