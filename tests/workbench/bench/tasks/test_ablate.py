"""Steps that are switched off exist, and a recording that is refused was declined."""

from pathlib import Path

import pytest
from pydantic import BaseModel

from endoct.base.errors import NotSeen
from endoct.fusion.comparison import CompareParameters
from endoct.modalities.registry import manifests
from endoct.workbench.bench.runner import run_method
from endoct.workbench.bench.task import Case
from endoct.workbench.bench.tasks import ablate
from endoct.workbench.bench.tasks.comparison import PartSettings, Specimen


def _model(part: str) -> type[BaseModel]:
    return CompareParameters if part == "compare" else manifests()[part].load().parameters


@pytest.mark.parametrize("name", ablate.STEPS)
def test_a_step_s_settings_exist_and_change_something(name: str) -> None:
    changed = False
    for part, settings in ablate.STEPS[name].settings.items():
        changed |= _model(part).model_validate(dict(settings)) != _model(part)()
    assert changed == (name != ablate.MAIN)


def test_a_recording_that_is_refused_was_declined(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: Path, settings: PartSettings) -> None:
        raise NotSeen(f"nothing of the wall could be seen in {path}")

    monkeypatch.setattr("endoct.workbench.api.unroll", refuse)
    row = run_method(ablate.TASK, ablate.MAIN, Case("one", (Specimen(Path("bore")),), Path(), {}))
    assert (row.status, row.reason) == ("declined", "nothing of the wall could be seen in endoscope")
