"""Two recordings unrolled at the same time: one in this process, the other one in a worker process."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

from endoct.stitching.worker_process import Send, WorkerProcess
from endoct.workbench.pipeline.unrolling import Opened, Unrolled, unroll_recording
from endoct.workbench.running.progress import Advance, SilentStages, Stages
from endoct.workbench.running.threads import one_blas_thread


def unroll_both(
    a: Opened, b: Opened, stages: Stages, process: WorkerProcess | None, meanwhile: Callable[[], None] = lambda: None
) -> tuple[Unrolled, Unrolled]:
    """Unroll two recordings, B in ``process`` where there is one; the panoramas are the same either way.

    ``meanwhile`` is called once A is unrolled, where B may not be yet. Raises what :func:`unroll_recording` raises, of
    A where both fail.
    """
    if process is None:
        return unroll_recording(a, stages, "A"), unroll_recording(b, stages, "B")
    with ExitStack() as open_stages:
        unrolled_b = process.call(_unroll_there, b, "B", on_message=_ReceivedStages(stages, open_stages))
        unrolled_a = unroll_recording(a, stages, "A")
        meanwhile()
        return unrolled_a, unrolled_b.result()


def _unroll_there(send: Send, opened: Opened, label: str) -> Unrolled:
    opened.manifest.load(opened.device)  # first, so that the libraries it brings keep to one thread as well
    with one_blas_thread():
        return unroll_recording(opened, _SentStages(send), label)


class _SentStages(SilentStages):
    """Sends which stage begins (its title), how much of it is done (a share), and that it ends (None)."""

    def __init__(self, send: Send) -> None:
        super().__init__()
        self._send = send

    @contextmanager
    def _displayed(self, title: str) -> Iterator[Advance]:
        self._send(title)
        yield self._send
        self._send(None)


class _ReceivedStages:
    """Opens the stages of :class:`_SentStages` among ``stages``; one that is open ends with ``open_stages``."""

    def __init__(self, stages: Stages, open_stages: ExitStack) -> None:
        self._stages, self._open_stages = stages, open_stages

    def __call__(self, message: object) -> None:
        if isinstance(message, str):
            self._advance = self._open_stages.enter_context(self._stages.stage(message))
        elif isinstance(message, float):
            self._advance(message)
        else:
            self._open_stages.close()
