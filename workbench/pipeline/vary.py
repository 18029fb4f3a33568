"""Ranges that a user states on the command line: what parameters of a specimen, or a task's conditions, are drawn from.

The grammar, of every command: ``name=low..high``, ``name=number`` or ``name=word|word``.
"""

import math
from collections.abc import Mapping, Sequence

from endoct.stitching.errors import EndoctError
from endoct.synthetic.sample.ranges import Range, check_ranges


def parse_vary(entries: Sequence[str]) -> dict[str, Range]:
    """Return the ranges of ``entries`` as ``oct.wall_db=6..14`` or ``oct.scan=step|helical`` by "part.name".

    Raises :class:`EndoctError` for an entry of another form, a parameter named twice, and whatever the simulator
    cannot draw.
    """
    texts = range_texts(entries, "parameter", "part.name=low..high or part.name=word|word, as oct.wall_db=6..14")
    ranges = {name: numbers(text) or words(text) for name, text in texts.items()}
    check_ranges(ranges)
    return ranges


def range_texts(
    entries: Sequence[str], what: str, expected: str = "name=low..high or name=word|word"
) -> dict[str, str]:
    """Return by name the texts that stand for ranges, of entries "name=text", for :func:`numbers` or :func:`words`.

    ``what`` the names are, as "parameter", and the form ``expected`` of an entry are for messages. Raises
    :class:`EndoctError` for an entry of another form, and a name given twice.
    """
    texts: dict[str, str] = {}
    for entry in entries:
        name, equals, text = (piece.strip() for piece in entry.partition("="))
        if not (name and equals and all(words(text))):
            raise EndoctError(f"the range of a {what} cannot be read", found=f"'{entry}'", expected=expected)
        if name in texts:
            raise EndoctError(f"the {what} '{name}' is given twice", found=f"'{entry}'", expected="each once")
        texts[name] = text
    return texts


def numbers(text: str) -> tuple[float, float] | None:
    """Return (low, high) of "low..high", or of a single number, which stands for both; None for anything else."""
    low, dots, high = text.partition("..")
    try:
        return float(low), float(high if dots else low)
    except ValueError:
        return None


def words(text: str) -> tuple[str, ...]:
    """Return the words of "word|word"."""
    return tuple(word.strip() for word in text.split("|"))


def range_text(range_: Range) -> str:
    """Return a range as the user would state it."""
    return "..".join(f"{value:g}" for value in range_ if isinstance(value, int | float)) or "|".join(map(str, range_))


def ranges_text(ranges: Mapping[str, Range]) -> str:
    """Return ranges by name as the user would state them, in the order of their names."""
    return " ".join(f"{name}={range_text(ranges[name])}" for name in sorted(ranges)) or "nothing"


def parse_place(name: str, text: str | None) -> tuple[float, float, float] | None:
    """Return the three numbers of ``text`` as "12.5,-40,7"; None for none. Raises :class:`EndoctError` for another."""
    if text is None:
        return None
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        x = y = z = math.nan
    if not all(math.isfinite(value) for value in (x, y, z)):
        raise EndoctError(f"--{name} is no place", found=f"'{text}'", expected=f"three numbers, as --{name}=12.5,-40,7")
    return x, y, z
