"""A cluster of this command alone: its parts speak with one another only, by credentials that nobody else has."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from distributed import Client, Nanny, Scheduler, SpecCluster, Worker
from distributed.security import Security
from distributed.system import MEMORY_LIMIT

HOST = "127.0.0.1"
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
def private_cluster(workers: int, scratch: str) -> Iterator[Client]:
    """Yield the client of ``workers`` processes with one thread each, which end with this one.

    Loopback alone would not keep others out: who may connect may run code, and everybody on this machine can reach
    its ports. So both ends of each connection show a certificate made for this cluster; its key stays in memory (and
    for a moment in a file that its owner alone can read, since OpenSSL loads keys from files).
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
