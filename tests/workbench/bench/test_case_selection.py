"""Which seeds and ranges are read from what a user writes."""

from collections.abc import Callable
from dataclasses import replace

import pytest
from bench_tasks import DOUBLING

from endoct.base.errors import EndoctError
from endoct.workbench.bench.runner import narrowed, parse_seeds
from endoct.workbench.bench.task import AnyTask


@pytest.mark.parametrize(
    ("ask", "match"),
    [
        (lambda: narrowed(DOUBLING, ["sise=1"]), "size"),
        (lambda: narrowed(DOUBLING, ["size=2..1"]), "low first"),
        (lambda: narrowed(DOUBLING, ["size=big"]), "low..high"),
        (lambda: narrowed(DOUBLING, ["kind=even"]), "plain or odd"),
        (lambda: narrowed(DOUBLING, ["size=1", "size=2"]), "twice"),
        (lambda: narrowed(DOUBLING, [], "colour"), "no condition"),
        (lambda: parse_seeds("9-3"), "first-last"),
        (lambda: parse_seeds("a"), "first-last"),
    ],
)
def test_what_cannot_be_drawn_is_refused(ask: Callable[[], object], match: str) -> None:
    with pytest.raises(EndoctError, match=match):
        ask()


def test_seeds_are_read() -> None:
    assert parse_seeds("3-5,9,4") == (3, 4, 5, 9)


def test_a_sweep_holds_the_other_conditions(doubling: AnyTask) -> None:
    assert narrowed(doubling, ["kind=odd"], "size") == {"size": (0.0, 1.0), "kind": ("odd",)}
    assert narrowed(doubling, [], "kind") == {"size": (0.5, 0.5), "kind": ("plain", "odd")}
    usual = replace(doubling, usual={"kind": ("plain",)})
    assert narrowed(usual, ["size=0.1..0.2"])["kind"] == ("plain",)
    assert narrowed(usual, ["kind=odd"])["kind"] == ("odd",)
