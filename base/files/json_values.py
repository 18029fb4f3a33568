"""JSON and XML from somebody's file, within bounds; values are taken only where they are what they should be."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import SMALL_BYTES, read_small

MOST_BYTES = 16_000_000
MOST_DEEP, MOST_ELEMENTS = 32, 300_000
_BYTE_ORDER_MARKS = (b"\xff\xfe", b"\xfe\xff")


def read_xml(data: bytes, document: str) -> Element:
    """Return the root of the XML document that ``document`` names, in UTF-8, UTF-16 or the encoding that it states.

    Raises :class:`EndoctError` if it is not XML, has a document type, which could define entities, or is beyond bounds.
    """
    if len(data) > MOST_BYTES:
        raise EndoctError(
            f"{document} is too large", found=f"{len(data) / 1e6:.0f} MB", expected="16 MB of XML at most"
        )
    builder, open_elements, n_elements = TreeBuilder(), 0, 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal open_elements, n_elements
        open_elements, n_elements = open_elements + 1, n_elements + 1
        if open_elements > MOST_DEEP or n_elements > MOST_ELEMENTS:
            raise EndoctError(
                f"{document} is no XML that is read",
                found="too many elements, or too many within one another",
                expected=f"{MOST_ELEMENTS} elements and {MOST_DEEP} levels at most",
            )
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal open_elements
        open_elements -= 1
        builder.end(tag)

    def refuse(*_: object) -> None:
        raise EndoctError(f"{document} is no XML that is read", found="a document type or entities", expected="none")

    with refusing(f"{document} is no valid XML", remedy="copy or export it again"):
        parser = expat.ParserCreate("utf-16" if data.startswith(_BYTE_ORDER_MARKS) else None)
        parser.buffer_text = True
        parser.StartElementHandler, parser.EndElementHandler = start, end
        parser.CharacterDataHandler = builder.data
        parser.StartDoctypeDeclHandler = refuse
        parser.Parse(data, True)
        return builder.close()


def local_name(element: Element) -> str:
    """Return the name of an element without the prefix of its namespace."""
    return element.tag.rpartition(":")[2]


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
