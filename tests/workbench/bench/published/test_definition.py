"""What a published benchmark consists of."""

import pytest

from endoct.base.errors import EndoctError
from endoct.workbench.bench.published import definition as module
from endoct.workbench.bench.published.definition import definition_names, load_definition, planned
from endoct.workbench.bench.task import load_task

NAME = "endoct-bench-1"


def test_every_task_has_a_score_of_its_judge_and_specimens_of_both_generators() -> None:
    definition = load_definition(NAME)
    for name, scored in definition.tasks.items():
        assert scored.score in load_task(name).scores
        kinds = [kind for kind in definition.kinds if name in kind.tasks]
        assert {kind.generator for kind in kinds} == {"simulator", "second"}
    assert {task for kind in definition.kinds for task in kind.tasks} == set(definition.tasks)
    assert all((kind.preset is None) == (kind.generator == "second") for kind in definition.kinds)


def test_a_small_set_is_the_beginning_of_the_full_one() -> None:
    definition = load_definition(NAME)
    small, full = ({each.name: each for each in planned(definition, "public", size, 5)} for size in ("small", "full"))
    assert small.items() <= full.items()
    assert len(full) == 5 * len(small)
    assert len({each.seed for each in full.values()}) == len(full)
    assert max(each.seed for each in full.values()) < 2**53  # what JSON holds exactly
    assert {each.split for each in small.values()} == {"train", "validation"}


def test_the_hidden_half_has_other_seeds_and_is_for_testing() -> None:
    definition = load_definition(NAME)
    public = list(planned(definition, "public", "small", definition.public_key))
    hidden = list(planned(definition, "hidden", "small", 2**100 + 7))
    assert [each.name for each in public] == [each.name for each in hidden]
    assert not {each.seed for each in public} & {each.seed for each in hidden}
    assert {each.split for each in hidden} == {"test"}


def test_another_simulator_and_an_unknown_name_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    assert definition_names() == (NAME,)
    with pytest.raises(EndoctError, match=NAME):
        load_definition("endoct-bench-0")
    monkeypatch.setattr(module, "SPECIMEN_VERSION", "99")
    load_definition.cache_clear()
    with pytest.raises(EndoctError, match="another simulator"):
        load_definition(NAME)
    load_definition.cache_clear()
