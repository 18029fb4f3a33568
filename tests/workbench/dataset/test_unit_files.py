"""Several processes make the same set as one, also where some of them die."""

import json
import os
import shutil
import signal
import socket
import ssl
import stat
import subprocess
import sys
import tarfile
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import cheap_specimens
import cloudpickle
import dask
import psutil
import pytest
from cheap_specimens import Cheap, contents, leftovers
from distributed import Client, LocalCluster
from distributed.security import Security

from endoct.base.errors import EndoctError
from endoct.workbench.dataset.creation import make_dataset
from endoct.workbench.dataset.identity import check_worker, write_identity
from endoct.workbench.dataset.plan import DatasetPlan, Job, units
from endoct.workbench.dataset.set_files import add_member
from endoct.workbench.dataset.unit_files import Done, _make_on_worker, copy_specimens, make_unit
from endoct.workbench.running.cluster import existing_cluster, own_cluster

PLAN = DatasetPlan(9, seed=5)


@pytest.fixture(autouse=True)
def _sent_to_workers() -> Iterator[None]:
    cloudpickle.register_pickle_by_value(cheap_specimens)
    yield
    cloudpickle.unregister_pickle_by_value(cheap_specimens)


@pytest.fixture(scope="module", autouse=True)
def small_sheet() -> Iterator[None]:
    """Show two specimens on the contact sheet, whose drawing takes longer than all else here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("endoct.workbench.dataset.overview.N_SPECIMENS", 2)
        yield


@pytest.fixture(scope="module")
def by_one(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    place = tmp_path_factory.mktemp("by one")
    make_dataset(place / "set", PLAN, workers=1, make=Cheap(place / "log"))
    return contents(place / "set")


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


@pytest.mark.parametrize(
    "plan", [DatasetPlan(2, seed=5), DatasetPlan(3, seed=5, format="webdataset", specimens_per_shard=3)]
)
def test_a_unit_that_comes_twice_is_made_once(tmp_path: Path, plan: DatasetPlan) -> None:
    cheap, root = Cheap(tmp_path / "log"), tmp_path / "set"
    root.mkdir()
    *_, unit = units(plan)
    first, second = (make_unit(root, plan, unit, cheap) for _ in range(2))
    count = len(unit.indices)
    assert (first.specimens, first.made) == (count, count)
    assert second == Done(count, 0, 0.0, first.bytes)
    whole = root / unit.place
    n_bytes = sum(path.stat().st_size for path in (whole, *whole.rglob("*")) if path.is_file())
    assert first.bytes == n_bytes > 1000
    assert first.seconds > 0
    assert cheap.noted("begin") == list(unit.indices)


@pytest.mark.parametrize("protocol", ["tcp", "tls"])
def test_workers_of_an_existing_cluster_make_the_same(tmp_path: Path, by_one: dict[str, bytes], protocol: str) -> None:
    with (
        dask.config.set(_credentials(tmp_path) if protocol == "tls" else {}),
        LocalCluster(
            n_workers=2, threads_per_worker=1, host="127.0.0.1", protocol=protocol, dashboard_address="127.0.0.1:0"
        ) as cluster,
    ):
        address = cluster.scheduler_address
        assert address.startswith(f"{protocol}://")
        make_dataset(tmp_path / "set", PLAN, scheduler=address, make=Cheap(tmp_path / "log"))
    assert contents(tmp_path / "set") == by_one


@dataclass
class Cluster:
    """A scheduler with a worker, each a process of its own as somebody else would start them."""

    scheduler: "subprocess.Popen[str]"
    worker: "subprocess.Popen[bytes]"
    address: str


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    dask_program, said = [sys.executable, "-m", "distributed.cli.dask_scheduler"], tmp_path / "scheduler.json"
    options = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(said)]
    knows = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}  # where makers of these tests lie
    quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": knows}
    scheduler = subprocess.Popen([*dask_program, *options], text=True, **quiet)
    while not said.exists() or not said.read_text().endswith("}"):
        time.sleep(0.05)
    address = json.loads(said.read_text())["address"]
    run = [
        sys.executable,
        "-m",
        "distributed.cli.dask_worker",
        address,
        "--nthreads",
        "1",
        "--no-dashboard",
        "--no-nanny",
    ]
    worker = subprocess.Popen(run, **quiet)
    yield Cluster(scheduler, worker, address)
    for process in (worker, scheduler):
        process.kill()
        process.wait()


def when_begun(cheap: Cheap, act: Callable[[], None]) -> threading.Thread:
    """Do something as soon as a first specimen is begun, in a thread that is returned."""

    def wait() -> None:
        while not cheap.noted("begin"):
            time.sleep(0.02)
        act()

    thread = threading.Thread(target=wait, daemon=True)
    thread.start()
    return thread


def test_a_set_that_was_interrupted_before_its_first_specimen_can_be_completed(
    tmp_path: Path, by_one: dict[str, bytes], cluster: Cluster
) -> None:
    cheap = Cheap(tmp_path / "log", seconds=1.0)
    interrupting = when_begun(cheap, lambda: os.kill(os.getpid(), signal.SIGINT))
    with pytest.raises(KeyboardInterrupt):
        make_dataset(tmp_path / "set", PLAN, scheduler=cluster.address, make=cheap)
    interrupting.join()
    assert not cheap.noted("end")
    while not cheap.noted("end"):  # the worker finishes what it was at
        time.sleep(0.02)
    make_dataset(tmp_path / "set", PLAN, scheduler=cluster.address, make=Cheap(tmp_path / "log 2"))
    assert contents(tmp_path / "set") == by_one
    assert not leftovers(tmp_path / "set")


def test_a_set_whose_scheduler_was_lost_can_be_completed(
    tmp_path: Path, by_one: dict[str, bytes], cluster: Cluster, capfd: pytest.CaptureFixture[str]
) -> None:
    cheap = Cheap(tmp_path / "log", seconds=1.0)
    losing = when_begun(cheap, cluster.scheduler.kill)
    with pytest.raises(EndoctError, match=r"the cluster was lost.*start again with the same arguments"):
        make_dataset(tmp_path / "set", PLAN, scheduler=cluster.address, make=cheap)
    losing.join()
    assert "Traceback" not in "".join(capfd.readouterr())
    cluster.worker.kill()  # it may be at work still, or not
    cluster.worker.wait()
    make_dataset(tmp_path / "set", PLAN, workers=1, make=Cheap(tmp_path / "log 2"))
    assert contents(tmp_path / "set") == by_one


@dataclass(frozen=True)
class Meanwhile(Cheap):
    """Does something to the set once a specimen is made."""

    root: Path = Path()
    other: DatasetPlan | None = None

    def __call__(self, folder: Path, plan: DatasetPlan, job: Job) -> None:
        super().__call__(folder, plan, job)
        shutil.rmtree(self.root)
        if self.other is not None:
            self.root.mkdir()
            write_identity(self.root, self.other)
        (folder / "truth").mkdir(parents=True)  # as a library goes on to write where it was


@pytest.mark.parametrize("other", [None, DatasetPlan(9, seed=6)], ids=["removed", "replaced"])
def test_a_worker_puts_nothing_into_a_set_that_is_gone_or_another(tmp_path: Path, other: DatasetPlan | None) -> None:
    root = tmp_path / "set"
    root.mkdir()
    write_identity(root, PLAN)
    with pytest.raises(EndoctError, match="was begun with another --seed" if other else "does not see"):
        _make_on_worker(root, PLAN, next(units(PLAN)), Meanwhile(tmp_path / "log", root=root, other=other))
    assert not list(root.glob("specimens/*"))
    assert root.exists() == (other is not None)


def _credentials(folder: Path) -> dict[str, str]:
    """Return what a user tells Dask, in its configuration, of credentials in files."""
    made = Security.temporary()
    (folder / "certificate.pem").write_text(made.tls_ca_file)
    (folder / "key.pem").write_text(made.tls_client_key)
    told = {"distributed.comm.tls.ca-file": str(folder / "certificate.pem")}
    for role in ("client", "scheduler", "worker"):
        told[f"distributed.comm.tls.{role}.cert"] = str(folder / "certificate.pem")
        told[f"distributed.comm.tls.{role}.key"] = str(folder / "key.pem")
    return told


def listening() -> set[Any]:
    """Where this process and those that it started listen; a browser of other tests may be among them."""
    ours = [psutil.Process(), *psutil.Process().children(recursive=True)]
    return {one.laddr for each in ours for one in each.net_connections("tcp") if one.status == psutil.CONN_LISTEN}


def test_who_has_no_credentials_is_refused(tmp_path: Path) -> None:
    before = listening()
    with own_cluster(2) as client:
        port = urlsplit(client.scheduler.address).port
        for address, security in (
            (f"tcp://127.0.0.1:{port}", None),
            (f"tls://127.0.0.1:{port}", Security.temporary()),
        ):
            with pytest.raises(OSError, match=r"closed|reset|does not match"):
                Client(address, security=security, timeout=60)
        # nannies and workers take no one else either: each asks for a certificate
        open_ = listening() - before
        assert len(open_) == 1 + 2 + 2
        for place in open_:
            assert place.ip == "127.0.0.1"
            assert _refuses(place.port)
        assert client.submit(os.getpid).result() != os.getpid()


def _refuses(port: int) -> bool:
    """Whether a caller that speaks TLS, but has no certificate, is sent away, and one that speaks HTTP as well."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    try:
        with context.wrap_socket(socket.create_connection(("127.0.0.1", port), timeout=10)) as secure:
            secure.sendall(b"GET / HTTP/1.0\r\n\r\n")
            answered = bool(secure.recv(1))
    except ssl.SSLError:
        answered = False
    with suppress(ConnectionError), socket.create_connection(("127.0.0.1", port), timeout=10) as plain:
        plain.sendall(b"GET / HTTP/1.0\r\n\r\n")
        answered = answered or b"HTTP" in plain.recv(100)
    return not answered


