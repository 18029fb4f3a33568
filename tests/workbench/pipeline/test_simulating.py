"""How far a simulation is: of all of it, not of the step that is under way."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from endoct.workbench.pipeline import simulating
from endoct.workbench.pipeline.simulating import simulate
from endoct.workbench.running.progress import Advance, SilentStages


class Watched(SilentStages):
    """Keeps every share that it hears of."""

    def __init__(self) -> None:
        super().__init__()
        self.shares: list[float] = []

    @contextmanager
    def _displayed(self, title: str) -> Iterator[Advance]:
        del title
        yield self.shares.append


@pytest.mark.parametrize(("extra", "steps"), [({}, 3), ({"labels": True, "spectra": True, "cone_beam": True}, 6)])
def test_it_is_at_its_end_only_when_every_step_is(
    extra: dict[str, bool], steps: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    order = ["wall", "oct", "endoscope", "ct", "spectra", "labels"][:steps]

    def render(folder: Path, **options: Any) -> None:
        folder.mkdir()
        for step in order:
            for share in (0.0, 0.5, 1.0):
                options["on_progress"](step, share)

    monkeypatch.setattr(simulating, "render", render)
    monkeypatch.setattr(simulating.inspect, "signature", lambda _: type("All", (), {"parameters": ()}))
    stages = Watched()
    simulate(tmp_path / "specimen", preset="learning", progress=stages, **extra)
    assert stages.shares == sorted(stages.shares)
    assert stages.shares[-1] == pytest.approx(1)
    assert stages.shares[2] == pytest.approx(1 / steps)  # the wall alone
    assert [share for share in stages.shares if share >= 0.999] == stages.shares[-1:]
