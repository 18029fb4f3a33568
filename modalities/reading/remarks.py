"""What is to be said of a recording's files before any of its frames is understood."""

from dataclasses import dataclass

from endoct.base.doubt import Doubt
from endoct.base.errors import some_of

MOST_NAMES = 4


@dataclass(frozen=True)
class Remarks:
    """``notes``: what was mended or left out, in full sentences. ``doubts``: what could not be settled."""

    notes: tuple[str, ...] = ()
    doubts: tuple[Doubt, ...] = ()

    def __add__(self, other: "Remarks") -> "Remarks":
        """Return the remarks of both, each once."""
        notes, doubts = (*self.notes, *other.notes), (*self.doubts, *other.doubts)
        return Remarks(tuple(dict.fromkeys(notes)), tuple(dict.fromkeys(doubts)))


NONE = Remarks()
"""There is nothing to be said."""


def doubted(
    code: str, sentence: str, value: float | None = None, expected: float | None = None, unit: str = "1"
) -> Remarks:
    """Return one doubt, with a number and what that should be."""
    unit_of = None if value is None else unit
    return Remarks(doubts=(Doubt(code, sentence, value=value, unit=unit_of, expected=expected),))


def remarks_of(stream: object) -> Remarks:
    """Return the ``remarks`` of an opened recording, none where its plug-in makes none."""
    said = getattr(stream, "remarks", NONE)
    return said if isinstance(said, Remarks) else NONE


def some_names(names: list[str]) -> str:
    """Return the first of ``names`` as a sentence lists them, with how many more there are."""
    return some_of([name[:60] for name in names], MOST_NAMES)
