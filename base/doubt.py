"""What speaks against a result as a whole: by a stable code, in plain words, and in numbers."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

from endoct.base.errors import EndoctError

UNSPECIFIED = "unspecified"
"""The code of a doubt of which only a sentence is known, as in stores of older versions."""

_CODE = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")
_LONGEST_CODE = 60
_LONGEST_UNIT = 20
_LONGEST_KEY = 60

Expected = float | tuple[float, float] | None


@dataclass(frozen=True)
class Doubt:
    """One thing that speaks against a recording's panorama, a side's cells, or a comparison.

    Attributes
    ----------
    code: for programs; stable, in kebab case ("wall-far-from-nominal").
    what: for people: one sentence in plain words, with how much.
    side: the name of the side it concerns; None for both, or where there is only one.
    value: how much, in ``unit`` ("1" for a share or a ratio); None where that is no number.
    expected: what ``value`` should be: a number, or the least and the largest that would raise no doubt.
    key: the key of a sidecar for which ``value`` is the better one; None where no key is suspected.
    z_mm: from where to where along the bore, in the frame of side A; None where that is not known.

    NaN and infinity count as not known. Raises :class:`EndoctError` for a code not in kebab case, an empty sentence, or
    a unit that is no short text.
    """

    code: str
    what: str
    side: str | None = None
    value: float | None = None
    unit: str | None = None
    expected: Expected = None
    key: str | None = None
    z_mm: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.code, str) or len(self.code) > _LONGEST_CODE or not _CODE.fullmatch(self.code):
            raise _unusable("code", self.code, "words in lower case joined by hyphens")
        if not isinstance(self.what, str) or not self.what.strip():
            raise _unusable("sentence", self.what, "one sentence in plain words")
        texts = ("side", self.side, None), ("unit", self.unit, _LONGEST_UNIT), ("key", self.key, _LONGEST_KEY)
        for name, text, longest in texts:
            if text is not None and (not isinstance(text, str) or (longest and len(text) > longest)):
                raise _unusable(name, text, "a short text")
        object.__setattr__(self, "what", " ".join(self.what.split()))
        object.__setattr__(self, "value", _finite("value", self.value))
        object.__setattr__(self, "expected", _expected(self.expected))
        if not isinstance(along := _expected(self.z_mm), tuple | None):
            raise _unusable("place", self.z_mm, "two lengths")
        object.__setattr__(self, "z_mm", along)

    @property
    def text(self) -> str:
        """The sentence, with the side that it concerns before it: "oct: The wall …"."""
        return self.what if self.side is None else f"{self.side}: {self.what}"

    def of_side(self, name: str) -> "Doubt":
        """Return the same doubt, of the side ``name``."""
        return replace(self, side=name)

    def to_json(self) -> dict[str, object]:
        """Return the doubt as ``result.json`` and a panorama's store have it."""
        said: dict[str, object] = {
            "code": self.code,
            "side": self.side,
            "what": self.what,
            "value": self.value,
            "unit": self.unit,
            "expected": list(self.expected) if isinstance(self.expected, tuple) else self.expected,
        }
        also = ("key", self.key), ("z_mm", self.z_mm and list(self.z_mm))
        return said | {name: of for name, of in also if of}


def as_doubt(given: object) -> Doubt:
    """Return ``given``, a doubt, its JSON object, or a plain sentence, as a doubt.

    A sentence becomes a doubt of the code "unspecified". Raises :class:`EndoctError` for anything else.
    """
    if isinstance(given, Doubt):
        return given
    if isinstance(given, str):
        return Doubt(UNSPECIFIED, given)
    if not isinstance(given, Mapping):
        raise _unusable("kind", given, "a sentence, or an object with 'code' and 'what'")
    names = ("code", "what", "side", "value", "unit", "expected", "key", "z_mm")
    return Doubt(**{"code": None, "what": None} | {name: given[name] for name in names if name in given})


def without_doubts(notes: tuple[str, ...], doubts: tuple[Doubt, ...]) -> tuple[str, ...]:
    """Return every note once, those left out that a doubt says already."""
    said = {doubt.what for doubt in doubts}
    return tuple(note for note in dict.fromkeys(notes) if " ".join(note.split()) not in said)


def _expected(given: object) -> Expected:
    if not isinstance(given, list | tuple):
        return _finite("expected value", given)
    if len(given) != 2:
        raise _unusable("expected value", given, "a number, or two")
    low, high = (_finite("expected value", one) for one in given)
    return None if low is None or high is None else (low, high)


def _finite(name: str, given: object) -> float | None:
    """Return a number as float; None for None, and for what is not finite."""
    if given is None:
        return None
    if isinstance(given, bool | str | bytes):
        raise _unusable(name, given, "a number")
    try:
        value = float(given)  # type: ignore[arg-type]  # also numpy's numbers
    except OverflowError:
        return None
    except (TypeError, ValueError) as error:
        raise _unusable(name, given, "a number") from error
    return value if math.isfinite(value) else None


def _unusable(field: str, actual: object, expected: str) -> EndoctError:
    text = "a container" if isinstance(actual, dict | list | tuple) else repr(actual)[:80]
    return EndoctError(f"the {field} of a doubt cannot be used", found=text, expected=expected)
