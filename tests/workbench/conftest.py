"""A recording that takes a third of the time."""

import shutil
from pathlib import Path

import pytest
import tifffile
from made_once import MadeOnce

from endoct.workbench import unroll

SHORT = 13


@pytest.fixture(scope="session")
def short(quick_specimen: Path, made_once: MadeOnce) -> Path:
    """The first of the specimen's slices and frames: what unrolling is like, in a third of the time."""

    def make(specimen: Path) -> None:
        for part in ("oct", "endoscope"):
            (specimen / part).mkdir(parents=True)
            shutil.copy(quick_specimen / part / "acquisition.toml", specimen / part)
        tifffile.imwrite(
            specimen / "oct" / "pullback.tif",
            tifffile.imread(quick_specimen / "oct" / "pullback.tif")[:SHORT],
            photometric="minisblack",
        )
        for frame in sorted((quick_specimen / "endoscope").glob("frame_*"))[:SHORT]:
            shutil.copy(frame, specimen / "endoscope")

    return made_once("short", make)


@pytest.fixture(scope="session")
def walls(short: Path, made_once: MadeOnce) -> Path:
    """What `endoct unroll` makes of the two short recordings: ``oct/wall.zarr`` and ``endoscope/wall.zarr``."""

    def make(folder: Path) -> None:
        for side in ("oct", "endoscope"):
            (folder / side).mkdir(parents=True)
            unroll(short / side, folder / side / "wall.zarr", progress=False)

    return made_once("walls", make)


@pytest.fixture
def without_report(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have comparisons written without their report, whose figures cost seconds."""
    for name in ("begin_sides", "begin_both", "ComparisonFolder.write_report"):
        monkeypatch.setattr(f"endoct.workbench.pipeline.comparing.{name}", lambda *_, **__: [])
