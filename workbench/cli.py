"""The entry point of the command line: exit statuses, and one line for every error."""

import os
import select
import sys
from contextlib import suppress
from functools import partial
from io import TextIOWrapper
from threading import Event

from endoct.base.compute.own_process import settle_in
from endoct.base.errors import visible
from endoct.workbench.running.interruption import ending_in_time, watch
from endoct.workbench.running.refusals import DONE, INTERRUPTED, UNUSABLE_INPUT, in_one_line, tame_libraries

INTERRUPTION = "interrupted; nothing was left half-written"


def main() -> None:
    """Run `endoct`: exit status 0 done, 1 unusable input, 2 wrong usage, 3 not aligned, 130 interrupted."""
    watch()
    _open_what_is_closed()
    settle_in()
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # a terminal may lack letters, as those of a file's name
    said = Event()
    with ending_in_time(partial(_end_interrupted, said)):
        _run_and_exit(said)


def open_workbench() -> None:
    """Run `endoct open`, as a double click on ``endoct-workbench`` does: without a console, where systems have some."""
    sys.argv[1:] = ["open"]
    main()


def _run_and_exit(said: Event) -> None:
    """Run the command; whatever is raised, exit with its status. Where it was interrupted, that is ``said``."""
    try:
        try:
            sys.exit(_run())
        finally:
            sys.stdout.flush()  # a failure is reported below, not by Python as it ends
    except KeyboardInterrupt as stopped:
        said.set()
        _print_error(f"{INTERRUPTION}; {stopped}" if str(stopped) else INTERRUPTION)
        sys.exit(INTERRUPTED)
    except BrokenPipeError:
        # the reader of our output went away (`endoct … | head`)
        _drop_output()
        sys.exit(DONE)
    except OSError as error:
        _print_error(f"the output could not be printed; found {error.strerror or error}")
        _drop_output()
        sys.exit(UNUSABLE_INPUT)


def _run() -> int:
    # imported here, inside the handlers above, because the imports take a moment that a user may interrupt
    if sys.argv[1:] == ["--version"]:
        from endoct.workbench import __version__

        print(f"endoct {__version__}")  # noqa: T201
        return DONE
    try:
        from endoct.workbench.commands import run

        tame_libraries()
        return run(sys.argv[1:])
    except BrokenPipeError:
        raise
    except Exception as error:
        line = in_one_line(error)
        if line is None:  # our fault: its traceback is needed to fix it
            raise
        _print_error(line)
        return UNUSABLE_INPUT


def _open_what_is_closed() -> None:
    """Open nothing in place of an input or output that was closed: the next file would take its place, as stderr."""
    for number, mode in ((0, "r"), (1, "w"), (2, "w")):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # takes the lowest number that is free
            name = ("stdin", "stdout", "stderr")[number]
            if getattr(sys, name) is None:
                setattr(sys, name, open(number, mode, encoding="utf-8", closefd=False))  # noqa: SIM115


def _end_interrupted(said: Event) -> None:
    """End this process as it is, which has not ended by itself; say so where that can be done without waiting."""
    with suppress(OSError, ValueError):
        if not said.is_set() and select.select([], [sys.stderr], [], 0)[1]:
            _print_error(INTERRUPTION)
    os._exit(INTERRUPTED)


def _print_error(line: str) -> None:
    print(f"endoct: {visible(line)}", file=sys.stderr)  # noqa: T201


def _drop_output() -> None:
    """Discard what is still to be printed, so that Python does not try again as it ends."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())


if __name__ == "__main__":
    main()
