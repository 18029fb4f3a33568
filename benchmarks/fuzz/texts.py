"""Mutations of JSON, TOML and CSV that keep most of their form."""

import json
import re
from random import Random
from typing import Any

from benchmarks.fuzz.values import JSON_NUMBERS, JSON_STRINGS, integer, json_token, nested

Pair = tuple[str, Any]


class Raw(str):
    """Text that stands in JSON as it is."""


class Pairs(list[Pair]):
    """A JSON object; a key may stand in it twice."""


def parsed(text: str) -> Any:
    """Return JSON as lists, :class:`Pairs` and leaves."""
    return json.loads(text, object_pairs_hook=Pairs)


def written(value: Any) -> str:
    """Return what :func:`parsed` gave, changed, as text."""
    if isinstance(value, Raw):
        return str(value)
    if isinstance(value, Pairs):
        return "{" + ", ".join(f"{json.dumps(key)}: {written(of)}" for key, of in value) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(written, value)) + "]"
    return json.dumps(value)


def mutate_json(data: bytes, rng: Random) -> bytes:
    """Return JSON with a value, key or element changed; with other bytes where it is no JSON any more."""
    if rng.random() < 0.04:
        return rng.choice((json_token(rng).encode(), b"\xef\xbb\xbf" + data, data[:1] * 2 + data, b"", b"{}", b"[]"))
    try:
        return written(_changed(parsed(data.decode()), rng)).encode("utf-8", "surrogatepass")
    except (ValueError, RecursionError):
        return data.replace(b"{", b"[", 1)


