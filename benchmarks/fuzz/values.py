"""Numbers, words and names that readers stumble over."""

from random import Random

INTEGERS = (
    0, -1, 1, 2, 3, 4, 5, 7, 8, 9, 15, 16, 17, 31, 32, 33, 64, 100, 127, 128, 255, 256, 1000, 4096, 32767, 32768,
    65535, 65536, 100_000, 1_000_000, 2**24, 10**9, 2**31 - 1, 2**31, 2**32 - 1, 2**32, 2**40, 2**53, 2**62, 2**63 - 1,
    2**63, 2**64 - 1, 2**64, -2, -128, -32768, -(2**31), -(2**31) - 1, -(2**63), 10**30,
)  # fmt: skip
FEWER = (0, -1, 2**31, 2**32 - 1, 2**63)

JSON_NUMBERS = (
    "NaN", "Infinity", "-Infinity", "1e308", "-1e308", "1e309", "1e-320", "-0", "-0.0", "0.1", "-0.1", "0.5", "1e9",
    "1e18", "9" * 400, "1" * 5000, "-" + "8" * 5000, "1e400", "1E+2", "3.0", "2.5e-8",
)  # fmt: skip
JSON_TOKENS = (
    "null", "true", "false", '""', "[]", "{}", "[[]]", "[null]", "[0]", '["x"]', '{"a": 1}', "[1, 2, 3, 4, 5, 6]",
    '"NaN"', '"1"', '"null"', '"true"', "[NaN, NaN]", "[-1, 1]", "[[1, 2], [3, 4]]", '{"": {}}', "[true]",
)  # fmt: skip
JSON_STRINGS = (
    "\\u0000", "a\\u0000b", "\\ud800", "\\udfff\\ud800", "\\u001b[31m", "a\\nb", "\\r\\n", "../../../../etc/passwd",
    "/etc/passwd", "/dev/zero", "../outside", "..", ".", "/", "", " ", "<script>alert(1)</script>", "$x ${y} $",
    "%s%n%d", "{0} {a.b}", "\\u202e", "é" * 50, "\\ud83d\\ude00", "=1+1", "C:\\\\x", "a" * 300, "file:///etc/passwd",
    "float64", "oct", "endoscope", "mask", "inf", "-1",
)  # fmt: skip
NAMES = (
    "x", "a b", "a\nb", "-rf", "é", "\u202e", "a" * 200, "%00", "$HOME", "..x", ".hidden", "zarr.json", ".zarray",
    ".zattrs", ".zgroup", "acquisition.toml", "frame_99999999999999999999.png", "frame_٣.png", "frame_².png",
    "²", "0", "c", "c/0/0", "pullback.tif", "x.npy", "x.mkv", "x.tif", "x.png", "X.PNG", "result.json", "manifest.csv",
    "a.zarr", "0/0",
)  # fmt: skip


def integer(rng: Random) -> int:
    """Return a number at some border."""
    return rng.choice(FEWER if rng.random() < 0.3 else INTEGERS) + rng.choice((0, 0, 0, 0, 1, -1))


def packed(value: int, size: int, order: str) -> bytes:
    """Return the lowest ``size`` bytes of ``value``, ``order`` "<" or ">"."""
    return (value % (1 << 8 * size)).to_bytes(size, "little" if order == "<" else "big")


def nested(rng: Random, opening: str = "[", closing: str = "]") -> str:
    """Return brackets in brackets, closed or not."""
    depth = rng.choice((20, 100, 300, 1000, 3000, 20_000, 100_000))
    return opening * depth + (closing * depth if rng.random() < 0.7 else "")


def json_token(rng: Random) -> str:
    """Return JSON, or nearly, to stand where something else stood."""
    kind = rng.random()
    if kind < 0.3:
        return rng.choice(JSON_NUMBERS)
    if kind < 0.5:
        return str(integer(rng))
    if kind < 0.75:
        return rng.choice(JSON_TOKENS)
    if kind < 0.95:
        return '"' + rng.choice(JSON_STRINGS) + '"'
    if kind < 0.97:
        return nested(rng, '{"a":', "}")
    return nested(rng)
