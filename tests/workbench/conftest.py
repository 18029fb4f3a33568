"""A recording that takes a third of the time."""

import shutil
from pathlib import Path

import pytest
import tifffile

SHORT = 13


@pytest.fixture(scope="session")
def short(quick_specimen: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first of the specimen's slices and frames: what unrolling is like, in a third of the time."""
    specimen = tmp_path_factory.mktemp("short")
    for part in ("oct", "endoscope"):
        (specimen / part).mkdir()
        shutil.copy(quick_specimen / part / "acquisition.toml", specimen / part)
    tifffile.imwrite(
        specimen / "oct" / "pullback.tif",
        tifffile.imread(quick_specimen / "oct" / "pullback.tif")[:SHORT],
        photometric="minisblack",
    )
    for frame in sorted((quick_specimen / "endoscope").glob("frame_*"))[:SHORT]:
        shutil.copy(frame, specimen / "endoscope")
    return specimen
