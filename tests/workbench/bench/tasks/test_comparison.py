"""The comparison that tasks vary: panoramas unrolled once, and doubts that reach the results."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError
from endoct.workbench.bench.task import Case
from endoct.workbench.bench.tasks import comparison
from endoct.workbench.bench.tasks.comparison import Specimen


def test_panoramas_are_unrolled_once_for_the_same_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[Any] = []
    monkeypatch.setattr("endoct.workbench.api.unroll", lambda path, settings: calls.append((path.name, settings)))
    specimen = Specimen(Path("bore"))
    for settings in ({}, {"wall": "maximum"}, {}, {"wall": "maximum"}):
        specimen.unrolled("oct", settings)
    assert calls == [("oct", {}), ("oct", {"wall": "maximum"})]


def test_doubts_of_a_comparison_are_scored(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(comparison, "_against_drawn", lambda folder, answer: {"oct_truth": 0.4})
    doubt = Doubt("cells-in-noise", "What was taken for cells may be noise.")
    for doubts, doubted, of_li in (((), 0.0, None), ((doubt,), 1.0, 0.3)):
        by_li = SimpleNamespace(own_rows=SimpleNamespace(jaccard=of_li))
        made = SimpleNamespace(alignment="there", doubts=doubts, result=SimpleNamespace(by_li=by_li))
        answer: Any = SimpleNamespace(comparison=made)
        scores = comparison.judge(Case("one", (), tmp_path, {}), answer)
        known = {} if of_li is None else {"pair_li": of_li}
        assert scores == {"success": 1.0, "doubted": doubted, "oct_truth": 0.4, **known}


def test_folders_without_a_pair_are_told(tmp_path: Path) -> None:
    (tmp_path / "oct").mkdir()
    with pytest.raises(EndoctError, match="no pair"):
        comparison.own_cases(tmp_path)
