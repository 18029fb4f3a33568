"""Numbers per frame with what they mean: unit, title, usual range, and of a flag which value speaks for its frame."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from endoct.base.arrays import Mask, readonly
from endoct.base.errors import EndoctError

_TEXT = re.compile(r"[\w ()/°%.,·+−-]{0,100}")
"""Titles and units may hold these characters. They also come from files of others, and appear in figures and pages."""

_UNITS = {"mm": "mm", "rad": "rad", "deg": "°", "px": "px", "hz": "Hz", "s": "s"}
"""Units go by the last word of a name."""

_SPEAKS_FOR = ("trusted", "reliable", "found", "observed", "fitted", "valid", "known", "ok")
"""A flag whose name ends in one of these words is true of frames that can be trusted."""


@dataclass(frozen=True)
class Meaning:
    """What numbers per frame mean.

    Attributes
    ----------
    title: what they are, in words ("pair correlation"); of a flag, what it says where it is true ("pair trusted").
    unit: of the numbers, "" where they have none.
    trusted_when: of a flag, the value of frames that can be trusted; None where it says nothing about that.
    usual: of numbers that say how good a frame is, the least and the largest of sound recordings, in ``unit``. It is
        infinite where there is no limit. Reports put such numbers first.
    """

    title: str
    unit: str = ""
    trusted_when: bool | None = None
    usual: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class PerFrame:
    """Numbers per frame: ``values``, (n_frames, …), read-only; the others as in :class:`Meaning`.

    Raises :class:`EndoctError` where a title or a unit is no short plain text, or the usual range is none. Raises it
    also where something else than one flag a frame says which frames can be trusted.
    """

    values: NDArray[Any]
    unit: str
    title: str
    trusted_when: bool | None = None
    usual: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", readonly(self.values, np.asarray(self.values).dtype))
        for text in (self.title, self.unit):
            if not isinstance(text, str) or not _TEXT.fullmatch(text):
                raise EndoctError(
                    "the title or the unit of what is given per frame cannot be used",
                    found=repr(text)[:80],
                    expected="a short plain text",
                )
        if self.trusted_when is not None and (self.values.dtype != np.bool_ or self.values.ndim != 1):
            raise EndoctError(
                f"'{self.title}' cannot say which frames are to be trusted",
                found=f"{self.values.dtype} {self.values.shape}",
                expected="true or false for every frame",
            )
        if self.usual is not None and not self.usual[0] < self.usual[1]:
            raise EndoctError(f"'{self.title}' cannot usually lie from {self.usual[0]} to {self.usual[1]}")

    def attributes(self) -> dict[str, str]:
        """Return what a store says of the numbers.

        ``units``, ``long_name``, ``trusted_when`` and ``usual_range`` ("0.7 1", "15 inf"), where there are any.
        """
        units = {"units": self.unit} if self.unit else {}
        trusted = {} if self.trusted_when is None else {"trusted_when": str(self.trusted_when).lower()}
        usual = {} if self.usual is None else {"usual_range": f"{self.usual[0]!r} {self.usual[1]!r}"}
        return {**units, "long_name": self.title, **trusted, **usual}

    @property
    def doubted(self) -> Mask:
        """The frames that a flag speaks against, bool (n_frames,); none where it says nothing about that."""
        if self.trusted_when is None:
            return np.zeros(len(self.values), np.bool_)
        return np.asarray(self.values != self.trusted_when)

    @property
    def doubt(self) -> str:
        """What a flag says of the frames it speaks against: "bridged", "pair not trusted"."""
        if not self.trusted_when:
            return self.title
        *words, last = self.title.split(" ")
        return " ".join([*words, "not", last])


def per_frame(values: Mapping[str, ArrayLike | PerFrame], meanings: Mapping[str, Meaning]) -> dict[str, PerFrame]:
    """Return ``values`` by name with their ``meanings``; what is not among those means what its name says.

    See :func:`usual_meaning`.
    """
    described = {}
    for name, given in values.items():
        if isinstance(given, PerFrame):
            described[name] = given
            continue
        array = np.asarray(given)
        meaning = meanings.get(name) or usual_meaning(name, array)
        described[name] = PerFrame(array, meaning.unit, meaning.title, meaning.trusted_when, meaning.usual)
    return described


def stored_range(text: object) -> tuple[float, float] | None:
    """Return the range that a store's ``usual_range`` gives; None for nothing, and for what is none."""
    try:
        low, high = (float(part) for part in str(text).split())
    except ValueError:
        return None
    return (low, high) if low < high and not math.isnan(low + high) else None


def usual_meaning(name: str, values: NDArray[Any]) -> Meaning:
    """Return what numbers mean that nobody declared, by the conventions for names.

    A name ends in its unit ("residual_mm"). A flag, bool (n_frames,), speaks for its frames where its name ends as
    "trusted", "found" or "known" do, and else against them ("bridged").
    """
    words = name.split("_")
    unit = _UNITS.get(words[-1], "") if len(words) > 1 else ""
    trusted_when = words[-1] in _SPEAKS_FOR if values.dtype == np.bool_ and values.ndim == 1 else None
    return Meaning(" ".join(words[:-1] if unit else words), unit, trusted_when)
