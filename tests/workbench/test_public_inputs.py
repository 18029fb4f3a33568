"""Inputs reduced from public reports: each is read rightly, or refused in one line for the right reason."""

from pathlib import Path

import pytest

from benchmarks.public_inputs import INPUTS, outcome

FOLDERS = ("inputs", "more-inputs")


@pytest.mark.parametrize("name", INPUTS)
def test_an_input_is_read_rightly_or_refused(name: str, recordings: Path) -> None:
    folder = next((each for each in map(recordings.joinpath, FOLDERS) if (each / name).is_dir()), None)
    if folder is None:
        pytest.skip(f"{recordings} has no {name}")
    found = outcome(folder, name)
    assert found.right, found.said


def test_every_input_that_is_there_is_tried(recordings: Path) -> None:
    there = {path.name for path in (recordings / "inputs").iterdir() if path.is_dir()}
    assert there <= set(INPUTS)
