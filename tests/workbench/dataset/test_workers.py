"""Several processes make the same set as one, also where some of them die."""

import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import cheap_specimens
import cloudpickle
import pytest
from cheap_specimens import Cheap, contents, leftovers

from endoct.stitching.errors import EndoctError
from endoct.workbench.dataset.building import make_dataset
from endoct.workbench.dataset.identity import check_worker
from endoct.workbench.dataset.plan import Plan
from endoct.workbench.dataset.working import existing_cluster, own_cluster

PLAN = Plan(9, seed=5)


@pytest.fixture(autouse=True)
def _sent_to_workers() -> Iterator[None]:
    cloudpickle.register_pickle_by_value(cheap_specimens)
    yield
    cloudpickle.unregister_pickle_by_value(cheap_specimens)


@pytest.fixture
def by_one(tmp_path: Path) -> dict[str, bytes]:
    make_dataset(tmp_path / "by one", PLAN, workers=1, make=Cheap(tmp_path / "log of one"))
    return contents(tmp_path / "by one")


def test_a_killed_worker_costs_nothing_but_what_it_was_at(tmp_path: Path, by_one: dict[str, bytes]) -> None:
    cheap = Cheap(tmp_path / "log", seconds=0.4)
    killed: list[int] = []

    def kill_one() -> None:
        while len(cheap.noted("end")) < 3 or not (begun := cheap.log.read_text().split("\n")[-2]).startswith("begin"):
            time.sleep(0.02)
        worker = int(begun.split()[2])
        assert worker != os.getpid()
        os.kill(worker, signal.SIGKILL)
        killed.append(worker)

    killer = threading.Thread(target=kill_one, daemon=True)
    killer.start()
    built = make_dataset(tmp_path / "set", PLAN, workers=2, make=cheap)
    killer.join()
    assert killed
    assert built.made >= PLAN.count - 2  # who dies between finishing and saying so is not heard
    assert contents(tmp_path / "set") == by_one
    assert sorted(cheap.noted("end")) == list(range(PLAN.count))
    assert not leftovers(tmp_path / "set")


def test_workers_of_an_existing_cluster_make_the_same(tmp_path: Path, by_one: dict[str, bytes]) -> None:
    with own_cluster(2) as client:
        address = client.scheduler.address
        make_dataset(tmp_path / "set", PLAN, scheduler=address, make=Cheap(tmp_path / "log"))
    assert contents(tmp_path / "set") == by_one


def test_an_error_of_a_worker_is_told_as_it_is(tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match=r"set cannot be written; found No such file or directory"):
        make_dataset(tmp_path / "set", PLAN, workers=2, make=Cheap(tmp_path / "missing" / "log"))
    assert not (tmp_path / "set").exists()


def test_no_scheduler_and_a_worker_that_does_not_see_the_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("endoct.workbench.dataset.working.CONNECT_S", 0.3)
    with (
        pytest.raises(EndoctError, match=r"no scheduler answers at tcp://127\.0\.0\.1:9"),
        existing_cluster("tcp://127.0.0.1:9"),
    ):
        pass
    with pytest.raises(EndoctError, match="does not see"):
        check_worker(tmp_path / "set")
    with pytest.raises(EndoctError, match="exclude"):
        make_dataset(tmp_path / "set", PLAN, workers=2, scheduler="tcp://127.0.0.1:9")
