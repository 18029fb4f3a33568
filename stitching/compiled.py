"""Loops over samples as machine code, made by numba: for steps that would take many passes over an array."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Compile ``function`` at its first call, to run on one processor without the interpreter's lock.

    The machine code is kept for later processes, beside the module or, where nothing can be written there, in the
    user's cache folder; where that cannot be written either, every process compiles anew. Floating-point operations
    keep the order in which they are written.
    """
    try:
        return cast(Function, njit(nogil=True, error_model="numpy", cache=True)(function))
    except RuntimeError:  # numba found no folder for its cache
        return cast(Function, njit(nogil=True, error_model="numpy")(function))
