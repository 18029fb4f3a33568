"""Which cases a run of the bench is to have: seeds, and the ranges that conditions are drawn from."""

import difflib
import math
from collections.abc import Mapping, Sequence

from endoct.stitching.errors import EndoctError
from endoct.workbench.bench.task import AnyTask, Range
from endoct.workbench.pipeline.vary import numbers, range_texts, words

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


def narrowed(task: AnyTask, wanted: Sequence[str], sweep: str | None = None) -> dict[str, Range]:
    """Return the ranges of ``task``, of which those in ``wanted`` ("name=low..high", "name=word|word") are replaced.

    Where nothing is wanted, the task's usual ranges hold. With ``sweep``, that condition alone is varied: all others
    that are not in ``wanted`` stay at the middle of their range, or at their first word. Raises :class:`EndoctError`
    for a condition that the task does not have, or a range that cannot be drawn from.
    """
    ranges = {**task.ranges, **task.usual}
    texts = range_texts(wanted, "condition")
    for name, text in texts.items():
        _check_name(name, task)
        ranges[name] = _range(name, text, _all(task)[name])
    if sweep is not None:
        _check_name(sweep, task)
        ranges.setdefault(sweep, _all(task)[sweep])
        for name in ranges.keys() - texts.keys() - {sweep}:
            ranges[name] = middle(ranges[name])
    return ranges


def middle(range_: Range) -> Range:
    """Return the middle of a range without width, or its first word alone."""
    if known := [word for word in range_ if isinstance(word, str)]:
        return (known[0],)
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


def _range(name: str, text: str, usual: Range) -> Range:
    known = [word for word in usual if isinstance(word, str)]
    if known:
        if unknown := [word for word in words(text) if word not in known]:
            raise EndoctError(f"'{name}={text}' cannot be drawn", found=", ".join(unknown), expected=" or ".join(known))
        return words(text)
    range_ = numbers(text)
    if range_ is None:
        raise EndoctError("a condition cannot be read", found=f"'{name}={text}'", expected="name=low..high")
    if not (all(map(math.isfinite, range_)) and range_[0] <= range_[1]):
        raise EndoctError("a condition cannot be drawn", found=f"'{name}={text}'", expected="name=low..high, low first")
    return range_
