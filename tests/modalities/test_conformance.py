"""The two modalities that come with endoct keep the contract, on a part of a simulated specimen."""

import shutil
from pathlib import Path

import pytest
import tifffile

from endoct.modalities.conformance import CHECKS, Check, Subject
from endoct.modalities.reading.recording import open_stack
from endoct.modalities.registry import manifests

FRAMES = range(12, 26)


@pytest.fixture(scope="module", params=["oct", "endoscope"])
def subject(request: pytest.FixtureRequest, quick_specimen: Path, tmp_path_factory: pytest.TempPathFactory) -> Subject:
    whole, part = quick_specimen / request.param, tmp_path_factory.mktemp("part")
    shutil.copy(whole / "acquisition.toml", part)
    if request.param == "oct":
        stack = open_stack(whole)
        tifffile.imwrite(part / "pullback.tif", [stack[index] for index in FRAMES], photometric="minisblack")
    else:
        files = open_stack(whole).reader.files  # type: ignore[attr-defined]
        for index in FRAMES:
            shutil.copy(files[index], part)
    return Subject(manifests()[request.param], part)


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_it_conforms(check: Check, subject: Subject) -> None:
    check(subject)
