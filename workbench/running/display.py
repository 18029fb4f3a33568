"""Where a Python function displays its progress: in a notebook, on a terminal, or nowhere."""

import sys

from rich.console import Console

from endoct.workbench.running.notebook import NotebookStages
from endoct.workbench.running.progress import ConsoleStages, SilentStages, Stages

QUIET_S = 2.0
"""Work that takes no longer shows no progress in Python."""


def stages_for(progress: bool | Stages) -> Stages:
    """Return what a Python function that was called with ``progress`` reports its stages to.

    ``True`` displays work that takes longer than :data:`QUIET_S`, in a notebook or on a terminal; ``False`` nothing.
    """
    if not isinstance(progress, bool):
        return progress
    if progress and in_notebook():
        return NotebookStages(QUIET_S)
    console = Console(stderr=True)
    return ConsoleStages(console, QUIET_S) if progress and console.is_terminal else SilentStages()


def in_notebook() -> bool:
    """Say whether this is the kernel of a notebook."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return type(shell).__name__ == "ZMQInteractiveShell"
