"""Reads what the user wants parameters to be drawn from."""

from collections.abc import Mapping, Sequence

from endoct.stitching.errors import EndoctError
from endoct.synthetic.sample.ranges import Wish, check_wishes


def parse_vary(entries: Sequence[str]) -> dict[str, Wish]:
    """Return "part.name" → (low, high) or words from entries as ``oct.wall_db=6..14`` or ``oct.scan=step|helical``.

    One number stands for a range without width. Raises :class:`EndoctError` for an entry of another form, a
    parameter named twice, and whatever cannot be drawn.
    """
    wishes: dict[str, Wish] = {}
    for entry in entries:
        key, equals, value = (piece.strip() for piece in entry.partition("="))
        words = [word.strip() for word in value.split("|")]
        if not (key and equals and all(words)):
            raise EndoctError(
                "a parameter to vary cannot be read",
                found=f"'{entry}'",
                expected="part.name=low..high or part.name=word|word, as oct.wall_db=6..14",
            )
        if key in wishes:
            raise EndoctError(f"'{key}' is varied twice", found=f"'{entry}'", expected="each parameter once")
        wishes[key] = _numbers(value) or tuple(words)
    check_wishes(wishes)
    return wishes


def _numbers(value: str) -> tuple[float, float] | None:
    low, dots, high = value.partition("..")
    try:
        return float(low), float(high if dots else low)
    except ValueError:
        return None


def shown(wishes: Mapping[str, Wish]) -> str:
    """Return what was wished as the user would write it."""
    return " ".join(f"{key}={_wish(wishes[key])}" for key in sorted(wishes)) or "nothing"


def _wish(wish: Wish) -> str:
    return "..".join(f"{value:g}" for value in wish if isinstance(value, float)) or "|".join(map(str, wish))
