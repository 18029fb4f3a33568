"""Steps and parameters that are varied exist, and what comes of a comparison reaches its scores."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from pydantic import BaseModel

from benchmarks import accuracy
from benchmarks.accuracy import MAIN, STEPS, TASK, Settings, Specimen
from endoct.base.doubt import Doubt
from endoct.base.errors import NotSeen
from endoct.fusion.comparison import CompareParameters
from endoct.modalities.registry import manifests
from endoct.workbench.bench.runner import run_method
from endoct.workbench.bench.task import Case


def _model(part: str) -> type[BaseModel]:
    return CompareParameters if part == "compare" else manifests()[part].load().parameters


@pytest.mark.parametrize("name", STEPS)
def test_a_step_s_settings_exist_and_change_something(name: str) -> None:
    changed = False
    for part, settings in STEPS[name].items():
        changed |= _model(part).model_validate(dict(settings)) != _model(part)()
    assert changed == (name != MAIN)


def test_every_parameter_goes_up_and_down() -> None:
    known = accuracy.parameters()
    assert known["compare.relief_cap_mm up"] == {"compare": {"relief_cap_mm": pytest.approx(0.3)}}
    assert known["compare.n_theta down"] == {"compare": {"n_theta": 1365}}
    assert {"oct.least_signal up", "oct.least_signal down", "endoscope.taper up"} <= set(known)
    assert "oct.seed up" not in known


def test_panoramas_are_unrolled_once_for_the_same_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[Any] = []
    monkeypatch.setattr(accuracy, "unroll", lambda path, settings, progress: calls.append((path.name, settings)))
    specimen = Specimen(Path("bore"))
    for settings in ({}, {"wall": "maximum"}, {}, {"wall": "maximum"}):
        specimen.unrolled("oct", settings)
    assert calls == [("oct", {}), ("oct", {"wall": "maximum"})]


def test_a_recording_that_is_refused_was_declined(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: Path, settings: Settings, progress: bool) -> None:
        raise NotSeen("nothing of the wall could be seen")

    monkeypatch.setattr(accuracy, "unroll", refuse)
    row = run_method(TASK, MAIN, Case("one", Specimen(Path("bore")), Path(), {}))
    assert (row.status, row.reason) == ("declined", "nothing of the wall could be seen")


@pytest.mark.parametrize(
    ("doubts", "of_li"), [((), None), ((Doubt("cells-in-noise", "What was taken for cells may be noise."),), 0.3)]
)
def test_doubts_of_a_comparison_are_scored(
    doubts: tuple[Doubt, ...], of_li: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(accuracy, "load_truth", lambda folder: None)
    monkeypatch.setattr(accuracy, "held_against", lambda *of: {"oct_truth": 0.4, "aligned": 1.0, "right": 1.0})
    result = SimpleNamespace(by_li=SimpleNamespace(own_rows=SimpleNamespace(jaccard=of_li)), budget=None)
    answer: Any = SimpleNamespace(
        comparison=SimpleNamespace(alignment="there", doubts=doubts, result=result), sides=(), parameters=None
    )
    known = {} if of_li is None else {"pair_li": of_li}
    scores = accuracy.judge(Case("one", Specimen(Path()), Path(), {}), answer)
    assert scores == {"success": 1.0, "doubted": float(bool(doubts)), "oct_truth": 0.4, **known}
