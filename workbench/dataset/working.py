"""Gets units made: in this process, by processes of its own, or by a cluster that is there already."""

import logging
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from endoct.stitching.errors import EndoctError, refusing
from endoct.stitching.scratch import TemporaryFolder
from endoct.workbench.dataset.identity import check_worker
from endoct.workbench.dataset.making import Done, Make, make_unit
from endoct.workbench.dataset.plan import Plan, Unit

if TYPE_CHECKING:
    from distributed import Client, Future

AHEAD = 1  # units that every thread of the cluster has waiting, so that none runs dry
DEATHS = 5  # workers that may die holding a unit before that unit is thought to be at fault
POLL_S = 5.0
LONELY_S = 60.0
CONNECT_S = 20.0
# dask by itself has workers give memory back at once; fetching it anew for every array takes twice the processor's time
WORKER_ENVIRONMENT = {"OMP_NUM_THREADS": 1, "OPENBLAS_NUM_THREADS": 1, "MKL_NUM_THREADS": 1}
AGAIN = "start again with the same arguments; what is finished is kept"


def make_here(root: Path, plan: Plan, wanted: Iterable[Unit], make: Make) -> Iterator[Done]:
    """Make the units one after the other in this process."""
    for unit in wanted:
        yield make_unit(root, plan, unit, make)


def make_on(client: "Client", root: Path, plan: Plan, wanted: Iterable[Unit], make: Make) -> Iterator[Done]:
    """Have the client's workers make the units, few at a time; yield them as they are done.

    A unit whose worker dies goes to another. Raises :class:`EndoctError` where a unit cannot be made, keeps
    killing its workers, or the cluster is lost.
    """
    from distributed import KilledWorker, wait

    left = iter(wanted)
    running: set[Future[Done]] = set()
    last_seen = time.monotonic()
    try:
        while True:
            threads = sum(client.nthreads().values())  # a cluster may grow and shrink
            for unit in islice(left, max(0, (1 + AHEAD) * threads - len(running))):
                running.add(client.submit(_make_on_worker, root, plan, unit, make, pure=False))
            if threads:
                last_seen = time.monotonic()
                if not running:
                    return
            elif time.monotonic() - last_seen > LONELY_S:
                raise EndoctError("the cluster has no worker left", remedy=AGAIN)
            if not running:
                time.sleep(POLL_S)
                continue
            try:
                done, running = wait(running, timeout=POLL_S, return_when="FIRST_COMPLETED")
            except TimeoutError:
                continue
            for future in done:
                yield future.result()
    except KilledWorker as error:
        raise EndoctError(
            "a specimen or shard cannot be made",
            found="one worker after the other died at it",
            remedy=f"see whether memory is short; {AGAIN}",
        ) from error
    except (CancelledError, OSError) as error:
        raise EndoctError("the cluster was lost", found=str(error)[:200], remedy=AGAIN) from error
    finally:
        with suppress(CancelledError, OSError):
            client.cancel(list(running))


@contextmanager
def own_cluster(workers: int) -> Iterator["Client"]:
    """Yield the client of ``workers`` processes with one thread each, which end with this one and obey it alone."""
    import dask

    from endoct.workbench.running.cluster import private_cluster

    with (
        TemporaryFolder("workers") as scratch,
        dask.config.set(
            {
                "distributed.scheduler.allowed-failures": DEATHS,
                "distributed.nanny.pre-spawn-environ": WORKER_ENVIRONMENT,
            }
        ),
        private_cluster(workers, scratch) as client,
    ):
        yield client


@contextmanager
def existing_cluster(address: str) -> Iterator["Client"]:
    """Yield the client of the scheduler at ``address``.

    Who answers there is trusted: what it sends is unpickled here, which may run anything. Raises :class:`EndoctError`
    where there is none, or it has no worker.
    """
    from distributed import Client
    from distributed.security import Security

    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    with refusing(
        f"no scheduler answers at {address}",
        expected="an address as tcp://host:8786 or tls://host:8786",
        remedy="start one with `dask scheduler`, or leave --scheduler out",
    ):
        security = Security()
        told = security.get_tls_config_for_role("client")
        if address.startswith("tls://") and not (told["ca_file"] and told["cert"]):
            raise EndoctError(
                f"{address} cannot be reached without credentials",
                expected="distributed.comm.tls in Dask's configuration",
                remedy="see docs/datasets.md",
            )
        client = Client(address, security=security, timeout=CONNECT_S)
    with client:
        try:
            client.wait_for_workers(1, timeout=CONNECT_S)
        except TimeoutError as error:
            raise EndoctError(
                f"the scheduler at {address} has no worker", remedy=f"start one with `dask worker {address}`"
            ) from error
        yield client


def _make_on_worker(root: Path, plan: Plan, unit: Unit, make: Make) -> Done:
    check_worker(root)
    return make_unit(root, plan, unit, make)
