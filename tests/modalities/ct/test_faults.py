"""Volumes with one fault each, drawn at random: none is believed. Without a fault each is read to 0.01 mm.

A fixed share of what ``python -m benchmarks.ct_faults`` tries.
"""

import sys
from pathlib import Path

import pytest

from benchmarks.ct_faults.faults import FAULTS, SOUND
from benchmarks.ct_faults.trial import BELIEVED, CODINGS, RIGHT, tried, tried_coding

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="writes links and pipes")
EACH = 4
OF_CODINGS = 60


@pytest.mark.parametrize("fault", FAULTS)
def test_a_volume_with_a_fault_is_not_believed(fault: str, tmp_path: Path) -> None:
    for number in range(EACH):
        trial = tried(fault, number, 2024, tmp_path / "case")
        assert trial.end != BELIEVED, (number, trial.said)
        assert "\n" not in trial.said


@pytest.mark.parametrize("container", SOUND)
def test_a_sound_volume_is_read_where_it_lies(container: str, tmp_path: Path) -> None:
    for number in range(EACH):
        trial = tried(container, number, 2024, tmp_path / "case")
        assert trial.end == RIGHT, (number, trial.said)


@pytest.mark.parametrize("kind", CODINGS)
def test_headers_that_contradict_samples_are_not_believed(kind: str, tmp_path: Path) -> None:
    for number in range(OF_CODINGS):
        trial = tried_coding(kind, number, 2024, tmp_path / "case")
        assert trial.end != BELIEVED, (number, trial.fault, trial.said)
        assert "\n" not in trial.said
