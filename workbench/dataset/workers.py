"""Has units made: in this process, or by the workers of a cluster."""

import time
from collections.abc import Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from endoct.stitching.errors import EndoctError
from endoct.workbench.dataset.identity import check_identity, check_worker, remove_abandoned
from endoct.workbench.dataset.making import Done, Make, make_unit
from endoct.workbench.dataset.plan import Job, Plan, Unit

if TYPE_CHECKING:
    from distributed import Client, Future

AHEAD = 1  # units that every thread of the cluster has waiting, so that none runs dry
POLL_S = 5.0
LONELY_S = 60.0
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


def _make_on_worker(root: Path, plan: Plan, unit: Unit, make: Make) -> Done:
    """Make ``unit``; put it only into the set that it was made for, which may be gone by then, or another."""

    def make_and_look(folder: Path, of: Plan, job: Job) -> None:
        make(folder, of, job)
        check_worker(root)
        check_identity(root, of)

    check_worker(root)
    try:
        return make_unit(root, plan, unit, make_and_look)
    except EndoctError:
        remove_abandoned(root)
        raise
