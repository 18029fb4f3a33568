"""Which cases a run of the bench is to have: seeds, and the ranges that conditions are drawn from."""

import difflib
import math
from collections.abc import Mapping, Sequence

from endoct.stitching.errors import EndoctError
from endoct.workbench.bench.task import AnyTask, Range

MOST_SEEDS = 1_000_000
LONGEST_SEED = 18


def parse_seeds(text: str) -> tuple[int, ...]:
    """Return the seeds of "1000-1009", "3,5,8" or both, each once. Raises :class:`EndoctError` for another form."""
    seeds: list[int] = []
    for piece in text.split(","):
        first, dash, last = piece.strip().partition("-")
        if not _is_seed(first) or (dash and not (_is_seed(last) and int(last) >= int(first))):
            raise EndoctError(
                "seeds cannot be read", found=f"'{text[:80]}'", expected="first-last, or numbers with commas"
            )
        more = range(int(first), int(last or first) + 1)
        if len(seeds) + len(more) > MOST_SEEDS:
            raise EndoctError("these are too many seeds", found=f"'{text[:80]}'", expected=f"{MOST_SEEDS} at most")
        seeds += more
    return tuple(dict.fromkeys(seeds))


def narrowed(task: AnyTask, wishes: Sequence[str], sweep: str | None = None) -> dict[str, Range]:
    """Return the ranges of ``task`` with those that ``wishes`` ("name=low..high", "name=word|word") replace.

    With ``sweep``, that condition alone is varied: all others that were not wished for stay at the middle of their
    range, or at their first word. Raises :class:`EndoctError` for a condition the task does not have, or a range
    that cannot be drawn from. Where nothing is asked for, the task's usual ranges hold.
    """
    ranges = {**task.ranges, **task.usual}
    wished = set()
    for wish in wishes:
        name, _, value = (piece.strip() for piece in wish.partition("="))
        _check_name(name, task)
        if name in wished:
            raise EndoctError(f"the condition '{name}' is given twice", found=f"'{wish}'", expected="each once")
        ranges[name] = _range(wish, value, _all(task)[name])
        wished.add(name)
    if sweep is not None:
        _check_name(sweep, task)
        ranges.setdefault(sweep, _all(task)[sweep])
        for name in ranges.keys() - wished - {sweep}:
            ranges[name] = middle(ranges[name])
    return ranges


def middle(range_: Range) -> Range:
    """Return the middle of a range without width, or its first word alone."""
    words = [word for word in range_ if isinstance(word, str)]
    if words:
        return (words[0],)
    value = sum(number for number in range_ if not isinstance(number, str)) / 2
    return value, value


def _all(task: AnyTask) -> Mapping[str, Range]:
    return {**task.optional, **task.ranges}


def _check_name(name: str, task: AnyTask) -> None:
    if name not in _all(task):
        nearest = difflib.get_close_matches(name, _all(task), 1, cutoff=0.4)
        known = f"'{nearest[0]}'" if nearest else ", ".join(task.ranges)
        raise EndoctError(f"'{name}' is no condition of '{task.name}'", expected=known or "none: it varies nothing")


def _is_seed(text: str) -> bool:
    return text.isascii() and text.isdecimal() and len(text) <= LONGEST_SEED


def _range(wish: str, value: str, usual: Range) -> Range:
    words = tuple(word for word in usual if isinstance(word, str))
    if words:
        chosen = tuple(word.strip() for word in value.split("|"))
        if unknown := [word for word in chosen if word not in words]:
            raise EndoctError(f"'{wish}' cannot be drawn", found=", ".join(unknown), expected=" or ".join(words))
        return chosen
    low, dots, high = value.partition("..")
    try:
        numbers = float(low), float(high if dots else low)
    except ValueError:
        raise EndoctError("a condition cannot be read", found=f"'{wish}'", expected="name=low..high") from None
    if not (all(map(math.isfinite, numbers)) and numbers[0] <= numbers[1]):
        raise EndoctError("a condition cannot be drawn", found=f"'{wish}'", expected="name=low..high, low first")
    return numbers
