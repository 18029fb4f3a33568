"""`endoct serve`: the page of one folder, or a table of what lies in it, until it is interrupted."""

import socket
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from endoct.stitching.errors import EndoctError
from endoct.workbench.page.opening import can_be_shown, open_shown

if TYPE_CHECKING:
    from starlette.applications import Starlette

USUAL_PORT = 8765


def serve(folder: Path, host: str, port: int | None, announce: Callable[[str], None]) -> None:
    """Serve the page of ``folder`` on ``host`` until interrupted; ``announce`` is told its address.

    Without a ``port`` it is the usual one, or where that is taken any that is free. Raises :class:`EndoctError` where
    the folder cannot be shown, or the port cannot be had.
    """
    import uvicorn

    serves = page_or_table(folder)
    with listening_socket(host, port) as listening:
        chosen = listening.getsockname()[1]
        announce(f"http://{f'[{host}]' if ':' in host else host}:{chosen}/")
        settings = uvicorn.Config(serves(host, chosen), log_level="warning", access_log=False, server_header=False)
        with suppress(KeyboardInterrupt):  # how it is meant to end
            uvicorn.Server(settings).run(sockets=[listening])


def page_or_table(folder: Path) -> Callable[[str, int], "Starlette"]:
    """Return what makes the application for a host and a port: of one page, or of a table of many.

    Raises :class:`EndoctError` where there is nothing to show.
    """
    from endoct.workbench.page.collection_server import Collection, collection_app
    from endoct.workbench.page.server import app_for

    if can_be_shown(folder):
        shown = open_shown(folder)
        return lambda host, port: app_for(shown, host, port)
    collection = Collection(folder)
    return lambda host, port: collection_app(collection, host, port)


def listening_socket(host: str, port: int | None) -> socket.socket:
    """Return a socket that listens on ``host`` and ``port``, 0 for any that is free, None for the usual one if that is.

    Raises :class:`EndoctError` where there is none, or ``host`` stands for every address.
    """
    if host in ("", "0.0.0.0", "::"):
        # the server answers to its own names alone, and cannot know by which of them it will be called
        raise EndoctError(
            "the page cannot listen on every address",
            found=host or "no address",
            expected="one address of this machine",
        )
    tried = [USUAL_PORT, 0] if port is None else [port]
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    for one in tried:
        listening = socket.socket(family, socket.SOCK_STREAM)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind((host, one))
            listening.listen()
        except (OSError, OverflowError) as error:
            listening.close()
            if one == tried[-1]:
                raise EndoctError(
                    f"no server can listen on {host}, port {one}",
                    found=getattr(error, "strerror", None) or str(error),
                    remedy="say another --port or --host",
                ) from error
        else:
            return listening
    raise AssertionError  # the last port was refused above
