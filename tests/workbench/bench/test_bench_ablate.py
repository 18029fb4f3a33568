"""Steps and parameters that are varied exist, and what is varied reaches the comparison."""

from pathlib import Path
from typing import Any

import pytest

from endoct.fusion.comparison import CompareParameters
from endoct.modalities.registry import manifests
from endoct.stitching.errors import EndoctError, NotSeen
from endoct.workbench.bench import ablate, compared, sensitivity
from endoct.workbench.bench import oct as oct_task
from endoct.workbench.bench.compared import Specimen
from endoct.workbench.bench.runner import run_method
from endoct.workbench.bench.task import Case


def _model(part: str) -> Any:
    return CompareParameters if part == "compare" else manifests()[part].load().parameters


@pytest.mark.parametrize("name", ablate.STEPS)
def test_a_step_s_settings_exist_and_change_something(name: str) -> None:
    changed = False
    for part, settings in ablate.STEPS[name].settings.items():
        changed |= _model(part).model_validate(dict(settings)) != _model(part)()
    assert changed == (name != ablate.MAIN)


def test_every_parameter_goes_up_and_down() -> None:
    known = sensitivity.parameters()
    assert {("compare", "relief_cap_mm"), ("oct", "least_signal"), ("endoscope", "taper")} <= set(known)
    assert ("oct", "seed") not in known
    assert set(sensitivity.TASK.methods) == {
        ablate.MAIN,
        *(f"{part}.{name}{way}" for part, name in known for way in (" up", " down")),
    }


def test_what_is_varied_reaches_the_comparison(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(sensitivity, "compared", lambda specimen, settings: asked.append(settings))
    case = Case("one", (Specimen(Path()), 2.0), Path(), {})
    for name in ("compare.relief_cap_mm up", "compare.n_theta down"):
        assert run_method(sensitivity.TASK, name, case).status == "failed"  # nothing to judge
    assert asked == [{"compare": {"relief_cap_mm": 0.4}}, {"compare": {"n_theta": 1024}}]


def test_panoramas_are_unrolled_once_for_the_same_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[Any] = []
    monkeypatch.setattr("endoct.workbench.api.unroll", lambda path, settings: calls.append((path.name, settings)))
    specimen = Specimen(Path("bore"))
    for settings in ({}, {"wall": "maximum"}, {}, {"wall": "maximum"}):
        specimen.unrolled("oct", settings)
    assert calls == [("oct", {}), ("oct", {"wall": "maximum"})]


def test_a_recording_that_is_refused_was_declined(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: Path, settings: Any) -> None:
        raise NotSeen(f"nothing of the wall could be seen in {path}")

    monkeypatch.setattr("endoct.workbench.api.unroll", refuse)
    row = run_method(ablate.TASK, ablate.MAIN, Case("one", (Specimen(Path("bore")),), Path(), {}))
    assert (row.status, row.reason) == ("declined", "nothing of the wall could be seen in endoscope")


def test_folders_without_a_pair_are_told(tmp_path: Path) -> None:
    (tmp_path / "oct").mkdir()
    with pytest.raises(EndoctError, match="no pair"):
        compared.own_cases(tmp_path)


def test_a_pullback_without_truth_is_told(tmp_path: Path) -> None:
    (tmp_path / "oct").mkdir()
    with pytest.raises(EndoctError, match="has no truth"):
        oct_task.own_cases(tmp_path)
