"""What a user writes on the command line: settings of a side, ranges to draw from, and places.

Settings KEY=VALUE are keys of a side's sidecar and of its processing parameters, by one list of names. Ranges are
what parameters of a specimen, or a task's conditions, are drawn from. Their grammar is that of every command:
``name=low..high``, ``name=number`` or ``name=word|word``.
"""

import math
import tomllib
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel

from endoct.base.errors import EndoctError, cause_of
from endoct.modalities.acquisition import validate
from endoct.modalities.contract import Manifest

if TYPE_CHECKING:
    from endoct.synthetic.sample.ranges import Range
    from endoct.workbench.requests import Names, Place, Ranges, Settings


def parse(settings: "Settings") -> dict[str, object]:
    """Read ``("undistort=sine", "axial_pixel_mm=0.005")``; values are TOML, or else plain words.

    A mapping, as Python states it, is returned as it is, and nothing for None.
    """
    if settings is None or isinstance(settings, Mapping):
        return dict(settings or {})
    values: dict[str, object] = {}
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not equals or not key.strip():
            raise EndoctError("a setting cannot be read", found=f"'{setting}'", expected="KEY=VALUE")
        try:
            values[key.strip()] = tomllib.loads(f"value = {text}")["value"]
        except tomllib.TOMLDecodeError:
            values[key.strip()] = text
        except (ValueError, RecursionError) as error:  # a number of thousands of digits, brackets in brackets
            raise EndoctError(
                f"the value of '{key.strip()[:80]}' cannot be read", found=cause_of(error), expected="a plain value"
            ) from error
    return values


def split(settings: Mapping[str, object], manifest: Manifest) -> tuple[dict[str, object], Any]:
    """Return (keys that override the sidecar, the plug-in's parameters).

    Raises :class:`EndoctError` for a key that neither has (suggesting the nearest) or an impossible value.
    """
    sidecar_keys = manifest.acquisition.model_fields
    model: type[BaseModel] = manifest.load().parameters
    overrides = {key: value for key, value in settings.items() if key.partition(".")[0] in sidecar_keys}
    chosen = {key: value for key, value in settings.items() if key not in overrides}
    return overrides, validate(model, chosen, f"the settings of '{manifest.name}'", also=tuple(sidecar_keys))


def parse_vary(entries: "Ranges") -> "Mapping[str, Range]":
    """Return the ranges of ``entries`` as ``oct.wall_db=6..14`` or ``oct.scan=step|helical`` by "part.name".

    A mapping, as Python states it, is returned as it is, and nothing for None.

    Raises :class:`EndoctError` for an entry of another form, a parameter named twice, and whatever the simulator
    cannot draw.
    """
    if entries is None or isinstance(entries, Mapping):
        return entries or {}
    from endoct.synthetic.sample.ranges import check_ranges  # brings the simulator's parameters

    texts = range_texts(entries, "parameter", "part.name=low..high or part.name=word|word, as oct.wall_db=6..14")
    ranges = {name: numbers(text) or words(text) for name, text in texts.items()}
    check_ranges(ranges)
    return ranges


def range_texts(
    entries: Sequence[str], kind: str, expected: str = "name=low..high or name=word|word"
) -> dict[str, str]:
    """Return by name the texts that stand for ranges, of entries "name=text", for :func:`numbers` or :func:`words`.

    ``kind``, what the names are, as "parameter", and the form ``expected`` of an entry are for messages. Raises
    :class:`EndoctError` for an entry of another form, and a name given twice.
    """
    texts: dict[str, str] = {}
    for entry in entries:
        name, equals, text = (piece.strip() for piece in entry.partition("="))
        if not (name and equals and all(words(text))):
            raise EndoctError(f"the range of a {kind} cannot be read", found=f"'{entry}'", expected=expected)
        if name in texts:
            raise EndoctError(f"the {kind} '{name}' is given twice", found=f"'{entry}'", expected="each once")
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


def range_text(range_: "Range") -> str:
    """Return a range as the user would state it."""
    return "..".join(f"{value:g}" for value in range_ if isinstance(value, int | float)) or "|".join(map(str, range_))


def ranges_text(ranges: "Mapping[str, Range]") -> str:
    """Return ranges by name as the user would state them, in the order of their names."""
    return " ".join(f"{name}={range_text(ranges[name])}" for name in sorted(ranges)) or "nothing"


def listed_names(names: "Names") -> list[str]:
    """Return the names in a list that commas separate; names in a sequence, as Python states them, as they are."""
    return [name.strip() for name in names.split(",") if name.strip()] if isinstance(names, str) else list(names)


def parse_place(name: str, text: "Place") -> tuple[float, float, float] | None:
    """Return the three numbers of ``text`` as "12.5,-40,7"; a place, or None, as it is.

    Raises :class:`EndoctError` for another text.
    """
    if not isinstance(text, str):
        return text
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        x = y = z = math.nan
    if not all(math.isfinite(value) for value in (x, y, z)):
        raise EndoctError(f"--{name} is no place", found=f"'{text}'", expected=f"three numbers, as --{name}=12.5,-40,7")
    return x, y, z
