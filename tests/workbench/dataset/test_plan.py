"""What a data set consists of, and how parameters to vary are read."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from endoct.base.errors import EndoctError
from endoct.workbench.dataset.plan import SPLITS, DatasetPlan, Unit, job, split_counts, split_of, units
from endoct.workbench.settings import parse_vary, ranges_text


def plans(**fixed: object) -> st.SearchStrategy[DatasetPlan]:
    return st.builds(
        DatasetPlan,
        count=st.integers(1, 60),
        seed=st.integers(0, 2**63 - 1),
        format=st.sampled_from(["folders", "webdataset"]),
        recordings_per_bore=st.integers(1, 5),
        specimens_per_shard=st.integers(1, 7),
    )


def larger(plan: DatasetPlan, by: int) -> DatasetPlan:
    return DatasetPlan(**vars(plan) | {"count": plan.count + by})


@given(plans())
def test_every_specimen_is_in_one_unit_of_one_split(plan: DatasetPlan) -> None:
    all_units = list(units(plan))
    assert sorted(i for unit in all_units for i in unit.indices) == list(range(plan.count))
    assert len({unit.place for unit in all_units}) == len({unit.name for unit in all_units}) == len(all_units)
    for unit in all_units:
        assert len({split_of(plan, i) for i in unit.indices}) == 1


@given(plans(), st.integers(1, 40))
def test_a_larger_set_begins_as_the_smaller_one(plan: DatasetPlan, by: int) -> None:
    more = larger(plan, by)
    assert [job(plan, i) for i in range(plan.count)] == [job(more, i) for i in range(plan.count)]
    after = {unit.name: unit for unit in units(more)}

    def begins(unit: Unit) -> bool:
        return after[unit.name].indices[: len(unit.indices)] == unit.indices

    assert all(begins(unit) for unit in units(plan))


@given(plans())
def test_a_bore_is_in_one_split_and_recordings_of_it_differ(plan: DatasetPlan) -> None:
    jobs = [job(plan, i) for i in range(plan.count)]
    assert len({j.seed for j in jobs}) == len(jobs)
    of_bore: dict[int, set[str]] = {}
    for one in jobs:
        of_bore.setdefault(one.bore_seed, set()).add(split_of(plan, one.index))
    assert len(of_bore) == -(-plan.count // plan.recordings_per_bore)
    assert all(len(splits) == 1 for splits in of_bore.values())
    assert not {j.seed for j in jobs} & set(of_bore)


def test_splits_are_eight_to_one_to_one() -> None:
    plan = DatasetPlan(1000, recordings_per_bore=2)
    of = [split_of(plan, i) for i in range(plan.count)]
    assert [of.count(split) for split in SPLITS] == [*split_counts(plan).values()] == [800, 100, 100]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"count": 0}, "--count"),
        ({"count": 10**7}, "--count"),
        ({"count": 1, "seed": -1}, "--seed"),
        ({"count": 1, "recordings_per_bore": 0}, "--recordings-per-bore"),
        ({"count": 1, "preset": "small"}, "learning"),
        ({"count": 1, "format": "zip"}, "webdataset"),
        ({"count": 1, "ranges": {"oct.wal_db": (1.0, 2.0)}}, "oct.wall_db"),
    ],
)
def test_arguments_that_cannot_be_are_refused(arguments: dict[str, Any], said: str) -> None:
    with pytest.raises(EndoctError, match=said):
        DatasetPlan(**arguments)


def test_vary_reads_ranges_numbers_and_words() -> None:
    ranges = parse_vary(
        ["oct.wall_db=6..14", "oct.first_sample_mm = -0.2..-0.1", "oct.scan=step|helical", "bore.taper_mm=1e-2"]
    )
    assert ranges == {
        "oct.wall_db": (6.0, 14.0),
        "oct.first_sample_mm": (-0.2, -0.1),
        "oct.scan": ("step", "helical"),
        "bore.taper_mm": (0.01, 0.01),
    }
    assert ranges_text(ranges) == (
        "bore.taper_mm=0.01..0.01 oct.first_sample_mm=-0.2..-0.1 oct.scan=step|helical oct.wall_db=6..14"
    )


@pytest.mark.parametrize(
    "entry",
    [
        "oct.wall_db",
        "oct.wall_db=",
        "=6..14",
        "oct.wall_db=6..",
        "oct.wall_db=..14",
        "oct.wall_db=6...14",
        "oct.wall_db=14..6",
        "oct.wall_db=nan..nan",
        "oct.wall_db=6..1000",
        "oct.wall_db=loud",
        "oct.scan=step|",
        "oct.scan=step|spiral",
        "oct.scan=1..2",
        "wall_db=6..14",
    ],
)
def test_vary_refuses_what_cannot_be_drawn(entry: str) -> None:
    with pytest.raises(EndoctError):
        parse_vary([entry])


def test_vary_refuses_a_parameter_named_twice() -> None:
    with pytest.raises(EndoctError, match="twice"):
        parse_vary(["oct.wall_db=6..14", "oct.wall_db=7..8"])
