"""Numbers in the names of a recording's images: as counts, or as places with decimals, signs and units, or as times.

One name can be read in several ways: "scan-1.25" as the numbers 1 and 25, as 1.25, or as −1.25. All names of a folder
are read in the way that leaves the fewest forms of names.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from fractions import Fraction
from pathlib import Path
from typing import Literal

from endoct.modalities.reading.numbering import Spacing, spacing_of

Unit = Literal["", "mm", "s"]
Number = int | Fraction
LONGEST_NUMBER = 15
"""Numbers with more digits, as of a time in ns, are no count of frames."""
_MINUS = ("-", "\u2212", "\u2013")
_UNITS = {"mm": Fraction(1), "um": Fraction(1, 1000), "\u00b5m": Fraction(1, 1000), "\u03bcm": Fraction(1, 1000)}
_UNIT = r"(?:[ _]?(?P<unit>mm|um|\u00b5m|\u03bcm)(?![a-z]))?"
_SPLIT_LENGTH = re.compile(r"#[.,]#mm")
"""A length with decimals looks like this where they are not read as decimals."""
_CLOCK = (
    r"(?P<clock>(?<![0-9])(?:19|20)[0-9]{2}[-_.]?[01][0-9][-_.]?[0-3][0-9][-_. t]?[0-2][0-9][-_.:h]?[0-5][0-9]"
    r"[-_.:m]?[0-5][0-9](?:[-_.,]?[0-9]{3}(?:[0-9]{3})?)?(?![0-9]))|"
)
"""A date with a time of day, the year first."""


@dataclass(frozen=True)
class Reading:
    """One way to read all names of a folder."""

    decimal: bool = False
    signed: bool = False
    clock: bool = False

    @property
    def pattern(self) -> re.Pattern[str]:
        """What counts as one number; \\d would take digits of other scripts."""
        sign = r"(?:(?<![0-9])[-+\u2212\u2013])?" if self.signed else ""
        part = r"(?:[.,][0-9]+)?" if self.decimal else ""
        return re.compile((_CLOCK if self.clock else "") + f"(?P<number>{sign}[0-9]+{part}){_UNIT}")


@dataclass(frozen=True)
class Name:
    """A file, the ``form`` of its name with # for each number, and its ``numbers``; lengths in mm, times in s."""

    path: Path
    form: str
    numbers: tuple[Number, ...]
    units: tuple[Unit, ...]

    @property
    def key(self) -> tuple[object, ...]:
        """What names are sorted by: texts and numbers in turn."""
        texts = self.form.split("#")
        pairs = zip(texts, (*self.numbers, 0), strict=False)
        return tuple(part for pair in pairs for part in pair)


def read_names(files: Sequence[Path]) -> tuple[list[Name], bool]:
    """Return the names of ``files`` in their order, and whether another reading, as good, has another order."""
    readings = [
        (reading, sorted((_name(file, reading.pattern) for file in files), key=lambda name: (name.key, name.path.name)))
        for reading in _possible(files)
    ]
    ranked = sorted(readings, key=lambda each: _rank(*each))
    best, names = ranked[0]
    order = [name.path for name in names]
    n_forms = _rank(best, names)[0]
    if _is_even(names):
        return names, False
    # a sign is one only where it tells names apart
    others = [each for reading, each in ranked[1:] if not reading.signed and _rank(reading, each)[0] == n_forms]
    distinct = [each for each in others if len({(name.form, name.numbers) for name in each}) == len(each)]
    return names, any([name.path for name in each] != order for each in distinct)


def varying(names: Sequence[Name]) -> list[int]:
    """Return which numbers differ among ``names`` of one form."""
    return [k for k in range(len(names[0].numbers)) if len({name.numbers[k] for name in names}) > 1]


def spacing_in(names: Sequence[Name], field: int) -> Spacing:
    """Return how one of the numbers of ``names`` is spaced."""
    values = [name.numbers[field] for name in names]
    return spacing_of([float(value - values[0]) for value in values], resolution_of(values))


