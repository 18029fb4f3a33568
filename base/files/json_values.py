"""JSON from files: read whole with a bound, and its values taken only where they are what they should be."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import SMALL_BYTES, read_small


def read_json(path: Path, most_bytes: int = SMALL_BYTES) -> Any:
    """Return what the JSON file ``path`` holds. Raises :class:`EndoctError` where it is larger, or no JSON."""
    data = read_small(path, most_bytes)
    with refusing(f"{path} is no JSON"):
        return json.loads(data)


def read_object(path: Path, most_bytes: int = SMALL_BYTES) -> dict[str, Any]:
    """Return the object a JSON file holds. Raises :class:`EndoctError` where it holds something else."""
    return an_object(read_json(path, most_bytes), str(path))


def object_in(data: bytes, subject: str) -> dict[str, Any]:
    """Return the JSON object in ``data``. Raises :class:`EndoctError`, naming ``subject``, where there is none."""
    with refusing(f"{subject} is no JSON"):
        return an_object(json.loads(data), subject)


def an_object(value: object, subject: str) -> dict[str, Any]:
    """Return ``value`` if it is a JSON object. Raises :class:`EndoctError`, naming ``subject``, where it is not."""
    if not isinstance(value, dict):
        raise EndoctError(f"{subject} cannot be used", found=_quoted(value), expected="a JSON object")
    return value


def number(of: Mapping[str, Any], key: str, least: float, most: float, subject: str) -> float:
    """Return the number ``of[key]``, from ``least`` to ``most``.

    Raises :class:`EndoctError` for anything else, NaN and truth values among them.
    """
    value = of.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
        found = "nothing" if key not in of else _quoted(value)
        raise EndoctError(
            f"'{key}' of {subject} cannot be used", found=found, expected=f"a number, {least:g} to {most:g}"
        )
    return float(value)


def a_list(of: Mapping[str, Any], key: str, subject: str) -> tuple[Any, ...]:
    """Return the list ``of[key]``, empty where there is none. Raises :class:`EndoctError` where it is no list."""
    value = of.get(key, ())
    if not isinstance(value, list | tuple):
        raise EndoctError(f"'{key}' of {subject} cannot be used", found=_quoted(value), expected="a list")
    return tuple(value)


def texts(of: Mapping[str, Any], key: str, subject: str) -> tuple[str, ...]:
    """Return the list of texts ``of[key]``, empty where there is none.

    Raises :class:`EndoctError` where it is something else.
    """
    value = of.get(key, ())
    if not isinstance(value, list | tuple) or not all(isinstance(text, str) for text in value):
        raise EndoctError(f"'{key}' of {subject} cannot be used", found=_quoted(value), expected="a list of texts")
    return tuple(value)


def _quoted(value: object) -> str:
    """Return a value as a message shows it; a container by its kind, since it may be large."""
    if isinstance(value, dict | list | tuple):
        return "an object" if isinstance(value, dict) else "a list"
    # a whole number of thousands of digits cannot be written out
    return "a huge number" if isinstance(value, int) and value.bit_length() > 200 else repr(value)[:80]