def test_credentials_are_nobody_elses_to_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    seen: list[int] = []
    load = ssl.SSLContext.load_cert_chain

    def looking(context: ssl.SSLContext, certificate: str, key: str) -> None:
        seen.append(stat.S_IMODE(Path(key).parent.stat().st_mode))
        load(context, certificate, key)

    monkeypatch.setattr(ssl.SSLContext, "load_cert_chain", looking)
    with own_cluster(1) as client:
        key = client.security.tls_client_key.encode()
        files = [path for path in tmp_path.rglob("*") if path.is_file()]
        assert not any(key in path.read_bytes() for path in files)
        children = psutil.Process().children(recursive=True)
        assert not any(b"PRIVATE KEY" in " ".join(child.cmdline()).encode() for child in children)
    assert seen
    assert set(seen) == {0o700}


def test_an_error_of_a_worker_is_told_as_it_is(tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match=r"set cannot be written; found No such file or directory"):
        make_dataset(tmp_path / "set", PLAN, workers=2, make=Cheap(tmp_path / "missing" / "log"))
    assert not (tmp_path / "set").exists()


def test_no_scheduler_and_a_worker_that_does_not_see_the_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("endoct.workbench.running.cluster.CONNECT_S", 0.3)
    with (
        pytest.raises(EndoctError, match=r"no scheduler answers at tcp://127\.0\.0\.1:9"),
        existing_cluster("tcp://127.0.0.1:9"),
    ):
        pass
    with (
        pytest.raises(EndoctError, match=r"tls://127\.0\.0\.1:9 cannot be reached without credentials"),
        existing_cluster("tls://127.0.0.1:9"),
    ):
        pass
    with pytest.raises(EndoctError, match="does not see"):
        check_worker(tmp_path / "set")
    with pytest.raises(EndoctError, match="exclude"):
        make_dataset(tmp_path / "set", PLAN, workers=2, scheduler="tcp://127.0.0.1:9")


def test_a_shard_takes_over_what_an_older_one_holds(tmp_path: Path) -> None:
    members = {"a.txt": b"one", "b.npy": bytes(600)}
    with tarfile.open(tmp_path / "old.tar", "w") as old:
        for name, data in members.items():
            add_member(old, name, data)
    with tarfile.open(tmp_path / "new.tar", "w") as new:
        copy_specimens(tmp_path / "old.tar", new)
        add_member(new, "c.txt", b"two")
    with tarfile.open(tmp_path / "new.tar") as made:
        files = {member.name: made.extractfile(member) for member in made}
        assert {name: file.read() for name, file in files.items() if file} == {**members, "c.txt": b"two"}
