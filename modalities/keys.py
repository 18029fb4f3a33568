"""Values of keys: of which kind they must be, and what is said of those that cannot be used."""

import re
from collections.abc import Iterable, Mapping
from typing import Any, get_args

from annotated_types import Ge, Gt, Interval, Le, Lt
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from endoct.stitching.errors import EndoctError

LARGEST_WHOLE = 2**64
UNITS = {
    "_mm_s": "mm/s",
    "_mm2": "mm²",
    "_per_mm": "per mm",
    "_per_count": "a count",
    "_mm": "mm",
    "_px": "px",
    "_rad": "rad",
    "_deg": "degrees",
    "_hz": "Hz",
}


def table_model(field: FieldInfo) -> type[BaseModel] | None:
    """Return the model of a key that is a table, None where it is none."""
    return next((kind for kind in _kinds(field.annotation) if issubclass(kind, BaseModel)), None)


def field_at(model: type[BaseModel], place: Iterable[Any]) -> FieldInfo | None:
    """Return the field at ``place``: a key, or a key and keys of the tables within."""
    field: FieldInfo | None = None
    within: type[BaseModel] | None = model
    for part in place:
        field = within.model_fields.get(part) if within is not None and isinstance(part, str) else None
        within = table_model(field) if field is not None else None
    return field


def check_kinds(model: type[BaseModel], keys: Mapping[str, Any], where: str, inside: str = "") -> None:
    """Raise :class:`EndoctError` for a text or true and false where ``model`` has a number, and for absurd numbers.

    A library that checks types takes ``true`` for 1 and ``"2"`` for 2, where somebody made a mistake.
    """
    for name, value in keys.items():
        if (field := model.model_fields.get(name)) is None:
            continue
        kinds = set(_kinds(field.annotation))
        if isinstance(value, Mapping) and (table := table_model(field)) is not None:
            check_kinds(table, value, where, f"{inside}{name}.")
        if not kinds & {int, float}:
            continue
        for one in value if isinstance(value, list | tuple) else [value]:
            wrong = isinstance(one, bool | str) and type(one) not in kinds
            if wrong or (isinstance(one, int) and abs(one) > LARGEST_WHOLE):
                comma = isinstance(one, str) and re.fullmatch(r"[-+]?[0-9]{1,20},[0-9]{1,20}", one.strip())
                raise EndoctError(
                    f"'{inside}{name}' in {where} cannot be used",
                    found=abridged(one),
                    expected="a valid number",
                    remedy=f"write it with a point: {comma[0].replace(',', '.')}" if comma else "",
                )


def expectation(model: type[BaseModel], error: Mapping[str, Any]) -> str:
    """Return what pydantic expected, with both bounds and the unit where a number is out of its range."""
    said = str(error["msg"]).removeprefix("Value error, ").removeprefix("Input should be ")
    if not str(error["type"]).startswith(("greater_than", "less_than")):
        return said
    unit = next((unit for end, unit in UNITS.items() if str(_name(error)).endswith(end)), "")
    low, high = _bounds(model, error["loc"])
    if low is not None and high is not None:
        said = f"{low:g} to {high:g}"
    return f"{said} {unit}".strip()


def abridged(value: object) -> str:
    """Return a value for a message, cut short."""
    if isinstance(value, int) and abs(value) > LARGEST_WHOLE:
        return f"a number of {int(value.bit_length() * 0.30103) + 1} digits"
    try:
        return repr(value)[:80]
    except (ValueError, RecursionError):
        return f"a {type(value).__name__} that cannot be shown"


def _name(error: Mapping[str, Any]) -> str:
    return next((part for part in reversed(error["loc"]) if isinstance(part, str)), "")


def _bounds(model: type[BaseModel], place: Iterable[Any]) -> tuple[Any, Any]:
    """Return the least and the largest value of the field at ``place``, None where it has none."""
    low: Any = None
    high: Any = None
    within: type[BaseModel] | None = model
    for part in place:
        field = within.model_fields.get(part) if within is not None and isinstance(part, str) else None
        if field is None:
            continue
        within = table_model(field)
        for limit in _limits(field):
            low = limit.ge if isinstance(limit, Ge | Interval) and limit.ge is not None else low
            low = limit.gt if isinstance(limit, Gt | Interval) and limit.gt is not None else low
            high = limit.le if isinstance(limit, Le | Interval) and limit.le is not None else high
            high = limit.lt if isinstance(limit, Lt | Interval) and limit.lt is not None else high
    return low, high


def _limits(field: FieldInfo) -> list[Any]:
    found = list(field.metadata)
    waiting = [field.annotation]
    while waiting:
        for argument in get_args(waiting.pop()):
            if isinstance(argument, FieldInfo):
                found += argument.metadata
            waiting.append(argument)
    return found


def _kinds(annotation: Any) -> Iterable[type]:
    """Yield the classes that an annotation is made of: of ``tuple[float, ...] | None``, float and NoneType."""
    arguments = get_args(annotation)
    if not arguments:
        yield annotation if isinstance(annotation, type) else type(annotation)
    for argument in arguments:
        yield from _kinds(argument)
