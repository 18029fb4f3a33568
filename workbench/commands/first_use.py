"""The command that compiles what is slow, before it is needed."""

from pathlib import Path
from tempfile import TemporaryDirectory

from endoct.base.errors import EndoctError
from endoct.workbench.commands.console import command_stages, print_line
from endoct.workbench.running.refusals import DONE


def warm_up() -> int:
    """Compile what is slow, so that no later command has to: half a minute, once after an installation or an update.

    Simulates a small specimen in a temporary folder and compares its recordings. The machine code is kept next to the
    modules or, where nothing can be written there, in your cache folder; NUMBA_CACHE_DIR names another.
    """
    from endoct.base.compute.compiled import is_kept  # loads numba

    if not is_kept():
        raise EndoctError(
            "machine code cannot be kept",
            expected="a folder that can be written: that of the modules, or your cache folder",
            remedy="name one in NUMBA_CACHE_DIR, here and whenever endoct is used",
        )
    from endoct.workbench.api import demo  # loads what a comparison needs

    with TemporaryDirectory() as folder:
        demo(Path(folder) / "demo", preset="learning", progress=command_stages(False))
    print_line("compiled")
    return DONE
