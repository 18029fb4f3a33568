"""`endoct serve`: the page of one folder, or a table of what lies in it, until it is interrupted."""

import logging
import socket
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from ipaddress import IPv4Address, IPv6Address, ip_address
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from endoct.stitching.errors import EndoctError
from endoct.workbench.page.opening import can_be_shown, open_shown

if TYPE_CHECKING:
    from starlette.applications import Starlette

USUAL_PORT = 8765
ANSWERING_S = 1
"""What requests have to be answered once the server is to end."""


def serve(folder: Path, host: str, port: int | None, announce: Callable[[str], None]) -> None:
    """Serve the page of ``folder`` on ``host`` until interrupted; ``announce`` is told its address.

    Without a ``port`` it is the usual one, or where that is taken any that is free. Raises :class:`EndoctError` where
    the folder cannot be shown, or the port cannot be had.
    """
    import uvicorn

    serves = page_or_table(folder)
    with listening_socket(host, port) as listening:
        called, chosen = name_in_browsers(host, listening), listening.getsockname()[1]
        announce(f"http://{f'[{called}]' if ':' in called else called}:{chosen}/")
        settings = uvicorn.Config(
            serves(called, chosen),
            log_level="warning",
            access_log=False,
            server_header=False,
            timeout_graceful_shutdown=ANSWERING_S,
        )

        class Server(uvicorn.Server):
            def handle_exit(self, sig: int, frame: FrameType | None) -> None:
                logging.getLogger("uvicorn.error").setLevel(logging.CRITICAL)  # who is not answered is no error now
                super().handle_exit(sig, frame)

        with suppress(KeyboardInterrupt):  # how it is meant to end
            Server(settings).run(sockets=[listening])


def page_or_table(folder: Path) -> Callable[[str, int], "Starlette"]:
    """Return what makes the application for a host and a port: of one page, or of a table of many.

    Raises :class:`EndoctError` where there is nothing to show.
    """
    from endoct.workbench.page.collection_server import Collection, collection_app
    from endoct.workbench.page.server import page_app

    if can_be_shown(folder):
        shown = open_shown(folder)
        return lambda host, port: page_app(shown, partial(open_shown, folder), host, port)
    collection = Collection(folder)
    return lambda host, port: collection_app(collection, host, port)


def listening_socket(host: str, port: int | None) -> socket.socket:
    """Return a socket that listens on ``host`` and ``port``, 0 for any that is free, None for the usual one if that is.

    Raises :class:`EndoctError` where there is none, or ``host`` stands for every address, in whatever notation.
    """
    tried = [USUAL_PORT, 0] if port is None else [port]
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    for one in tried:
        listening = socket.socket(family, socket.SOCK_STREAM)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind((host, one))
            if _bound_address(listening).is_unspecified:
                # the server answers to its own names alone, and cannot know by which of them it will be called
                raise EndoctError(
                    "the page cannot listen on every address",
                    found=host or "no address",
                    expected="one address of this machine",
                )
            listening.listen()
        except EndoctError:
            listening.close()
            raise
        except (OSError, OverflowError, TypeError, ValueError) as error:  # the last two: no name of a machine
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


def name_in_browsers(host: str, listening: socket.socket) -> str:
    """Return how browsers call the server: ``host``, or where that is a number the bound address as they write it."""
    try:
        socket.getaddrinfo(host, None, flags=socket.AI_NUMERICHOST)
    except (OSError, TypeError, ValueError):  # a name
        return host
    return str(_bound_address(listening))


def _bound_address(listening: socket.socket) -> IPv4Address | IPv6Address:
    """Return the address that a socket is bound to; of an IPv4 address in the notation of IPv6, that itself."""
    address = ip_address(listening.getsockname()[0])
    return getattr(address, "ipv4_mapped", None) or address