def _changed(root: Any, rng: Random) -> Any:
    places = list(_places(root))
    if not places:
        return Raw(json_token(rng))
    container, index = rng.choice(places)
    pair = isinstance(container, Pairs)
    value = container[index][1] if pair else container[index]
    kind = rng.random()
    if isinstance(value, str) and value[:1] in "{[" and value and rng.random() < 0.5:
        _put(container, index, mutate_json(value.encode(), rng).decode("utf-8", "replace"))
    elif kind < 0.5:
        _put(container, index, Raw(_near(value, rng)))
    elif kind < 0.64:
        del container[index]
    elif kind < 0.72:
        container.insert(index, container[index])
    elif kind < 0.80:
        other = rng.choice(places)
        _put(container, index, _copy(other[0][other[1]][1] if isinstance(other[0], Pairs) else other[0][other[1]]))
    elif kind < 0.86 and pair:
        container[index] = (rng.choice(("", "x", "é", "\0", "../x", container[index][0].upper(), "__class__")), value)
    elif kind < 0.92:
        container.clear()
    elif isinstance(value, list):
        _put(container, index, type(value)(value[: len(value) // 2] if rng.random() < 0.5 else value * 3))
    else:
        _put(container, index, [value])
    return root


def _near(value: Any, rng: Random) -> str:
    """Return JSON to stand for ``value``, as often as not of its own kind."""
    if rng.random() < 0.5:
        if isinstance(value, bool | int | float):
            return rng.choice(JSON_NUMBERS) if rng.random() < 0.5 else str(integer(rng))
        if isinstance(value, str):
            return '"' + rng.choice(JSON_STRINGS) + '"'
    return json_token(rng)


def _copy(value: Any) -> Any:
    return parsed(written(value)) if isinstance(value, list) else value


def _places(node: Any) -> Any:
    if not isinstance(node, list):
        return
    for index, entry in enumerate(node):
        yield node, index
        yield from _places(entry[1] if isinstance(node, Pairs) else entry)


def _put(container: list[Any], index: int, value: Any) -> None:
    container[index] = (container[index][0], value) if isinstance(container, Pairs) else value


_TOML_VALUES = (
    "nan", "inf", "-inf", "1e308", "-0.0", "-1", "0", "1" * 5000, "0x" + "f" * 40, "1979-05-27", "07:32:00", "true",
    '"text"', '""', "[]", "{}", "[1, 2]", "[nan, 1.0]", "{a = 1}", '"../../../../etc/passwd"', '"/dev/zero"', "''",
    '"\\u0000"', '"\\u001b[2J"', '"""a\nb"""', "1979-05-27T07:32:00Z", "[[1.0]]", "1_000", '"oct"', '"endoscope"',
    '"a/../../outside.toml"', '"."', "5e-324", "0.2", "1e-300", "[0.0, 0.2, 0.4]", "[0.0, 0.0, 0.0]",
)  # fmt: skip


def mutate_toml(data: bytes, rng: Random) -> bytes:
    """Return TOML with a value, key or line changed."""
    lines = data.decode("utf-8", "replace").split("\n")
    at = rng.randrange(len(lines))
    key, equals, value = lines[at].partition("=")
    kind = rng.random()
    if kind < 0.55 and equals:
        lines[at] = f"{key}= {_toml_value(value.strip(), rng)}"
    elif kind < 0.65:
        del lines[at]
    elif kind < 0.72:
        lines.insert(at, rng.choice((lines[at], "[table]", "[[table]]", "calibration = 'calibration.toml'", "= 1")))
    elif kind < 0.80 and equals:
        name = rng.choice(("", "x", key.strip()[:-1], f"{key.strip()}.a", "'é'", ".".join("a" * 3000), "'a\0'"))
        lines[at] = f"{name} = {value}"
    elif kind < 0.90:
        known = ("positions_mm", "annulus", "distortion", "calibration", "modality", "theta_origin_rad", "travel")
        lines.append(f"{rng.choice(known)} = {_toml_value('', rng)}")
    else:
        lines[at] += rng.choice((" #é", "\0", "\r", "\udc80", '"', " = ", "\x1b"))
    return "\n".join(lines).encode("utf-8", "surrogateescape")


def _toml_value(value: str, rng: Random) -> str:
    kind = rng.random()
    if kind < 0.1:
        return nested(rng) if rng.random() < 0.7 else nested(rng, "{a=", "}")
    if kind < 0.35:
        return str(integer(rng))
    if kind < 0.4 and value:
        return re.sub(r"\d", "9", value)
    return rng.choice(_TOML_VALUES)


_CELLS = (
    "", "nan", "inf", "-inf", "1e308", "-1e308", "1e9", "-1", "0", "1" * 5000, "x", "polygon", "ellipse", "rectangle",
    "path", "line", '"', '""', "1,2", "a\nb", "\0", "é", "=1+1", "0x10", "1_0", "../../../../etc/passwd", "/etc/passwd",
    "..", "x" * 140_000, "1e-9", "100000", "-3.5", "65536", "2147483648", "true", "folders",
)  # fmt: skip


def mutate_csv(data: bytes, rng: Random) -> bytes:
    """Return a table with a cell, line or column changed."""
    rows = [line.split(",") for line in data.decode("utf-8", "replace").split("\n")]
    at = rng.randrange(len(rows))
    row = rows[at]
    cell = rng.randrange(len(row))
    kind = rng.random()
    if kind < 0.55:
        row[cell] = rng.choice(_CELLS) if rng.random() < 0.7 else str(integer(rng))
    elif kind < 0.65:
        del rows[at]
    elif kind < 0.75:
        rows[at:at] = [list(row)] * rng.choice((1, 1, 3, 200))
    elif kind < 0.85:
        del row[cell]
    elif kind < 0.92:
        row.insert(cell, row[cell])
    else:
        for other in rows:
            if cell < len(other):
                del other[cell]
    return "\n".join(",".join(row) for row in rows).encode("utf-8", "surrogateescape")


_XML_VALUE = re.compile(r"(?<==\")[^\"<]*(?=\")|(?<=>)[^<>]*[^<>\s][^<>]*(?=</)")
_XML_PARTS = (
    '<!DOCTYPE a [<!ENTITY b "c">]>', "&b;", "<a>" * 50, "</a>", "<!--", "<![CDATA[", "\0", "\x1b[31m", "<?xml?>", "é",
)  # fmt: skip


def mutate_xml(data: bytes, rng: Random) -> bytes:
    """Return XML with a value, a line or a part of its markup changed, in the encoding that it has."""
    encoding = "utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8"
    text, kind = data.decode(encoding, "surrogateescape"), rng.random()
    values, lines = list(_XML_VALUE.finditer(text)), text.split("\n")
    if values and kind < 0.6:
        one = rng.choice(values)
        new = (str(integer(rng)), rng.choice(JSON_NUMBERS), rng.choice(values)[0], "", rng.choice(JSON_STRINGS))
        text = text[: one.start()] + rng.choice(new) + text[one.end() :]
    elif kind < 0.85:
        at = rng.randrange(len(lines))
        lines[at : at + 1] = rng.choice(([], [lines[at]] * 2, [rng.choice(lines)], [lines[at]] * 500))
        text = "\n".join(lines)
    elif kind < 0.95:
        at = rng.randrange(len(text) + 1)
        text = text[:at] + rng.choice(_XML_PARTS) + text[at:]
    else:
        encoding = rng.choice(("utf-8", "utf-16", "utf-16-le", "utf-32", "latin-1"))
    return text.encode(encoding, "replace" if encoding != "utf-8" else "surrogateescape")
