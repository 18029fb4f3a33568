"""``result.json`` of a comparison, read back and checked: all of it is what it should be, whoever wrote it."""

from collections.abc import Iterator
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ValidationError

from endoct.base.errors import EndoctError
from endoct.base.files.contents import check_intact
from endoct.base.files.files import plain_name
from endoct.base.files.json_values import read_object
from endoct.fusion.result import Result

MOST_BYTES = 16_000_000
"""Largest file that is read. It takes some twenty times that in memory at worst; a result has some ten kilobytes."""
DEEPEST = 20
EXPECTED = "a folder written by `endoct compare`"
Stored = TypeVar("Stored", bound=BaseModel)


def read_result(folder: Path) -> Result:
    """Return what ``folder/result.json`` holds.

    Raises :class:`EndoctError` where it is missing, was changed since it was written, or is larger than 16 MB. Raises
    it also where it is no JSON object, is nested more than 20 deep, or something in it is not of its kind.
    """
    result = checked(Result, _stored(folder), f"result.json in {folder}")
    for name in result.sides:
        plain_name(name, f"a side in {folder}")
    return result


def checked(kind: type[Stored], stored: object, subject: str) -> Stored:
    """Return what was ``stored``. Raises :class:`EndoctError` on ``subject`` where it is not of its ``kind``."""
    try:
        return kind.model_validate(stored)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        where = ".".join(str(part) for part in first["loc"]) or "the whole"
        found = f"{where}: {first['msg']}"[:300]
        raise EndoctError(f"{subject} cannot be used", found=found, expected=EXPECTED) from error


def _stored(folder: Path) -> dict[str, object]:
    try:
        check_intact(folder, lambda name: name == "result.json")
        stored = read_object(folder / "result.json", MOST_BYTES)
    except EndoctError as error:
        raise EndoctError(f"{folder} is no comparison", found=error.found or error.what, expected=EXPECTED) from error
    if any(depth > DEEPEST for depth in _depths(stored)):
        raise EndoctError(f"{folder} is no comparison", found="a result nested too deeply", expected=EXPECTED)
    return stored


def _depths(value: object) -> Iterator[int]:
    """Yield how deep every container in ``value`` lies."""
    below: list[tuple[object, int]] = [(value, 1)]
    while below:
        inner, depth = below.pop()
        if isinstance(inner, dict | list):
            yield depth
            below += [(one, depth + 1) for one in (inner.values() if isinstance(inner, dict) else inner)]
