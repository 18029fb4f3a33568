"""What a published benchmark consists of."""

import hashlib
import json

import pytest

from endoct.base.errors import EndoctError
from endoct.workbench.bench.published import definition as module
from endoct.workbench.bench.published.definition import definition_names, load_definition, planned
from endoct.workbench.bench.published.specimen_set import shipped_entries
from endoct.workbench.bench.task import load_task

NAME = "endoct-bench-2"


def test_every_task_has_a_score_of_its_judge_and_specimens_of_both_generators() -> None:
    definition = load_definition(NAME)
    for name, scored in definition.tasks.items():
        assert scored.score in load_task(name).scores
        kinds = [kind for kind in definition.kinds if name in kind.tasks]
        # the second generator's endoscope moves at its nominal pitch, without roll: no task
        assert {kind.generator for kind in kinds} == {"simulator"} | ({"second"} if name != "stitching" else set())
    assert {task for kind in definition.kinds for task in kind.tasks} == set(definition.tasks)
    assert all((kind.preset is None) == (kind.generator == "second") for kind in definition.kinds)


def test_a_small_set_is_the_beginning_of_the_full_one() -> None:
    definition = load_definition(NAME)
    small, full = ({each.name: each for each in planned(definition, "public", size, 5)} for size in ("small", "full"))
    assert small.items() <= full.items()
    assert len(full) == 5 * len(small)
    assert len({each.seed for each in full.values()}) == len(full)
    assert max(each.seed for each in full.values()) < 2**53  # what JSON holds exactly
    assert {each.split for each in small.values()} == {"train", "test"}


def test_the_hidden_half_has_other_seeds_and_is_for_testing() -> None:
    definition = load_definition(NAME)
    public = list(planned(definition, "public", "small", definition.public_key))
    hidden = list(planned(definition, "hidden", "small", 2**100 + 7))
    assert [each.name for each in public] == [each.name for each in hidden]
    assert not {each.seed for each in public} & {each.seed for each in hidden}
    assert {each.split for each in hidden} == {"test"}


def test_another_simulator_and_an_unknown_name_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    assert definition_names() == ("endoct-bench-1", NAME)
    with pytest.raises(EndoctError, match=NAME):
        load_definition("endoct-bench-0")
    monkeypatch.setattr(module, "SPECIMEN_VERSION", "99")
    load_definition.cache_clear()
    with pytest.raises(EndoctError, match="another simulator"):
        load_definition(NAME)
    load_definition.cache_clear()


def test_the_specimens_of_the_first_benchmark_stay_and_half_of_each_kind_are_scored() -> None:
    first, second = load_definition("endoct-bench-1"), load_definition(NAME)
    before, now = (list(planned(one, "public", "small", one.public_key)) for one in (first, second))
    assert [(one.name, one.seed) for one in before] == [(one.name, one.seed) for one in now]
    for kind in second.kinds:
        splits = [one.split for one in now if one.kind is kind]
        assert splits.count("test") == len(splits) / 2
    published = shipped_entries(NAME)
    assert {one.name: (one.split, one.kind.tasks) for one in now} == {
        one.name: (one.split, one.tasks) for one in published.values()
    }
    # recordings and truth never change; panoramas are made anew where endoct unrolls otherwise
    recorded = json.dumps([one.recorded for one in published.values()]).encode()
    assert hashlib.sha256(recorded).hexdigest().startswith("25563b804c5987b1")
