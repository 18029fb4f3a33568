"""Recordings unrolled at once: one in this process, the other in a process beside it."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from endoct.workbench.pipeline.unrolling import Opened, Unrolled, unroll_recording
from endoct.workbench.running.progress import Advance, SilentStages, Stages
from endoct.workbench.running.threads import one_blas_thread
from endoct.workbench.running.worker import Beside, Tell


def unroll_both(a: Opened, b: Opened, stages: Stages, beside: Beside | None) -> tuple[Unrolled, Unrolled]:
    """Unroll two recordings, B in the process ``beside`` where there is one; what comes out is the same.

    Raises what :func:`unroll_recording` raises, of A where both fail.
    """
    if beside is None:
        return unroll_recording(a, stages, "A"), unroll_recording(b, stages, "B")
    with ExitStack() as shown:
        unrolled_b = beside.call(_unroll_there, b, "B", heard=_Shown(stages, shown))
        unrolled_a = unroll_recording(a, stages, "A")
        return unrolled_a, unrolled_b.result()


def _unroll_there(tell: Tell, opened: Opened, label: str) -> Unrolled:
    opened.manifest.load()  # first, so that the libraries it brings keep to one thread as well
    with one_blas_thread():
        return unroll_recording(opened, _ToldStages(tell), label)


class _ToldStages(SilentStages):
    """Tells another process which stage begins (its title), how much of it is done (a share), and that it ends."""

    def __init__(self, tell: Tell) -> None:
        super().__init__()
        self._tell = tell

    @contextmanager
    def _shown(self, title: str) -> Iterator[Advance]:
        self._tell(title)
        yield self._tell
        self._tell(None)


class _Shown:
    """Hears :class:`_ToldStages` and shows them among one's own ``stages``; an open one ends with ``shown``."""

    def __init__(self, stages: Stages, shown: ExitStack) -> None:
        self._stages, self._shown = stages, shown

    def __call__(self, told: object) -> None:
        if isinstance(told, str):
            self._advance = self._shown.enter_context(self._stages.stage(told))
        elif isinstance(told, float):
            self._advance(told)
        else:
            self._shown.close()
