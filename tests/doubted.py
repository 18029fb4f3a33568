"""What a doubt says must not contradict itself."""

from collections.abc import Iterable

from endoct.base.doubt import Doubt


def outside(doubts: Iterable[Doubt]) -> list[Doubt]:
    """Return the doubts, of which none is of a value that was to be expected, but for what somebody forced."""
    listed = list(doubts)
    for doubt in listed:
        if isinstance(doubt.expected, tuple) and doubt.value is not None and doubt.code != "forced":
            low, high = doubt.expected
            assert low < high, doubt
            assert not low < doubt.value < high, doubt
    return listed


def codes_of(doubts: Iterable[Doubt]) -> list[str]:
    """Return the codes of doubts that are :func:`outside` of what was to be expected."""
    return [doubt.code for doubt in outside(doubts)]
