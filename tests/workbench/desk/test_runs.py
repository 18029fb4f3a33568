"""The queue: it goes on whoever is killed, and says what came of every run."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest
from processes import has_ended

from endoct.base.errors import EndoctError
from endoct.base.files.scratch import held
from endoct.workbench.desk import runs
from endoct.workbench.desk.runs import Queue, Run
from endoct.workbench.page.server import Json

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals")
LONGEST_S = 120


@pytest.fixture
def queue(tmp_path: Path) -> Iterator[Queue]:
    made = Queue(tmp_path / "queue", at_once=1)
    yield made
    made.leave()
    for run in made.runs():
        made.cancel(run.name)
    until(lambda: all(run.state != "running" for run in made.runs()))


def until(holds: Callable[[], bool]) -> None:
    for _ in range(LONGEST_S * 10):
        if holds():
            return
        time.sleep(0.1)
    pytest.fail("that never came")


def ended(queue: Queue) -> list[Run]:
    until(lambda: not any(run.is_open for run in queue.runs()))
    return queue.runs()


def test_runs_end_one_after_the_other_and_say_how(queue: Queue, tmp_path: Path):
    names = [
        queue.add(["target", "--output=tube"], tmp_path),
        queue.add(["unroll", "nothing", "--output=x.zarr"], tmp_path),
        queue.add(["target", "--output=tube"], tmp_path / "gone"),
    ]
    assert [run.state for run in queue.runs()] == ["waiting"] * 3
    queue.start()
    done, failed, gone = ended(queue)
    assert [run.name for run in (done, failed, gone)] == names
    assert [run.state for run in (done, failed, gone)] == ["done", "failed", "failed"]
    assert (tmp_path / "tube" / "tube.toml").is_file()
    assert failed.last_line == "endoct: nothing does not exist; check the path"
    assert "gone cannot be used" in gone.last_line
    assert queue.log(names[0]) == "tube: tube"
    assert done.to_json()["command"] == "endoct target --output=tube"


def test_one_output_is_not_written_by_two_runs(queue: Queue, tmp_path: Path):
    queue.add(["target", "--output=tube"], tmp_path)
    with pytest.raises(EndoctError, match="in the queue already"):
        queue.add(["target", "--output=./x/../tube"], tmp_path)
    queue.add(["target", "--output=tube"], tmp_path / "elsewhere")


def test_a_run_that_waits_is_cancelled_and_one_under_way_leaves_nothing(queue: Queue, tmp_path: Path):
    queue.start()
    first = queue.add(["simulate", "--output=one", "--preset=quick"], tmp_path)
    second = queue.add(["simulate", "--output=two", "--preset=quick"], tmp_path)
    until(lambda: bool(queue.run(first).stages))
    queue.cancel(second)
    queue.cancel(first)
    assert [run.state for run in ended(queue)] == ["cancelled", "cancelled"]
    assert [path.name for path in tmp_path.iterdir()] == ["queue"]
    queue.cancel(first)  # which has ended: nothing happens
    again = queue.repeat(second)
    assert queue.run(again).arguments == queue.run(second).arguments
    queue.cancel(again)
    queue.clear()
    assert [run.name for run in queue.runs() if not run.is_open] in ([], [again])


def test_what_is_under_way_outlives_the_server_and_what_waits_goes_on_with_the_next(tmp_path: Path):
    """The server is killed: its run ends as if nothing had been; another server does the rest."""
    program = (
        "import sys, time; from pathlib import Path; from endoct.workbench.desk.runs import Queue\n"
        "Queue(Path(sys.argv[1]), at_once=1).start(); print('started', flush=True); time.sleep(1000)"
    )
    place = tmp_path / "queue"
    queue = Queue(place, at_once=1)
    names = [queue.add(["target", f"--output=tube-{k}"], tmp_path) for k in range(3)]
    with subprocess.Popen([sys.executable, "-c", program, str(place)], stdout=subprocess.PIPE) as server:
        until(lambda: queue.run(names[0]).state == "running")
        server.send_signal(signal.SIGKILL)
    until(lambda: queue.run(names[0]).state == "done")
    time.sleep(3 * runs.LOOK_S)
    assert [run.state for run in queue.runs()] == ["done", "waiting", "waiting"]
    following = Queue(place, at_once=1)
    following.start()
    assert [run.state for run in ended(following)] == ["done"] * 3
    following.leave()


def test_two_servers_start_nothing_twice(tmp_path: Path):
    both = [Queue(tmp_path / "queue", at_once=2) for _ in range(2)]
    for k in range(4):
        both[k % 2].add(["target", f"--output=tube-{k}"], tmp_path)
    for each in both:
        each.start()
    assert [run.state for run in ended(both[0])] == ["done"] * 4  # a second start would find the output and fail
    for each in both:
        each.leave()


def test_a_run_whose_process_was_killed_is_lost(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(runs, "STARTING_S", 0.0)
    queue = Queue(tmp_path / "queue")
    name = queue.add(["target", "--output=tube"], tmp_path)
    (tmp_path / "queue" / name / runs.STARTED).touch()
    assert queue.run(name).state == "lost"
    assert not queue.run(name).is_open


def test_a_command_ends_with_its_process_and_is_under_way_until_then(
    queue: Queue, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    queue.start()
    name = queue.add(["simulate", "--output=one", "--preset=quick"], tmp_path)
    until(lambda: bool(queue.run(name).stages))
    keeper = int((queue.folder / name / runs.LOCK).read_text().split()[1])
    (command,) = (one.pid for one in psutil.Process(keeper).children() if one.name() != "sh")
    os.kill(command, signal.SIGSTOP)  # it does not end before it is looked at
    monkeypatch.setattr(runs, "STARTING_S", 0.0)  # so that the lock alone says that it is under way
    os.kill(keeper, signal.SIGKILL)
    assert has_ended(keeper)
    assert queue.run(name).state == "running"
    with pytest.raises(EndoctError, match="in the queue already"):
        queue.repeat(name)
    os.kill(command, signal.SIGCONT)
    assert has_ended(command)
    until(lambda: queue.run(name).state == "lost")
    queue.clear()
    assert [path.name for path in tmp_path.iterdir()] == ["queue"]


def test_a_clock_that_is_set_back_says_nothing_of_a_run(queue: Queue, tmp_path: Path) -> None:
    name = queue.add(["target", "--output=tube"], tmp_path)
    place = queue.folder / name
    (place / runs.STARTED).touch()
    os.utime(place / runs.STARTED, (time.time() + 86_400,) * 2)
    assert queue.run(name).state == "lost"
    with held(place / runs.LOCK):
        run = queue.run(name)
    assert (run.state, run.seconds) == ("running", None)


@pytest.mark.parametrize(
    ("text", "state", "seconds"),
    [
        ('{"status": 0, "seconds": 2}', "done", 2.0),
        ('{"status": 0, "seconds": -86396}', "done", None),
        ('{"status": 0, "seconds": NaN}', "done", None),
        ('{"status": 0, "seconds": Infinity}', "done", None),
        ('{"status": Infinity, "seconds": 2}', "failed", None),
        ('{"status": 0', "failed", None),
    ],
)
def test_a_damaged_end_closes_nothing(
    queue: Queue, tmp_path: Path, text: str, state: str, seconds: float | None
) -> None:
    name, _ = (queue.add(["target", f"--output={output}"], tmp_path) for output in ("tube", "other"))
    (queue.folder / name / runs.STARTED).touch()
    (queue.folder / name / runs.ENDED).write_text(text)
    first, second = queue.runs()
    assert (first.state, first.seconds, second.state) == (state, seconds, "waiting")
    assert Json([first.to_json(), second.to_json()]).status_code == 200
    queue.add(["target", "--output=third"], tmp_path)


@pytest.mark.parametrize("name", ["../state", "", "1/../..", "x", "9" * 50, "1"])
def test_no_name_leads_elsewhere(queue: Queue, name: str):
    with pytest.raises(EndoctError, match="no such run"):
        queue.run(name)


@pytest.mark.parametrize(
    "request_text",
    [
        "",
        "[]",
        "{}",
        '{"arguments": [], "folder": "/"}',
        '{"arguments": [1], "folder": 2}',
        '{"arguments": ["\\ud800"], "folder": "/"}',
        '{"arguments": ["x"], "folder": "/\\u0000"}',
    ],
)
def test_what_is_no_run_is_passed_over(queue: Queue, request_text: str):
    (queue.folder / "00000000000000000001").mkdir()
    (queue.folder / "00000000000000000001" / runs.REQUEST).write_text(request_text)
    assert queue.runs() == []


def test_the_end_of_the_log_says_how_far_it_is(queue: Queue, tmp_path: Path):
    name = queue.add(["unroll", "x"], tmp_path)
    place = tmp_path / "queue" / name
    (place / runs.STARTED).touch()
    (place / runs.LOG).write_text("survey A oct\nafter 3 s: survey A oct 40%, unroll: 2, B 7%\n")
    assert queue.run(name).stages == {"survey A oct": 0.4, "unroll: 2, B": 0.07}
    with (place / runs.LOG).open("a") as log:
        log.write("settle\n")
    run = queue.run(name)
    assert (run.stages, run.last_line) == ({"settle": 0.0}, "settle")
    assert queue.log(name) == "survey A oct\nsettle"
    (place / runs.ENDED).write_text(json.dumps({"status": 3, "seconds": 2.5}))
    run = queue.run(name)
    assert (run.state, run.seconds, run.stages) == ("unanswered", 2.5, {})
    assert queue.folder.stat().st_mode & 0o077 == 0


def test_a_window_that_clears_meanwhile_stops_nobody(queue: Queue, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """What is about to be started may be gone; what comes after it is started all the same."""
    real, failing = runs._start, [True]

    def start(path: Path) -> None:
        if failing:
            failing.clear()
            raise FileNotFoundError(path)
        real(path)

    monkeypatch.setattr(runs, "_start", start)
    queue.add(["target", "--output=tube"], tmp_path)
    queue.start()
    assert [run.state for run in ended(queue)] == ["done"]
    assert not runs._is_held(tmp_path / "gone" / runs.LOCK)


@pytest.mark.parametrize(
    ("ago_s", "state", "seconds"),
    [(5, "running", 5), (19, "running", 19), (21, "lost", None), (-3600, "lost", None)],
)
def test_a_run_without_a_process_is_lost_once_it_had_the_time_to_start(
    ago_s: float, state: str, seconds: float | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    (tmp_path / runs.STARTED).write_text("")
    begun_s = (tmp_path / runs.STARTED).stat().st_mtime
    monkeypatch.setattr(runs.time, "time", lambda: begun_s + ago_s)
    assert runs._state(tmp_path) == (state, seconds if seconds is None else pytest.approx(seconds))
    (tmp_path / runs.STARTED).unlink()
    assert runs._state(tmp_path) == ("waiting", None)
    (tmp_path / runs.CANCEL).write_text("")
    assert runs._state(tmp_path) == ("cancelled", None)


@pytest.mark.parametrize(
    ("ended", "state", "seconds"),
    [
        ({"status": 0, "seconds": 2.5}, "done", 2.5),
        ({"status": 0, "seconds": -1}, "done", None),
        ({"status": 77, "seconds": 1}, "failed", 1),
        ({"status": 0}, "failed", None),
    ],
)
def test_how_a_run_ended_is_what_its_file_says(
    ended: dict[str, float], state: str, seconds: float | None, tmp_path: Path
):
    (tmp_path / runs.ENDED).write_text(json.dumps(ended))
    assert runs._state(tmp_path) == (state, seconds)
