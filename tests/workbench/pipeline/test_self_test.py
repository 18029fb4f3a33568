"""The figures of the self-test: what agrees, what does not, and what cannot be told."""

import math

import pytest

from endoct.base.errors import EndoctError
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.result import Result, StoredAlignment
from endoct.workbench import cli
from endoct.workbench.commands import simulations
from endoct.workbench.pipeline.self_test import PUBLISHED, check_figures


def result(
    jaccard: float = 0.843, turn_deg: float = 333.35, shift_mm: float = 0.289, observed: float = 0.995
) -> Result:
    alignment = StoredAlignment.of(Alignment(math.radians(turn_deg), shift_mm, confidence=0.5))
    return Result(
        sides=("endoscope", "oct"), aligned=True, alignment=alignment, jaccard=jaccard, dice=None,
        valid_fraction=observed,
    )  # fmt: skip


def test_what_is_near_enough_is_said_in_one_line():
    said = check_figures(result(0.8391, -26.5, 0.29, 0.999))  # a turn less is the same
    assert said == (
        "Jaccard index 0.839 (0.843), turn -26.500° (333.350), shift 0.290 mm (0.289), observed by both 0.999 (0.995)"
    )


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize(
    ("key", "name"),
    [("jaccard", "Jaccard index"), ("turn_deg", "turn"), ("shift_mm", "shift"), ("observed", "observed by both")],
)
def test_every_figure_counts(key: str, name: str, sign: int):
    of = PUBLISHED[name]
    check_figures(result(**{key: of.value + 0.99 * sign * of.tolerance}))
    with pytest.raises(EndoctError, match=rf"other figures; found {name}"):
        check_figures(result(**{key: min(of.value + 1.1 * sign * of.tolerance, 1.5 if key != "turn_deg" else 400)}))


def test_what_is_no_number_or_not_aligned_is_refused():
    with pytest.raises(EndoctError, match="cannot align"):
        check_figures(result().model_copy(update={"alignment": None, "jaccard": None}))


def test_the_command_ends_with_one_where_figures_differ(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr("endoct.workbench.api.demo", lambda *_, **__: None)
    monkeypatch.setattr("endoct.fusion.files.result_file.read_result", lambda _: result())
    assert simulations.self_test() == 0
    assert capsys.readouterr().out.startswith("as published: Jaccard index 0.843 (0.843), turn 333.350°")
    monkeypatch.setattr("endoct.fusion.files.result_file.read_result", lambda _: result(jaccard=0.7))
    monkeypatch.setattr("sys.argv", ["endoct", "self-test"])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 1
    assert "this machine comes to other figures; found Jaccard index 0.700" in capsys.readouterr().err


@pytest.mark.slow
def test_this_machine_comes_to_the_published_figures():
    assert simulations.self_test() == 0
