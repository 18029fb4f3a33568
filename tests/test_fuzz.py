"""Damaged and hostile files for every reader: each ends in one ``EndoctError`` of one line, or is read.

A fixed share of what ``python -m benchmarks.fuzz`` tries.
"""

import gc
import itertools
import os
import signal
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.fuzz import case_process
from benchmarks.fuzz.account_tables import groups, kinds, table
from benchmarks.fuzz.campaign import Account, plan_cases, run
from benchmarks.fuzz.case_process import Case, Report
from benchmarks.fuzz.outcome import READ, REFUSED, Outcome, outcome_of
from benchmarks.fuzz.readers import READERS, seeds_of
from benchmarks.fuzz.trees import write_tree
from endoct.base.errors import EndoctError

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="watches time and memory as POSIX has it")

QUICK = [name for name in READERS if name != "figures"]
"""To draw takes seconds."""
LINUX = pytest.mark.skipif(sys.platform != "linux", reason="only Linux forgets the peak of resident memory")
PATIENT_S = 120.0
"""Ends a hang; no test depends on how long a reader takes."""


class _TwoLines(EndoctError):
    def __str__(self) -> str:
        return "two\nlines"


def _says_two_lines(_: Path) -> None:
    raise _TwoLines("x")


def _waits_for_ever(path: Path) -> None:
    os.mkfifo(path / "pipe")
    (path / "pipe").read_bytes()


def _takes_memory(_: Path) -> None:
    np.ones(40_000_000)


@pytest.mark.parametrize(
    ("read", "kind"),
    [
        (lambda path: None, READ),
        (lambda path: (path / "a\0b").stat(), "ValueError"),
        (_says_two_lines, "message of several lines"),
        (lambda path: (path / ".." / "beside").read_bytes(), "reaches outside"),
        (_waits_for_ever, "too long"),
        pytest.param(_takes_memory, "much memory", marks=LINUX),
    ],
)
def test_the_watch_sees(
    read: Callable[[Path], object], kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("benchmarks.fuzz.outcome.MOST_BYTES", 40_000_000)
    (tmp_path / "beside").write_bytes(b"")
    (tmp_path / "case").mkdir()
    seconds = 0.2 if kind == "too long" else PATIENT_S
    gc.collect()  # what other tests left must not be given back meanwhile
    assert outcome_of(read, tmp_path / "case", case=tmp_path / "case", seconds=seconds).kind == kind


@pytest.mark.parametrize(("alarms", "kind"), [(1, READ), (2, "too long")])
def test_a_machine_that_stood_still_is_no_reader_that_waits(
    alarms: int, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = SimpleNamespace(monotonic=itertools.count(step=10).__next__, process_time=lambda: 0.0)
    monkeypatch.setattr("benchmarks.fuzz.outcome.time", clock)

    def read(_: Path) -> None:
        for _ in range(alarms):
            signal.raise_signal(signal.SIGALRM)

    assert outcome_of(read, tmp_path, case=tmp_path, seconds=PATIENT_S).kind == kind


@pytest.mark.parametrize(("module", "kind"), [("numba.np.arrayobj", READ), ("endoct.base", "reaches outside")])
def test_what_numba_opens_of_its_own_is_no_reach_outside(module: str, kind: str, tmp_path: Path) -> None:
    name = f"{Path(__file__).parent}/../tests/{Path(__file__).name}"
    read = eval("lambda _: open(name).close()", {"__name__": module, "name": name})
    assert outcome_of(read, tmp_path / "case", case=tmp_path / "case", seconds=PATIENT_S).kind == kind


@pytest.mark.parametrize("name", QUICK)
def test_what_is_sound_is_read(name: str, tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        seeds = seeds_of(name)
    for number, sound in enumerate(seeds):
        case = tmp_path / str(number)
        write_tree(sound.files, case)
        outcome = outcome_of(READERS[name].read, case / sound.target, case=case, seconds=PATIENT_S)
        assert outcome.kind == (REFUSED if sound.refused else READ), (sound.name, outcome.message)


def test_what_is_damaged_is_read_or_refused_in_one_line(tmp_path: Path) -> None:
    account = run(plan_cases(1500, QUICK), seed=2019, findings=tmp_path / "findings", seconds=PATIENT_S)
    assert not account.findings, f"\n{groups(account)}"
    assert sum(sum(ends.values()) for ends in account.ends.values()) >= 1400


def test_damaged_weights_are_read_each_by_itself(tmp_path: Path) -> None:
    """As cases lie: one after the other in one place."""
    (sound,) = seeds_of("eye")
    whole, read, path = sound.files[sound.target], READERS["eye"].read, tmp_path / sound.target
    assert isinstance(whole, bytes)
    kinds_of = []
    for data in (whole, whole[:-2] + b"\xff\x7f", whole):
        path.write_bytes(data)
        kinds_of.append(outcome_of(read, path, case=tmp_path, seconds=PATIENT_S).kind)
    assert kinds_of == [READ, REFUSED, READ]


def test_an_output_is_replaced_only_as_it_was_written(tmp_path: Path) -> None:
    of = {seed.name: seed for seed in seeds_of("outputs")}
    sound, read = of["output, without a part"], READERS["outputs"].read
    for name, changed, gone in (
        ("whole", {}, True),
        ("lacks", {"out/zarr.json": None}, True),
        ("more", {"out/thesis.tex": b"mine"}, False),
        ("altered", {"out/zarr.json": b"{}"}, False),
    ):
        case = tmp_path / name
        write_tree({path: data for path, data in (sound.files | changed).items() if data is not None}, case)
        assert outcome_of(read, case / "out", case=case, seconds=PATIENT_S).kind == READ
        assert ([path.name for path in (case / "out").iterdir()] == ["endoct-output.json"]) is gone


def test_an_account_says_what_was_never_entered() -> None:
    account = Account()
    for sound, outcome, entered in (
        ("flat", Outcome(READ), True),
        ("deep", Outcome(REFUSED, "x:y", "no"), False),
        ("deep", Outcome(REFUSED, "x:z", "no"), True),
    ):
        account.add(Report(Case("tiff", 1), outcome, sound=sound, entered=entered), None)
    account.add(Report(Case("video", 1), Outcome(REFUSED, "x:y", "no"), sound="mkv", entered=False), None)
    assert account.reading_nothing == ["video"]
    assert table(account).splitlines()[1].split() == ["tiff", "3", "2", "1", "2", "0", "0"]
    assert kinds(account).splitlines()[1].split() == ["tiff:", "deep", "2", "1", "0"]


def test_what_is_refused_as_an_empty_file_is_not_entered(tmp_path: Path) -> None:
    sound = next(seed for seed in seeds_of("npy") if seed.target)
    first = case_process._first_check("npy", sound, tmp_path / "empty")
    assert first == "modalities.reading.recording:open_stack"
    write_tree(sound.files, tmp_path / "case")
    target, read = tmp_path / "case" / sound.target, READERS["npy"].read
    target.write_bytes(bytes(sound.files[sound.target])[:-1])  # type: ignore[arg-type]
    outcome = outcome_of(read, target, case=tmp_path / "case", seconds=PATIENT_S)
    assert outcome.kind == REFUSED
    assert outcome.where != first
