"""Recordings whose files are named, copied, coded or cut as people have them, drawn at random: none believed wrongly.

A fixed share of what ``python -m benchmarks.frame_faults`` tries.
"""

from pathlib import Path

import pytest

from benchmarks.frame_faults.trial import ALL, BELIEVED, MUST_BE_READ, REFUSED, tried


@pytest.mark.parametrize("fault", ALL)
def test_a_recording_is_not_believed_wrongly(fault: str, tmp_path: Path) -> None:
    trial = tried(fault, 0, 2026, tmp_path / "case")
    assert trial.end != BELIEVED, trial.said
    assert fault not in MUST_BE_READ or trial.end != REFUSED, trial.said
    assert "\n" not in trial.said
