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
from endoct.workbench.requests import SimulateRequest
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


PLACES = {"entry_mm": (1.0, 2.0, 3.0), "target_mm": (1.0, 2.0, 23.0)}


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"bone": "ct.nrrd"}, "where to drill"),
        ({"bone": "ct.nrrd", "entry_mm": PLACES["entry_mm"]}, "where to drill"),
        ({"bone": "ct.nrrd", "target_mm": PLACES["target_mm"]}, "where to drill"),
        (PLACES, "what to drill into"),
        ({"bone_hu": 300.0}, "what to drill into"),
        ({"bone": "ct.nrrd", "replay": "sample.json", **PLACES}, "has its bone already"),
    ],
)
def test_a_bone_to_drill_and_where_go_together(options: dict[str, Any], said: str, tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match=said):
        simulating._volume(SimulateRequest(output=tmp_path / "out", **options))


def test_a_bone_is_drilled_from_the_entry_to_the_target(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("endoct.synthetic.bone.patient.stated_volume", lambda *args, **options: (args, options))
    asked = SimulateRequest(output=tmp_path / "out", bone="ct.nrrd", bone_hu=300.0, coordinates="lps", **PLACES)
    made: Any = simulating._volume(asked)
    assert made[0] == (Path("ct.nrrd"), (PLACES["entry_mm"], PLACES["target_mm"]))
    assert (made[1]["bone_hu"], made[1]["coordinates"]) == (300.0, "lps")
    assert simulating._volume(SimulateRequest(output=tmp_path / "out")) is None
