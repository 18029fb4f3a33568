"""`endoct serve`: the page of one folder, or a table of what lies in it, until it is interrupted.

The server of a collection has its table, its thumbnails, and the page of each that is opened, under an address of
its own. Addresses are looked up among what was found in the folder: none is made into a path.
"""

import logging
import os
import socket
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from ipaddress import IPv4Address, IPv6Address, ip_address
from pathlib import Path
from types import FrameType
from urllib.parse import parse_qs, quote, unquote_to_bytes

import uvicorn
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, PlainTextResponse, RedirectResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Receive, Scope, Send

from endoct.base.errors import EndoctError
from endoct.base.files.files import path_text
from endoct.workbench.page.collection import (
    PAGES,
    ListedOutput,
    address_of,
    check_no_links,
    collection_html,
    entries_in,
    read_collection,
    thumbnail,
)
from endoct.workbench.page.heading import Link
from endoct.workbench.page.opening import can_be_shown, open_shown
from endoct.workbench.page.presence import NAMED
from endoct.workbench.page.server import (
    ANSWERS_TO_ERRORS,
    MANUAL,
    Guard,
    Page,
    allowed_hosts,
    asset,
    few_threads,
    kept,
    page_app,
    whole_number,
)
from endoct.workbench.page.shown import Shown
from endoct.workbench.page.wall import NoSuchTile

USUAL_PORT = 8765
ANSWERING_S = 1
"""Seconds that requests have to be answered once the server is to end."""
MOST_OPEN = 6
"""Pages that are held open: those that were asked for last."""
MOST_TABLES = 20
"""Tables whose places are remembered: a window may ask for the thumbnails of an older one."""


def serve(folder: Path, host: str, port: int | None, announce: Callable[[str], None]) -> None:
    """Serve the page of ``folder`` on ``host`` until interrupted; ``announce`` is called with its address.

    Without a ``port`` it is the usual one, or where that is taken any that is free. Raises :class:`EndoctError` where
    the folder cannot be shown, or the port cannot be had.
    """
    run_server(page_or_table(folder), host, port, announce)


def run_server(
    serves: Callable[[str, int], Starlette], host: str, port: int | None, announce: Callable[[str], None]
) -> None:
    """Serve the application that ``serves`` makes for a host and a port, until interrupted.

    ``announce`` is called with its address. Raises :class:`EndoctError` where the port cannot be had.
    """
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

        with suppress(KeyboardInterrupt):  # how it is meant to end
            _Server(settings).run(sockets=[listening])


class _Server(uvicorn.Server):
    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """End, quietly: that somebody is not answered is no error now."""
        logging.getLogger("uvicorn.error").setLevel(logging.CRITICAL)
        super().handle_exit(sig, frame)


def page_or_table(folder: Path) -> Callable[[str, int], Starlette]:
    """Return what makes the application for a host and a port: of one page, or of a table of many.

    Raises :class:`EndoctError` where there is nothing to show.
    """
    if can_be_shown(folder):
        shown = open_shown(folder)
        return lambda host, port: page_app(shown, partial(open_shown, folder), host, port)
    collection = Collection(folder, read_collection(folder))
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