def resolution_of(values: Sequence[Number]) -> float:
    """Return the least by which numbers can differ that are written with as many digits."""
    return 1 / max(value.denominator for value in values)


def seems_negative(names: Sequence[Name], field: int) -> bool:
    """Say whether a hyphen before a number of all ``names``, which may be a place, could be its sign."""
    before = {name.form.split("#")[field] for name in names}
    hyphens = all(text.endswith(_MINUS) for text in before)
    places = names[0].units[field] == "mm" or any(name.numbers[field].denominator > 1 for name in names)
    return hyphens and (places or (field == 0 and before <= set(_MINUS)))


def _possible(files: Sequence[Path]) -> list[Reading]:
    """Return the readings that may differ from the plain one, and that one."""
    stems = "/".join(file.stem.lower() for file in files)
    decimal = re.search(r"[0-9][.,][0-9]", stems) is not None
    signed = re.search(r"(?<![0-9])[-+\u2212\u2013][0-9]", stems) is not None
    clock = re.search(_CLOCK.rstrip("|"), stems) is not None
    readings = [Reading(), Reading(decimal=True), Reading(signed=True), Reading(decimal=True, signed=True)]
    kept = [each for each in readings if (decimal or not each.decimal) and (signed or not each.signed)]
    return [*kept, *([Reading(clock=True)] if clock else [])]


def _name(file: Path, pattern: re.Pattern[str]) -> Name:
    stem = file.stem.lower()
    numbers: list[Number] = []
    units: list[Unit] = []
    form, at = [], 0
    for found in pattern.finditer(stem):
        groups = found.groupdict()
        form += [stem[at : found.start()].replace("#", "_"), "#"]
        at = found.end()
        if groups.get("clock"):
            numbers.append(_seconds(found["clock"]))
            units.append("s")
            continue
        value, unit = _value(found["number"]), found["unit"]
        numbers.append(value * _UNITS[unit] if unit else value)
        units.append("mm" if unit else "")
        form += ["mm"] if unit else []
    form.append(stem[at:].replace("#", "_"))
    return Name(file, "".join(form), tuple(numbers), tuple(units))


def _value(text: str) -> Number:
    minus = text.startswith(_MINUS)
    whole, point, part = text.lstrip("+" + "".join(_MINUS)).replace(",", ".").partition(".")
    value = Fraction(int(whole + part), 10 ** len(part)) if point else int(whole)
    return -value if minus else value


def _seconds(clock: str) -> Number:
    """Return a date and time as seconds since 1970; where there is no such time, its digits as a number."""
    digits = "".join(filter(str.isdecimal, clock))
    fraction = digits[14:]
    try:
        moment = datetime.strptime(digits[:14], "%Y%m%d%H%M%S").replace(tzinfo=UTC)
    except ValueError:
        return int(digits)
    return int(moment.timestamp()) + (Fraction(int(fraction), 10 ** len(fraction)) if fraction else 0)


def _rank(reading: Reading, names: Sequence[Name]) -> tuple[int, int, int, int]:
    """Return how well a reading fits: forms of names, irregular numbers, numbers that vary, what is assumed."""
    forms = {name.form for name in names}
    if not reading.decimal and any(_SPLIT_LENGTH.search(form) for form in forms):
        return len(names) + 1, 0, 0, 0
    irregular, n_varying = 0, 0
    if len(forms) == 1 and len(names) > 2:
        fields = varying(names)
        n_varying = len(fields)
        collide = len({name.numbers for name in names}) < len(names)
        irregular = int(collide or not fields or all(spacing_in(names, field).kind == "uneven" for field in fields))
    return len(forms), irregular, n_varying, reading.signed * 4 + reading.decimal * 2 - 8 * reading.clock


def _is_even(names: Sequence[Name]) -> bool:
    if len({name.form for name in names}) > 1 or len(names) < 3:
        return False
    fields = varying(names)
    return len(fields) == 1 and spacing_in(names, fields[0]).kind == "even"
