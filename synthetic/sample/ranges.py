"""What a parameter is drawn from: by default, by preset, or as the user says."""

import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Literal, cast, get_args, get_origin

from numpy.random import Generator
from pydantic import BaseModel

from endoct.base.errors import EndoctError
from endoct.synthetic.sample.parameter_fields import STATED_ONLY
from endoct.synthetic.sample.parameters import Bore, Ct, Density, Endoscope, Network, Oct, Tube

PARTS: Mapping[str, type[BaseModel]] = {
    "bore": Bore,
    "network": Network,
    "density": Density,
    "tube": Tube,
    "ct": Ct,
    "oct": Oct,
    "endoscope": Endoscope,
}
Range = tuple[float, float] | tuple[str, ...]
"""What a parameter is drawn from: (low, high), uniformly, or one of some words."""
NO_RANGES: Mapping[str, Range] = {}


@cache
def default_ranges(model: type[BaseModel]) -> dict[str, tuple[float, float]]:
    """Return what every number of ``model`` that is drawn is drawn from."""
    fields = model.model_json_schema()["properties"].items()
    return {name: (float(field["draw"][0]), float(field["draw"][1])) for name, field in fields if "draw" in field}


@cache
def allowed_range(model: type[BaseModel], name: str) -> tuple[float, float]:
    """Return the bounds within which a drawn number may lie."""
    field = model.model_json_schema()["properties"][name]
    return float(field["minimum"]), float(field["maximum"])


@cache
def choices(model: type[BaseModel]) -> dict[str, tuple[str, ...]]:
    """Return the parameters of ``model`` that are one of a few words or, as "true" and "false", a yes or no."""
    by_name = {}
    for name, field in model.model_fields.items():
        if get_origin(field.annotation) is Literal and all(
            isinstance(word, str) for word in get_args(field.annotation)
        ):
            extra = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
            stated = cast(list[str], extra.get(STATED_ONLY, []))
            by_name[name] = tuple(word for word in get_args(field.annotation) if word not in stated)
        elif field.annotation is bool:
            by_name[name] = ("true", "false")
    return by_name


def check_ranges(ranges: Mapping[str, Range]) -> None:
    """Raise :class:`EndoctError` for ranges, "part.name" → (low, high) or words, that cannot be drawn from."""
    for path, range_ in ranges.items():
        part, _, name = path.partition(".")
        model = PARTS.get(part)
        if model is None or (name not in default_ranges(model) and name not in choices(model)):
            known = [f"{p}.{n}" for p, m in PARTS.items() for n in (*default_ranges(m), *choices(m))]
            nearest = difflib.get_close_matches(path, known, 1, cutoff=0.3)
            raise EndoctError(
                f"'{path}' is no parameter that can be varied",
                expected=f"'{nearest[0]}'" if nearest else "part.name, as oct.wall_db",
                remedy="docs/reference/parameters.md lists them all",
            )
        if name in choices(model):
            if not all(word in choices(model)[name] for word in range_):
                raise EndoctError(
                    f"'{path}' cannot be that",
                    found="|".join(map(str, range_)),
                    expected=" or ".join(choices(model)[name]),
                )
            continue
        least, most = allowed_range(model, name)
        numbers = [value for value in range_ if isinstance(value, float)]
        if len(numbers) != 2 or not least <= numbers[0] <= numbers[1] <= most:
            raise EndoctError(
                f"'{path}' cannot be varied so",
                found="..".join(map(str, range_)),
                expected=f"low..high within {least:g}..{most:g}",
            )


@dataclass(frozen=True)
class Drawer:
    """Draws parameters with ``rng``; ``ranges`` go before the default ranges."""

    rng: Generator
    ranges: Mapping[str, Range]

    def number(self, model: type[BaseModel], name: str) -> float:
        """Draw one number, uniformly."""
        low, high = default_ranges(model)[name]
        for part, of in PARTS.items():
            if of is model and (range_ := self.ranges.get(f"{part}.{name}")):
                low, high = (float(value) for value in range_)
        return float(self.rng.uniform(low, high))

    def numbers(self, model: type[BaseModel]) -> dict[str, float]:
        """Draw every number of ``model`` that has a range."""
        return {name: self.number(model, name) for name in default_ranges(model)}

    def word(self, path: str, share: Mapping[str, float]) -> str:
        """Draw one of the words of ``share`` with that probability; words that the user gave are equally likely."""
        words = list(share)
        weights = list(share.values())
        if range_ := self.ranges.get(path):
            words, weights = [str(word) for word in range_], [1.0] * len(range_)
        return str(self.rng.choice(words, p=[weight / sum(weights) for weight in weights]))

    def yes(self, path: str, share: float) -> bool:
        """Draw True with probability ``share``."""
        return self.word(path, {"true": share, "false": 1 - share}) == "true"