class Collection:
    """The ``entries`` that were found in ``folder`` when it was looked into last, and the pages that were opened.

    Pages lie below the address ``pages``, and lead back to ``above``, which ``runs`` commands or does not.
    """

    def __init__(
        self,
        folder: Path,
        entries: tuple[ListedOutput, ...] = (),
        above: str = "/",
        pages: str = PAGES,
        *,
        runs: bool = False,
    ) -> None:
        self.title = folder.resolve().name or str(folder.resolve())
        self.pages = pages
        self._folder, self._above, self._runs = folder, above, runs
        self._entries = entries
        self._tables: OrderedDict[str, tuple[ListedOutput, ...]] = OrderedDict()
        self._pages: OrderedDict[str, ASGIApp] = OrderedDict()
        self._lock = threading.Lock()

    def table(self) -> str:
        """Look into the folder again and return the page of what is there now."""
        entries = read_collection(self._folder)
        return collection_html(self.title, entries, self._remember(entries))

    def ensure_looked(self) -> None:
        """Look into the folder where that was not done yet: a page may be asked for before any table."""
        if not self._tables and not self._entries:
            self.look()

    def look(self) -> tuple[str, tuple[ListedOutput, ...]]:
        """Look into the folder again and return the version of the table, and the entries, of what is there now."""
        entries = entries_in(self._folder)
        return self._remember(entries), entries

    def _remember(self, entries: tuple[ListedOutput, ...]) -> str:
        version = f"{time.time_ns():x}"
        with self._lock:
            self._entries = self._tables[version] = entries
            while len(self._tables) > MOST_TABLES:
                self._tables.popitem(last=False)
        return version

    def entry(self, version: str, number: int) -> ListedOutput:
        """Return an entry by its place in the table of that version, or in the last one where that is forgotten.

        Raises :class:`NoSuchTile` where there is none.
        """
        entries = self._tables.get(version, self._entries)
        if number >= len(entries):
            raise NoSuchTile("there is no such entry", found=str(number))
        return entries[number]

    def named(self, path: str) -> ListedOutput | None:
        """Return the entry to whose page an address belongs; None where there is none."""
        return next((one for one in self._entries if one.can_be_opened and f"{path}/".startswith(f"{one.name}/")), None)

    def called(self, name: object) -> ListedOutput | None:
        """Return the entry of that name, None where there is none."""
        return next((entry for entry in self._entries if entry.name == name), None)

    def page(self, entry: ListedOutput, host: str, port: int) -> ASGIApp:
        """Return the application that serves the page of ``entry``."""

        def opened() -> Shown:
            check_no_links(entry.path)
            return open_shown(entry.path)

        with self._lock:
            page = self._pages.get(entry.name)
        if page is None:  # opened without the lock, which tiles of other pages need meanwhile
            again = f"{self._above}?of={quote(path_text(entry.name))}" if self._runs else ""
            page = Page(opened(), opened, host, port, Link(self._above, self.title, again))
        with self._lock:
            page = self._pages.setdefault(entry.name, page)
            self._pages.move_to_end(entry.name)
            while len(self._pages) > MOST_OPEN:
                self._pages.popitem(last=False)
            return page


async def answer_page(collection: Collection, host: str, port: int, scope: Scope, receive: Receive, send: Send) -> None:
    """Answer a request below the ``pages`` of a collection with the page of the entry that it names."""
    # by the bytes of the address: a name need not be UTF-8, nor a path that routes could match
    path = os.fsdecode(unquote_to_bytes(scope["raw_path"]))[len(collection.pages) :].lstrip("/")
    entry = collection.named(path)
    if entry is None:  # gone, if a page that was open names what it shows
        status = 410 if NAMED in parse_qs(scope["query_string"].decode("latin-1")) else 404
        await PlainTextResponse("there is no such page", status_code=status)(scope, receive, send)
        return
    if path == entry.name:
        await RedirectResponse(address_of(entry, collection.pages))(scope, receive, send)
        return
    try:
        app = await run_in_threadpool(collection.page, entry, host, port)
    except EndoctError as error:
        await PlainTextResponse(str(error), status_code=500)(scope, receive, send)
        return
    within = path.removeprefix(entry.name)
    await app({**scope, "root_path": collection.pages, "path": collection.pages + within}, receive, send)


def collection_app(collection: Collection, host: str, port: int) -> Starlette:
    """Return the application that serves ``collection`` to those who call it by ``host`` and ``port``."""

    def table(_: Request) -> Response:
        return HTMLResponse(collection.table(), headers={"cache-control": "no-store"})

    def picture(request: Request) -> Response:
        place = whole_number(request.path_params["number"])
        return kept(thumbnail(collection.entry(request.path_params["version"], place)), "image/png")

    async def page(scope: Scope, receive: Receive, send: Send) -> None:
        await answer_page(collection, host, port, scope, receive, send)

    return Starlette(
        lifespan=few_threads,
        routes=[
            Route("/", table),
            Route("/thumbnails/{version}/{number}.png", picture),
            MANUAL,
            Route("/{name}", asset),
        ],
        middleware=[Middleware(Guard, hosts=allowed_hosts(host, port)), Middleware(_PagesFirst, page=page)],
        exception_handlers=ANSWERS_TO_ERRORS,
    )


class _PagesFirst:
    """Passes requests below ``PAGES`` to ``page``, and others on."""

    def __init__(self, app: ASGIApp, page: ASGIApp) -> None:
        self._app, self._page = app, page

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        is_page = scope["type"] == "http" and str(scope["path"]).startswith(f"{PAGES}/")
        await (self._page if is_page else self._app)(scope, receive, send)
