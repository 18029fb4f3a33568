"""Mutations of NumPy's ``.npy`` and of the regions of interest of ImageJ."""

import math
import re
from random import Random

from benchmarks.fuzz.values import integer, nested, packed

_DESCR = (
    "'|u1'", "'<u2'", "'>u2'", "'<f4'", "'>f8'", "'<f2'", "'<f16'", "'|b1'", "'|O'", "'<c8'", "'<U5'", "'<U0'",
    "'|S0'", "'|S3'", "'|V0'", "'|V10'", "'<m8[ns]'", "'<M8[D]'", "'<i8'", "'<u8'", "[('a', '<f4')]",
    "[]", "[('a', '|u1', (2, 3))]", "('<f4', (2,))", "'<f4,<f4'", "None", "0", "'x'", "''",
    "{'names': ['a'], 'formats': ['<f4']}", "'<U999999999'", "[('a', '|O')]", "'<u4'", "'>i2'", "'|V999999999999'",
)  # fmt: skip
_SHAPES = (
    "()", "(0,)", "(0, 0, 0)", "(1,)", "(3,)", "(-1,)", "(2**40, 4, 5)", "(True, 2, 3)", "(3.0, 4, 5)", "[3, 4, 5]",
    "3", "None", "(3, 0, 5)", "(1, 1, 1, 1)", "(2, 3, 4, 3)", "(1, 2, 3, 4, 5)", "(3, 4, 5,)", "('a',)",
    "(1e3, 2)", "(3, 4, 5, 1)", "(1,) * 40", "(" + "1, " * 64 + ")", "(" + "1, " * 65 + ")",
    "(4294967296, 4294967296, 4294967296)",
    "(9223372036854775807,)", "(9223372036854775808, 1, 1)", "(-9223372036854775808, 1, 1)", "(0, 4, 5)", "(4, 5)",
    "(1073741824, 1, 1)", "(1, 1073741824, 1)", "(2147483648, 2, 2)", "(6, 2, 5)", "(60, 1, 1)", "(1, 60)",
    "(1000000, 0, 3)",
)  # fmt: skip
_KEY = re.compile(r"'(descr|fortran_order|shape)': ((?:\[[^\]]*\])|(?:\([^)]*\))|[^,}]+)")


def mutate_npy(data: bytes, rng: Random) -> bytes:
    """Return an array whose header says something else, its length made right, and often its size."""
    if data[:6] != b"\x93NUMPY" or len(data) < 12:
        return data[rng.randrange(max(1, len(data))) :]
    wide = data[6] > 1
    begin = 12 if wide else 10
    end = begin + int.from_bytes(data[8:begin], "little")
    header, body = data[begin:end].decode("latin-1"), data[end:]
    kind = rng.random()
    if kind < 0.06:
        return data[:6] + bytes((rng.choice((0, 1, 2, 3, 4, 255)), rng.choice((0, 0, 1)))) + data[8:]
    if kind < 0.12:
        length = rng.choice((0, 1, len(header) - 1, len(header) + 40, 0xFFFF, rng.randrange(65536)))
        return data[:8] + packed(length, begin - 8, "<") + data[begin:]
    header = _new_header(header, rng, kind)
    if rng.random() < 0.6:
        body = _fitting(header, body)
    text = header.encode("latin-1", "replace")
    if wide or len(text) > 65535:
        return b"\x93NUMPY\x02\x00" + packed(len(text), 4, "<") + text + body
    return b"\x93NUMPY\x01\x00" + packed(len(text), 2, "<") + text + body


def _new_header(header: str, rng: Random, kind: float) -> str:
    found = list(_KEY.finditer(header))
    if not found or kind < 0.2:
        whole = ("{}", "1", "", "\0", "{'descr': 1}", header * 2)
        return rng.choice((nested(rng, "(", ")"), nested(rng, "-", ""), nested(rng), *whole))
    at = rng.choice(found)
    if kind < 0.28:
        return header.replace(at.group(0), rng.choice(("", f"{at.group(0)}, {at.group(0)}", "'extra': 1")))
    if kind < 0.32:
        return header.replace(at.group(1), rng.choice(("", "x", at.group(1).upper())))
    if kind < 0.36:
        odd = (nested(rng, "(", ")"), nested(rng), "'a' 'b'", "__import__('os')")
        return header.replace(at.group(2), rng.choice(odd))
    lengths = re.sub(r"\d+", lambda _: str(integer(rng)), at.group(2))
    value = {
        "descr": rng.choice(_DESCR),
        "shape": rng.choice(_SHAPES) if rng.random() < 0.7 else lengths,
        "fortran_order": rng.choice(("True", "False", "None", "2", "'x'")),
    }
    return header.replace(at.group(2), value[at.group(1)])


def _fitting(header: str, body: bytes) -> bytes:
    """Return a body as long as the header says, where that is little."""
    shape = re.search(r"'shape': \(([-\d, ]*)\)", header)
    size = re.search(r"'descr': '.[a-zA-Z](\d+)", header)
    if shape is None or size is None:
        return body
    lengths = [int(text) for text in shape.group(1).replace(" ", "").split(",") if re.fullmatch(r"-?\d+", text)]
    needed = abs(math.prod(lengths)) * int(size.group(1)) * (4 if "'<U" in header else 1)
    return (body * (needed // max(1, len(body)) + 1))[:needed] if 0 < needed < 100_000 else body


_ROI_FIELDS = (
    (4, 2), (6, 1), (7, 1), (8, 2), (10, 2), (12, 2), (14, 2), (16, 2), (18, 4), (22, 4), (26, 4), (30, 4), (34, 2),
    (36, 4), (40, 4), (44, 4), (48, 2), (50, 2), (52, 1), (53, 1), (54, 2), (56, 4), (60, 4),
)  # fmt: skip
"""Place and size of what an ImageJ region's header holds: version, type, bounds, count, …, its second header."""


def mutate_roi(data: bytes, rng: Random) -> bytes:
    """Return a region of interest with a field of its header changed."""
    at, size = rng.choice(_ROI_FIELDS)
    if rng.random() < 0.2:
        at, size = 6, 1
    value = rng.randrange(12) if at == 6 else integer(rng) if rng.random() < 0.6 else rng.randrange(-50, 400)
    if size == 4 and rng.random() < 0.3:
        floats = (b"\x7f\xc0\0\0", b"\x7f\x80\0\0", b"\xff\x80\0\0", b"\x7e\0\0\0", b"\0\0\0\x01", b"\x44\x7a\0\0")
        return data[:at] + rng.choice(floats) + data[at + 4 :]
    return data[:at] + packed(value, size, ">") + data[at + size :]
