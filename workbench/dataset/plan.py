"""What a data set consists of: seeds, splits, names and shards follow from the arguments alone."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, get_args

from numpy.random import SeedSequence

from endoct.base.errors import EndoctError
from endoct.synthetic.sample.presets import PRESETS, PresetName
from endoct.synthetic.sample.ranges import Range, check_ranges

Format = Literal["folders", "webdataset"]
Split = Literal["train", "validation", "test"]

SPLITS: tuple[Split, ...] = get_args(Split)
# of ten bores in a row; drawn independently of one another, so that taking them in turn is as good as by lot
SPLIT_OF_BORE: tuple[Split, ...] = (*("train",) * 4, "validation", *("train",) * 4, "test")
MOST_SPECIMENS = 1_000_000  # names have six digits
SHARD_BYTES = 2**27


@dataclass(frozen=True)
class DatasetPlan:
    """The arguments of a data set.

    ``count`` specimens, of which each ``recordings_per_bore`` in a row are recordings of one bore; ``ranges``,
    "part.name" → (low, high) or words, replace what ``preset`` draws from. ``specimens_per_shard`` matters to the
    format "webdataset" only; by default a shard has about 128 MiB. Raises :class:`EndoctError` where they cannot be.
    """

    count: int
    preset: PresetName = "learning"
    seed: int = 0
    ranges: Mapping[str, Range] = field(default_factory=dict)
    format: Format = "folders"
    labels: bool = False
    recordings_per_bore: int = 1
    specimens_per_shard: int = 0

    def __post_init__(self) -> None:
        for name, value, least, most in (
            ("--count", self.count, 1, MOST_SPECIMENS),
            ("--seed", self.seed, 0, 2**63 - 1),
            ("--recordings-per-bore", self.recordings_per_bore, 1, MOST_SPECIMENS),
        ):
            if not least <= value <= most:
                raise EndoctError(f"{name} cannot be that", found=str(value), expected=f"{least} to {most}")
        for name, word, words in (("preset", self.preset, PRESETS), ("format", self.format, get_args(Format))):
            if word not in words:
                raise EndoctError(f"unknown {name} '{word}'", expected=f"one of {', '.join(words)}")
        check_ranges(self.ranges)
        if self.specimens_per_shard < 1:
            object.__setattr__(self, "specimens_per_shard", _specimens_per_shard(self.preset))


@dataclass(frozen=True)
class Job:
    """One specimen to make: its place in the set, and all that its bytes depend on in addition to the plan."""

    index: int
    bore: int
    seed: int
    bore_seed: int

    @property
    def name(self) -> str:
        """Six digits."""
        return f"{self.index:06d}"


@dataclass(frozen=True)
class Unit:
    """What appears at once, with one record: the folder of a specimen, or a shard. ``place`` is below the set's."""

    name: str
    place: Path
    indices: tuple[int, ...]


def job(plan: DatasetPlan, index: int) -> Job:
    """Return the specimen at ``index``, which depends neither on the others nor on how many there are."""
    bore = index // plan.recordings_per_bore
    return Job(index, bore, _key(plan.seed, index), _key(plan.seed, bore, 1))


def split_of(plan: DatasetPlan, index: int) -> Split:
    """Return the split of the specimen at ``index``: that of its bore, so that no two splits show one bore."""
    return SPLIT_OF_BORE[index // plan.recordings_per_bore % len(SPLIT_OF_BORE)]


def split_counts(plan: DatasetPlan) -> dict[Split, int]:
    """Return how many specimens each split has."""
    counts = dict.fromkeys(SPLITS, 0)
    for index in range(plan.count):
        counts[split_of(plan, index)] += 1
    return counts


def units(plan: DatasetPlan) -> Iterator[Unit]:
    """Yield the units of the set, in the order of their specimens where possible.

    A shard holds specimens of one split; the last of each split may have fewer than the others.
    """
    if plan.format == "folders":
        for index in range(plan.count):
            yield Unit(f"{index:06d}", Path("specimens", f"{index:06d}"), (index,))
        return
    begun: dict[Split, list[int]] = {split: [] for split in SPLITS}
    finished = dict.fromkeys(SPLITS, 0)
    for index in range(plan.count):
        split = split_of(plan, index)
        begun[split].append(index)
        if len(begun[split]) == plan.specimens_per_shard:
            yield _shard(split, finished[split], begun[split])
            finished[split] += 1
            begun[split] = []
    for split in SPLITS:
        if begun[split]:
            yield _shard(split, finished[split], begun[split])


def _shard(split: Split, number: int, indices: list[int]) -> Unit:
    name = f"{split}-{number:06d}"
    return Unit(name, Path("shards", f"{name}.tar"), tuple(indices))


def _key(seed: int, *key: int) -> int:
    """Return 63 random bits: a positive number in every program that may read the manifest."""
    return int(SeedSequence(seed, spawn_key=key).generate_state(1, "uint64")[0] >> 1)


def _specimens_per_shard(preset: PresetName) -> int:
    size = PRESETS[preset]
    width, height = size.image_px[-1]
    recorded = size.n_slices * size.n_ascans * size.n_depth + size.n_frames * 3 * width * height
    return max(1, SHARD_BYTES // recorded)
