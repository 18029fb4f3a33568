"""Loops over samples as machine code, made by numba: for steps that would take many passes over an array."""

from collections.abc import Callable
from contextlib import suppress
from typing import Any, TypeVar, cast

from endoct.base.compute.own_process import count_compiled
from endoct.base.errors import refusing

with refusing("numba cannot be loaded", remedy="see what NUMBA_… says in the environment"):
    from numba import njit
    from numba.core.caching import FunctionCache

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Compile ``function`` at its first call, to run on one processor without the interpreter's lock.

    That takes a tenth of a second to one for each combination of types: those of elements, of dimensions, and of order
    in memory. Where a few lines do, write them: NumPy's ``sort``, ``median``, ``max`` and assignments of arrays to
    arrays bring in much that is compiled as well.

    The machine code is kept for later processes, next to the module or, where nothing can be written there, in the
    user's cache folder. Where that is full or cannot be written either, every process compiles anew. Damaged code is
    made again. Floating-point operations keep the order in which they are written.
    """
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}  # no C calls it
    dispatcher: Any = njit(**options)(function)
    with suppress(RuntimeError):  # numba found no folder for its cache
        dispatcher._cache = _KeptCode(function)  # type: ignore[no-untyped-call]  # as its enable_caching does
    return cast(Function, dispatcher)


def is_kept() -> bool:
    """Say whether machine code can be kept for later processes."""
    try:
        _KeptCode(is_kept)  # type: ignore[no-untyped-call]
    except RuntimeError:
        return False
    return True


class _KeptCode(FunctionCache):
    """Numba's cache of one function, without which everything works as well."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the code kept for a signature, or None where there is no complete one."""
        try:
            return super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        except Exception:  # noqa: BLE001 - damaged bytes may raise anything as they are unpickled
            with suppress(Exception):
                self.flush()  # type: ignore[no-untyped-call]  # or what is saved now would be added to what cannot be read
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the code for a signature, if there is room."""
        count_compiled()
        with suppress(Exception):
            super().save_overload(sig, data)  # type: ignore[no-untyped-call]
