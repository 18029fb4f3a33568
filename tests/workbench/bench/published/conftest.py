"""A set of two small specimens that tests share."""

import shutil
from pathlib import Path

import pytest
from made_once import MadeOnce
from published_sets import planned_specimen

from endoct.workbench.bench.published import standings
from endoct.workbench.bench.published.definition import Planned
from endoct.workbench.bench.published.making import make_specimen, simulated_specimen
from endoct.workbench.bench.published.specimen_set import SET_FILE, SpecimenSet
from endoct.workbench.bench.published.submitted import Submission, check_credible


@pytest.fixture(scope="session")
def plan() -> Planned:
    """The first specimen of the set."""
    return planned_specimen("easy", 11)


@pytest.fixture(scope="session")
def made_set(made_once: MadeOnce, plan: Planned) -> Path:
    """A set on disk. Tests must not change it."""

    def make(folder: Path) -> None:
        folder.mkdir()
        specimens = [plan, planned_specimen("hard", 12)]
        entries = tuple(make_specimen(folder, specimen, simulated_specimen) for specimen in specimens)
        content = SpecimenSet(set="endoct-bench-2", half="public", size="small", key="", versions={}, specimens=entries)
        (folder / SET_FILE).write_text(content.model_dump_json(), encoding="utf-8")

    return made_once("published_set", make)


@pytest.fixture
def sets_of_any_size(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have boards take submissions on a few specimens of any name for whole."""

    def check(submission: Submission, name: str, _: object) -> None:
        check_credible(submission, name, [one.name for one in submission.specimens])

    monkeypatch.setattr(standings, "check_credible", check)


@pytest.fixture
def changed_set(made_set: Path, tmp_path: Path) -> Path:
    """A copy of the set that a test may change."""
    return Path(shutil.copytree(made_set, tmp_path / "copy"))
