"""Damaged and hostile files for every reader: each ends in one ``EndoctError`` of one line, or is read.

A fixed share of what ``python -m benchmarks.fuzz`` tries.
"""

import sys
import warnings
from pathlib import Path

import pytest

from benchmarks.fuzz.readers import READERS, seeds_of
from benchmarks.fuzz.running import plan_cases, run
from benchmarks.fuzz.telling import groups
from benchmarks.fuzz.trees import write_tree
from benchmarks.fuzz.watching import READ, REFUSED, tried

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="watches time and memory as POSIX has it")

QUICK = [name for name in READERS if name not in ("figures", "unfinished")]
"""To draw takes seconds; what a stopped run of the bench leaves is for the benchmark alone."""
PATIENT_S = 120.0
"""Ends a hang; no test depends on how long a reader takes."""


@pytest.mark.parametrize("name", QUICK)
def test_what_is_sound_is_read(name: str, tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        seeds = seeds_of(name)
    for number, sound in enumerate(seeds):
        case = tmp_path / str(number)
        write_tree(sound.files, case)
        outcome = tried(READERS[name].read, case / sound.target, case=case, seconds=PATIENT_S)
        assert outcome.kind == (REFUSED if sound.refused else READ), (sound.name, outcome.told)


def test_what_is_damaged_is_read_or_refused_in_one_line(tmp_path: Path) -> None:
    account = run(plan_cases(1500, QUICK), seed=2019, findings=tmp_path / "findings", seconds=PATIENT_S)
    assert not account.found, f"\n{groups(account)}"
    assert sum(sum(ends.values()) for ends in account.ends.values()) >= 1400
