"""What a published benchmark consists of: its tasks, the kinds of its specimens, and the seeds of each.

Definitions are shipped as TOML, next to this module. A seed follows from the key of its half, the kind and a number.
So a half has one key. That of the public half is in the definition, that of the hidden half stays with the maintainers.
"""

import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Literal

from numpy.random import SeedSequence
from pydantic import BaseModel, ConfigDict, Field

from endoct.base.errors import EndoctError, refusing
from endoct.synthetic.sample.presets import PresetName
from endoct.synthetic.specimen import SPECIMEN_VERSION

Generator = Literal["simulator", "second"]
"""Who makes a specimen: endoct's simulator, or the second generator of a source checkout, which shares nothing with
endoct."""
Difficulty = Literal["easy", "middle", "hard"]
Size = Literal["small", "full"]
Half = Literal["public", "hidden"]
Split = Literal["train", "validation", "test"]
DIFFICULTIES: tuple[Difficulty, ...] = ("easy", "middle", "hard")
LEFT_OUT_BITS = 11
"""Of the 64 bits that are drawn so many are left out, so that any program that reads JSON holds a seed exactly."""
FULL = 5
"""A full set has so many times the specimens of a small one."""


class Stored(BaseModel):
    """What is read from files, or written to them: without unknown keys or numbers that are none, and not
    to be changed."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class ScoredTask(Stored):
    """A task's title, its main score, one of those that its judge gives, and which way is better."""

    title: str
    score: str
    better: Literal["higher", "lower"]


class SpecimenKind(Stored):
    """A kind of specimen: who makes it and how, which tasks it is for, and how many a small set has.

    ``preset`` and ``vary`` are those of ``endoct simulate``; the second generator goes by the difficulty alone.
    """

    generator: Generator
    difficulty: Difficulty
    tasks: tuple[str, ...]
    count: int = Field(gt=0)
    preset: PresetName | None = None
    vary: dict[str, tuple[float, float]] = {}

    @property
    def name(self) -> str:
        """Return what the names of its specimens begin with."""
        what = "pose-" if self.tasks == ("pose",) else ""
        return f"{what}{self.generator}-{self.difficulty}"


class Definition(Stored):
    """A benchmark: see ``endoct-bench-2.toml``. ``simulator`` is the version of what the simulator writes.

    ``splits``: those of the public half's specimens of a kind, in turn. Methods are scored on "test". The first
    benchmark had no such split; it is closed, and its board can only be read.
    """

    name: str
    title: str
    simulator: str
    public_key: int
    tasks: dict[str, ScoredTask]
    kinds: tuple[SpecimenKind, ...]
    splits: tuple[Split, ...] = ("train", "validation", "train", "train")


@dataclass(frozen=True)
class Planned:
    """A specimen of a set: its folder's name, its kind, the seed that it is drawn from, and its split."""

    name: str
    kind: SpecimenKind
    seed: int
    split: Split


@cache
def load_definition(name: str) -> Definition:
    """Return the benchmark ``name``.

    Raises :class:`EndoctError` for one that is not known, or that another version of the simulator made.
    """
    if name not in definition_names():
        raise EndoctError(f"there is no benchmark '{name}'", expected=" or ".join(definition_names()))
    with refusing(f"the definition of {name} is damaged", remedy="install endoct again"):
        text = files(__package__).joinpath(f"{name}.toml").read_text("utf-8")
        definition = Definition.model_validate(tomllib.loads(text))
    if definition.simulator != SPECIMEN_VERSION:
        raise EndoctError(
            f"{name} is of another simulator",
            found=f"version {SPECIMEN_VERSION} of what it writes",
            expected=f"version {definition.simulator}",
            remedy="use the endoct that its data card names, or download the set",
        )
    return definition


def definition_names() -> tuple[str, ...]:
    """Return the names of the benchmarks that are shipped."""
    names = (path.name for path in files(__package__).iterdir())
    return tuple(sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml")))


def planned(definition: Definition, half: Half, size: Size, key: int) -> Iterator[Planned]:
    """Yield the specimens of one half of a set, in order; a small set's are the first of each kind of the full one.

    ``key`` is what the seeds follow from. All specimens of the hidden half are for testing.
    """
    for place, kind in enumerate(definition.kinds):
        for number in range(kind.count * (FULL if size == "full" else 1)):
            drawn = SeedSequence(key, spawn_key=(place, number)).generate_state(1, "uint64")[0]
            split: Split = "test" if half == "hidden" else definition.splits[number % len(definition.splits)]
            yield Planned(f"{kind.name}-{number:03d}", kind, int(drawn >> LEFT_OUT_BITS), split)
