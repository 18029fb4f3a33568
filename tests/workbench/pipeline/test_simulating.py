"""How far a simulation is: of all of it, not of the step that is under way."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from endoct.base.errors import EndoctError
from endoct.base.files.output import new_output
from endoct.workbench.pipeline import simulating
from endoct.workbench.pipeline.simulating import demonstrate, simulate
from endoct.workbench.running.outputs import SPECIMEN
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


def sealed(place: Path, kind: str) -> Path:
    """Write an output of a kind with one file."""
    with new_output(place, kind, overwrite=True) as made:
        made.mkdir()
        (made / "a.txt").write_text(kind)
    return place


def demonstrated(output: Path, *, overwrite: bool = False, fails: bool = False) -> Path:
    def make(specimen: Path, place: Path) -> Path:
        assert (specimen / "a.txt").read_text() == SPECIMEN
        if fails:
            raise EndoctError("it cannot be")
        return sealed(place, "comparison")

    return demonstrate(
        output, ("result", "comparison"), lambda place: sealed(place, SPECIMEN), make, overwrite=overwrite
    )


def test_a_result_lies_next_to_the_specimen_it_is_of(tmp_path: Path) -> None:
    assert demonstrated(tmp_path / "demo") == tmp_path / "demo" / "result"
    assert sorted(path.name for path in (tmp_path / "demo").iterdir()) == ["result", "specimen"]
    with pytest.raises(EndoctError, match="exists already"):
        demonstrated(tmp_path / "demo")
    demonstrated(tmp_path / "demo", overwrite=True)
    (tmp_path / "demo" / "result" / "a.txt").write_text("mine")
    with pytest.raises(EndoctError, match="holds more than endoct wrote"):
        demonstrated(tmp_path / "demo", overwrite=True)
    assert (tmp_path / "demo" / "result" / "a.txt").read_text() == "mine"


def test_nothing_is_left_of_a_result_that_fails_but_what_was_there(tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match="it cannot be"):
        demonstrated(tmp_path / "demo", fails=True)
    assert not (tmp_path / "demo").exists()
    demonstrated(tmp_path / "demo")
    with pytest.raises(EndoctError, match="it cannot be"):
        demonstrated(tmp_path / "demo", overwrite=True, fails=True)
    assert (tmp_path / "demo" / "result" / "a.txt").read_text() == "comparison"
