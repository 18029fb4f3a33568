"""How a report says numbers and sentences: with units and sensible digits."""

import math
from collections.abc import Iterator, Mapping, Sequence

UNIT_BY_SUFFIX = {"mm": "mm", "mm2": "mm²", "rad": "rad", "px": "px", "hz": "Hz", "db": "dB", "s": "s"}
SHARES = ("jaccard", "dice", "fraction", "confidence", "correlation", "recall", "precision", "share")
NOTHING = "–"


def value_text(name: str, value: object) -> str:
    """Return ``value`` of the key ``name`` as text: its unit from the name, its digits from what it is.

    Shares (Jaccard, Dice, fractions, …) have three decimals, lengths are given to a micrometre, angles in radians
    and degrees, anything else with four significant digits.
    """
    if value is None:
        return NOTHING
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | str):
        return f"{value} {unit}" if isinstance(value, int) and (unit := _words_and_unit(name)[1]) else str(value)
    if isinstance(value, float):
        return _float_text(name, value).replace("-", "−")
    if isinstance(value, Sequence):
        return ", ".join(value_text(name, item) for item in value) or NOTHING
    return str(value)


def share_text(value: float | None) -> str:
    """Return a share with three decimals."""
    return value_text("share", value)


def length_text(value_mm: float | None) -> str:
    """Return a length to a micrometre."""
    return value_text("length_mm", value_mm)


def area_text(value_mm2: float | None) -> str:
    """Return an area to a hundredth of a square millimetre."""
    return value_text("area_mm2", value_mm2)


def count_text(value: int | None) -> str:
    """Return a number of things."""
    return NOTHING if value is None else str(value)


def interval_text(interval: Sequence[float] | None, digits: int = 2) -> str:
    """Return "95 % interval 0.61 to 0.81"; "" where it is not known."""
    if interval is None:
        return ""
    low, high = (f"{value:.{digits}f}".replace("-", "−") for value in interval)
    return f"95 % interval {low} to {high}"


def without_stop(text: str | None) -> str:
    """Return a sentence without its full stop, to be put into another."""
    return (text or "").strip().rstrip(".")


def key_text(key: str) -> str:
    """Return a key in words, without the unit that goes to its value: "z_shift_mm" as "z shift"."""
    return " ".join(_words_and_unit(key)[0])


def leaf_rows(values: Mapping[str, object], path: str = "") -> Iterator[tuple[str, str]]:
    """Yield (name in words with the names above it, value) of every leaf."""
    for key, value in values.items():
        name = f"{path} › {key_text(str(key))}" if path else key_text(str(key))
        if isinstance(value, Mapping):
            yield from leaf_rows(value, name)
        else:
            yield name, value_text(str(key), value)


def _words_and_unit(key: str) -> tuple[list[str], str]:
    """Return ("z", "shift") and "mm" for "z_shift_mm"; ("twist",) and "rad per mm" for "twist_rad_per_mm"."""
    words = key.split("_")
    unit = UNIT_BY_SUFFIX.get(words[-1], "")
    if len(words) == 1 or not unit:
        return words, ""
    if words[-2] == "per":
        over = UNIT_BY_SUFFIX.get(words[-3], "") if len(words) > 3 else ""
        return words[: -3 if over else -2], f"{over} per {unit}".strip()
    return words[:-1], unit


def _float_text(name: str, value: float) -> str:
    if not math.isfinite(value):
        return NOTHING
    unit = _words_and_unit(name)[1]
    if unit == "rad":
        return f"{value:.4f} rad ({math.degrees(value):.2f}°)"
    if unit == "rad per mm":
        return f"{value:.4f} rad per mm ({math.degrees(value):.2f}° per mm)"
    if unit == "mm":
        return f"{value:.3f} mm" if abs(value) >= 0.0005 or value == 0 else f"{value:.2g} mm"
    if unit == "mm²":
        return f"{value:.2f} mm²"
    if any(word in name for word in SHARES):
        return f"{value:.3f}"
    return f"{value:.4g} {unit}".strip()
