"""Parameters that are varied exist, and what is varied reaches the comparison."""

from pathlib import Path

import pytest

from endoct.workbench.bench.runner import run_method
from endoct.workbench.bench.task import Case
from endoct.workbench.bench.tasks import sensitivity
from endoct.workbench.bench.tasks.ablate import MAIN
from endoct.workbench.bench.tasks.comparison import Settings, Specimen


def test_every_parameter_goes_up_and_down() -> None:
    known = sensitivity.parameters()
    assert {("compare", "relief_cap_mm"), ("oct", "least_signal"), ("endoscope", "taper")} <= set(known)
    assert ("oct", "seed") not in known
    assert set(sensitivity.TASK.methods) == {
        MAIN,
        *(f"{part}.{name}{way}" for part, name in known for way in (" up", " down")),
    }


def test_what_is_varied_reaches_the_comparison(monkeypatch: pytest.MonkeyPatch) -> None:
    used: list[Settings] = []
    monkeypatch.setattr(sensitivity, "compare_pair", lambda specimen, settings: used.append(settings))
    case = Case("one", (Specimen(Path()), 2.0), Path(), {})
    for name in ("compare.relief_cap_mm up", "compare.n_theta down"):
        assert run_method(sensitivity.TASK, name, case).status == "failed"  # nothing to judge
    assert used == [{"compare": {"relief_cap_mm": 0.4}}, {"compare": {"n_theta": 1024}}]
