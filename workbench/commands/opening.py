"""The command that opens a folder on a page from which every other command can be run."""

import webbrowser
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from threading import Thread
from typing import Annotated, Any

from tyro.conf import Positional

from endoct.workbench.commands.comparisons import Compare, Summarise
from endoct.workbench.commands.console import print_begun, print_line
from endoct.workbench.commands.poses import Pose
from endoct.workbench.commands.recordings import Calibrate, Unroll
from endoct.workbench.commands.simulations import Simulate, demo
from endoct.workbench.requests import UNSET
from endoct.workbench.running.refusals import DONE

ON_THE_PAGE: Mapping[str, Callable[..., Any]] = {
    "unroll": Unroll,
    "compare": Compare,
    "pose": Pose,
    "calibrate": Calibrate,
    "simulate": Simulate,
    "demo": demo,
    "summarise": Summarise,
}


def open_folder(
    folder: Positional[Annotated[Path | None, UNSET]] = None,
    host: str = "127.0.0.1",
    port: Annotated[int | None, UNSET] = None,
    no_browser: bool = False,
) -> int:
    """Open a folder of recordings on a page in the browser: see, describe, unroll, compare. Ctrl+C or its Quit ends it.

    Runs that are under way go on without it, and those that wait go on with the next `endoct open`.

    Args:
        folder: folder with recordings; default: a start page from which one is opened
        host: address to listen on; others than this machine reach it only where this is another than 127.0.0.1
        port: port to listen on; else 8765, or where that is taken any that is free
        no_browser: print the address, and start no browser
    """
    print_begun(f"opening {folder or 'a start page'}; the address follows")  # what is imported next takes seconds
    from endoct.workbench.desk.desk import Desk
    from endoct.workbench.desk.desk_app import desk_app
    from endoct.workbench.desk.state import State
    from endoct.workbench.page.serving import run_server

    state = State()
    if folder is None and port is None and (running := state.running()):  # a second double click
        print_line(f"{running} is open already")
        if not no_browser:
            webbrowser.open(state.address_file(running).as_uri())
        return DONE
    desk = Desk(state, ON_THE_PAGE)
    path = f"{desk.root}/" if folder is None else desk.open(folder).address

    def announce(server: str) -> None:
        address = server.rstrip("/") + path
        opened = state.address_file(address)
        print_line(f"{address} shows {folder or 'where to begin'}; Ctrl+C ends it")
        if not no_browser:
            # some browsers are waited for until they end, and wait for the server meanwhile
            Thread(target=webbrowser.open, args=(opened.as_uri(),), daemon=True).start()

    run_server(partial(desk_app, desk), host, port, announce)
    runs = [run.state for run in desk.state.queue.runs()]
    if n_open := runs.count("running") + runs.count("waiting"):
        print_line(f"{runs.count('running')} of {n_open} runs go on; the others go on with the next `endoct open`")
    return DONE
