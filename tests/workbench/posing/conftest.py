"""One bore, found once by both sides, and once by the camera alone."""

from collections.abc import Callable
from pathlib import Path

import pytest
from pose_case import PoseCase

from endoct.stitching.store import save_panorama
from endoct.workbench import pose
from endoct.workbench.cli import main
from endoct.workbench.posing.result import PoseResult

Command = Callable[..., tuple[int, list[str], str]]


@pytest.fixture(scope="session")
def case() -> PoseCase:
    return PoseCase.drawn()


@pytest.fixture(scope="session")
def files(case: PoseCase, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the CT, its labels, and what the camera sees as a panorama."""
    folder = tmp_path_factory.mktemp("bore")
    case.write_ct(folder / "ct.nrrd")
    case.write_ct(folder / "labels.nrrd", labels=True)
    save_panorama(case.panorama("camera"), folder / "camera.zarr")
    return folder


@pytest.fixture(scope="session")
def found(case: PoseCase, files: Path) -> PoseResult:
    """The pose by both, written to ``both``."""
    return pose(
        [case.panorama("ranger", turn_rad=2.0, columns=96), files / "camera.zarr"],
        files / "ct.nrrd",
        files / "both",
        entry_mm=case.plan.entry_mm,
        target_mm=case.plan.target_mm,
        labels=files / "labels.nrrd",
        progress=False,
    )


@pytest.fixture(scope="session")
def by_camera(case: PoseCase, files: Path) -> PoseResult:
    return pose(
        [files / "camera.zarr"],
        files / "ct.nrrd",
        entry_mm=case.plan.entry_mm,
        target_mm=case.plan.target_mm,
        progress=False,
    )


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    """Run `endoct pose`; return its exit status, the lines of its errors, and what it printed."""

    def run(*words: str | Path) -> tuple[int, list[str], str]:
        monkeypatch.setattr("sys.argv", ["endoct", "pose", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        assert isinstance(ended.value.code, int)
        return ended.value.code, [line for line in printed.err.splitlines() if line.startswith("endoct:")], printed.out

    return run
