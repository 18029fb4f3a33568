"""Data sets of simulated specimens: making them with many processes, and reading them.

``from endoct.workbench.dataset import Specimens`` reads one. The names load on first use, so that a program that
only reads a set does not load what makes it.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from endoct.workbench.dataset.creation import make_dataset
    from endoct.workbench.dataset.loader import Specimens
    from endoct.workbench.dataset.plan import DatasetPlan

__all__ = ["DatasetPlan", "Specimens", "make_dataset"]

_MODULES = {
    "DatasetPlan": "endoct.workbench.dataset.plan",
    "Specimens": "endoct.workbench.dataset.loader",
    "make_dataset": "endoct.workbench.dataset.creation",
}


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return getattr(import_module(_MODULES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
