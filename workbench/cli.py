"""The entry point of the command line: exit statuses, and one line for every error."""

import os
import sys

from endoct.workbench.interruption import watch
from endoct.workbench.status import DONE, INTERRUPTED, UNUSABLE_INPUT


def main() -> None:
    """Run `endoct`: status 0 done, 1 unusable input, 2 wrong usage, 3 not aligned, 130 interrupted."""
    watch()
    try:
        sys.exit(_run())
    except KeyboardInterrupt as stopped:
        kept = f"; {stopped}" if str(stopped) else ""
        print(f"endoct: interrupted; nothing was left half-written{kept}", file=sys.stderr)  # noqa: T201
        sys.exit(INTERRUPTED)
    except BrokenPipeError:
        # the reader of our output went away (`endoct … | head`): nothing to tell it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(DONE)


def _run() -> int:
    # imported here, inside the handlers above, because the imports take a moment that a user may interrupt
    from endoct.stitching.errors import EndoctError
    from endoct.workbench.commands import run

    try:
        return run(sys.argv[1:])
    except EndoctError as error:
        print(f"endoct: {error}", file=sys.stderr)  # noqa: T201
        return UNUSABLE_INPUT
