"""Clusters of worker processes: one of this command alone, or one that exists already.

The parts of a command's own cluster talk to one another only, by credentials that are made for it.
"""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import dask
from distributed import Client, Nanny, Scheduler, SpecCluster, Worker
from distributed.security import Security
from distributed.system import MEMORY_LIMIT

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.scratch import TemporaryFolder

HOST = "127.0.0.1"
DEATHS = 5
"""Workers that may die holding a piece of work before that piece is thought to be at fault."""
CONNECT_S = 20.0
CLOSE_S = 1.0
# dask by itself has workers give memory back at once; fetching it anew for every array takes twice the processor's time
WORKER_ENVIRONMENT = {"OMP_NUM_THREADS": 1, "OPENBLAS_NUM_THREADS": 1, "MKL_NUM_THREADS": 1}
# a terminal sends Ctrl-C to every process it has; workers end with their cluster, without a traceback each
LEAVE_INTERRUPTS_TO_THE_COMMAND = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"


class SchedulerWithoutPages(Scheduler):
    """A scheduler that serves no pages: dask would, without encryption, to everybody on this machine."""

    def start_http_server(self, *_: Any, **__: Any) -> None:
        """Leave it out; there is no option that does."""


class WorkerWithoutPages(Worker):
    """A worker that serves no pages."""

    def start_http_server(self, *_: Any, **__: Any) -> None:
        """Leave it out; there is no option that does."""


@contextmanager
def own_cluster(workers: int) -> Iterator[Client]:
    """Yield the client of ``workers`` processes with one thread each, which end with this one and obey it alone."""
    with (
        TemporaryFolder("workers") as scratch,
        dask.config.set(
            {
                "distributed.scheduler.allowed-failures": DEATHS,
                "distributed.nanny.pre-spawn-environ": WORKER_ENVIRONMENT,
            }
        ),
        _private_cluster(workers, scratch) as client,
    ):
        yield client


@contextmanager
def existing_cluster(address: str) -> Iterator[Client]:
    """Yield the client of the scheduler at ``address``.

    Who answers there is trusted: what it sends is unpickled here, which may run anything. Raises :class:`EndoctError`
    where there is none, or it has no worker.
    """
    _quieten()
    with refusing(
        f"no scheduler answers at {address}",
        expected="an address as tcp://host:8786 or tls://host:8786",
        remedy="start one with `dask scheduler`, or leave --scheduler out",
    ):
        security = Security()
        credentials = security.get_tls_config_for_role("client")
        if address.startswith("tls://") and not (credentials["ca_file"] and credentials["cert"]):
            raise EndoctError(
                f"{address} cannot be reached without credentials",
                expected="distributed.comm.tls in Dask's configuration",
                remedy="see docs/how-to/datasets.md",
            )
        client = Client(address, security=security, timeout=CONNECT_S)
    with _closed_in_the_end(client):
        try:
            client.wait_for_workers(1, timeout=CONNECT_S)
        except TimeoutError as error:
            raise EndoctError(
                f"the scheduler at {address} has no worker", remedy=f"start one with `dask worker {address}`"
            ) from error
        yield client


def _quieten() -> None:
    """Have Dask log nothing: what it would say, traces among it, comes as an error too."""
    for name in list(logging.root.manager.loggerDict):
        if name.split(".")[0] == "distributed":  # some have a level of their own
            logging.getLogger(name).setLevel(logging.CRITICAL)


@contextmanager
def _closed_in_the_end(client: Client) -> Iterator[None]:
    """Close ``client`` in the end, without waiting long for a scheduler that does not answer any more."""
    try:
        yield
    finally:
        client.close(timeout=CLOSE_S)


@contextmanager
def _private_cluster(workers: int, scratch: str) -> Iterator[Client]:
    """Yield the client of ``workers`` processes with one thread each, which end with this one.

    Loopback alone would not keep others out: who may connect may run code, and everybody on this machine can reach
    its ports. So both ends of each connection show a certificate made for this cluster. Its key stays in memory. For a
    moment it is also in a file that its owner alone can read, since OpenSSL loads keys from files.
    """
    security = Security.temporary()
    common = {"host": HOST, "protocol": "tls://", "security": security}
    worker = {
        "cls": Nanny,
        "options": {
            **common,
            "nthreads": 1,
            "memory_limit": MEMORY_LIMIT // workers,
            "worker_class": WorkerWithoutPages,
            "local_directory": scratch,
            "silence_logs": logging.CRITICAL,
            "preload": [LEAVE_INTERRUPTS_TO_THE_COMMAND],
        },
    }
    scheduler = {"cls": SchedulerWithoutPages, "options": {**common, "port": 0, "dashboard": False}}
    with (
        SpecCluster(
            scheduler=scheduler,
            workers=dict.fromkeys(range(workers), worker),
            security=security,
            silence_logs=logging.CRITICAL,
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client
