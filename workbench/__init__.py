"""The public Python interface, the command line, the pipeline and the report.

``from endoct.workbench import unroll, compare, simulate, summarise, verify``; they load on first use, so that the
command line starts at once.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from endoct.workbench.api import compare, summarise, unroll
    from endoct.workbench.pipeline.simulating import simulate
    from endoct.workbench.verifying import verify

__all__ = ["compare", "simulate", "summarise", "unroll", "verify"]

_MODULES = {"simulate": "pipeline.simulating", "verify": "verifying"}


def __getattr__(name: str) -> Any:
    if name in __all__:
        return getattr(import_module(f"endoct.workbench.{_MODULES.get(name, 'api')}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
