"""A recording unrolled in a worker process gives what it gives in this one."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from endoct.base.errors import EndoctError
from endoct.workbench.running.progress import SilentStages
from endoct.workbench.running.scheduler import ALONE, Scheduler, one_blas_thread, scheduler
from endoct.workbench.sides.recordings import open_recording
from endoct.workbench.sides.sources import unroll_sources


@pytest.fixture
def two(monkeypatch: pytest.MonkeyPatch) -> Iterator[Scheduler]:
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    with scheduler() as work:
        yield work


def test_two_recordings_unroll_as_one_by_one(short: Path, two: Scheduler) -> None:
    # of one and the same recording, one copy is unrolled here and the other one there
    opened = open_recording(short / "oct")
    stages = SilentStages()
    with one_blas_thread():  # as every command has it: two would add in another order
        here, there = (made.panorama for made in unroll_sources((opened, opened), stages, two))
    assert {f"{step} {side} oct" for step in ("survey", "unroll", "settle") for side in "AB"} == set(stages.seconds)
    for name in ("intensity", "depth_mm", "valid", "weight", "z_mm"):
        assert getattr(here, name).tobytes() == getattr(there, name).tobytes(), name
    assert here.per_frame.keys() == there.per_frame.keys()
    for name, one in here.per_frame.items():
        assert one.values.tobytes() == there.per_frame[name].values.tobytes(), name
    assert here.provenance == there.provenance
    assert (here.notes, here.doubts) == (there.notes, there.doubts)


def test_what_cannot_be_used_is_told_in_the_same_line(tmp_path: Path, short: Path, two: Scheduler) -> None:
    (tmp_path / "acquisition.toml").write_text((short / "oct" / "acquisition.toml").read_text())
    np.save(tmp_path / "pullback.npy", np.random.default_rng(0).integers(90, 110, (5, 300, 256), dtype=np.uint8))
    unusable = open_recording(tmp_path)
    with pytest.raises(EndoctError) as one_by_one:
        unroll_sources((unusable, unusable), SilentStages(), ALONE)
    with pytest.raises(EndoctError) as at_once:
        unroll_sources((unusable, unusable), SilentStages(), two)
    assert str(at_once.value) == str(one_by_one.value)
