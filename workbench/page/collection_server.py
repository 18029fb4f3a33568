"""The server of a collection: its table, thumbnails, and the page of each that is opened, under an address of its own.

Addresses are looked up among what was found in the folder: none is made into a path.
"""

import os
import threading
import time
from collections import OrderedDict
from pathlib import Path
from urllib.parse import parse_qs, unquote_to_bytes

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, PlainTextResponse, RedirectResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Receive, Scope, Send

from endoct.stitching.errors import EndoctError
from endoct.workbench.page.collection import Entry, check_no_links, read_collection
from endoct.workbench.page.collection_page import PAGES, address_of, collection_html
from endoct.workbench.page.guard import Guard, allowed_hosts
from endoct.workbench.page.opening import open_shown
from endoct.workbench.page.presence import NAMED
from endoct.workbench.page.server import (
    ANSWERS_TO_ERRORS,
    KEPT,
    Page,
    asset,
    few_threads,
    whole_number,
)
from endoct.workbench.page.shown import Shown
from endoct.workbench.page.thumbnails import thumbnail
from endoct.workbench.page.wall import NoSuchTile

MOST_OPEN = 6
"""Pages that are held open, those that were looked at last."""
MOST_TABLES = 20
"""Tables whose places are remembered: a window may ask for the thumbnails of an older one."""


class Collection:
    """What was found in ``folder`` when its table was asked for last, and the pages that were opened.

    Raises :class:`EndoctError` where there is nothing to show.
    """

    def __init__(self, folder: Path) -> None:
        self.title = folder.resolve().name or str(folder.resolve())
        self._folder = folder
        self._entries = read_collection(folder)
        self._tables: OrderedDict[str, tuple[Entry, ...]] = OrderedDict()
        self._pages: OrderedDict[str, ASGIApp] = OrderedDict()
        self._lock = threading.Lock()

    def table(self) -> str:
        """Look into the folder again and return the page of what is there now."""
        entries, version = read_collection(self._folder), f"{time.time_ns():x}"
        with self._lock:
            self._entries = self._tables[version] = entries
            while len(self._tables) > MOST_TABLES:
                self._tables.popitem(last=False)
        return collection_html(self.title, entries, version)

    def entry(self, version: str, number: int) -> Entry:
        """Return an entry by its place in the table of that version, or in the last one where that is forgotten.

        Raises :class:`NoSuchTile` where there is none.
        """
        entries = self._tables.get(version, self._entries)
        if number >= len(entries):
            raise NoSuchTile("there is no such entry", found=str(number))
        return entries[number]

    def named(self, path: str) -> Entry | None:
        """Return the entry to whose page an address belongs; None where there is none."""
        return next((one for one in self._entries if one.can_be_opened and f"{path}/".startswith(f"{one.name}/")), None)

    def page(self, entry: Entry, host: str, port: int) -> ASGIApp:
        """Return the application that serves the page of ``entry``."""

        def opened() -> Shown:
            check_no_links(entry.path)
            return open_shown(entry.path)

        with self._lock:
            if entry.name not in self._pages:
                self._pages[entry.name] = Page(opened(), opened, host, port, ("/", self.title))
                while len(self._pages) > MOST_OPEN:
                    self._pages.popitem(last=False)
            self._pages.move_to_end(entry.name)
            return self._pages[entry.name]


def collection_app(collection: Collection, host: str, port: int) -> Starlette:
    """Return the application that serves ``collection`` to those who call it by ``host`` and ``port``."""

    def table(_: Request) -> Response:
        return HTMLResponse(collection.table(), headers={"cache-control": "no-store"})

    def picture(request: Request) -> Response:
        place = whole_number(request.path_params["number"])
        png = thumbnail(collection.entry(request.path_params["version"], place))
        return Response(png, media_type="image/png", headers={"cache-control": KEPT})

    async def page(scope: Scope, receive: Receive, send: Send) -> None:
        # by the bytes of the address: a name need not be UTF-8, nor a path that routes could match
        path = os.fsdecode(unquote_to_bytes(scope["raw_path"]))[len(PAGES) :].lstrip("/")
        entry = collection.named(path)
        if entry is None:  # gone, if a page that was open names what it shows
            status = 410 if NAMED in parse_qs(scope["query_string"].decode("latin-1")) else 404
            await PlainTextResponse("there is no such page", status_code=status)(scope, receive, send)
            return
        if path == entry.name:
            await RedirectResponse(address_of(entry))(scope, receive, send)
            return
        try:
            app = await run_in_threadpool(collection.page, entry, host, port)
        except EndoctError as error:
            await PlainTextResponse(str(error), status_code=500)(scope, receive, send)
            return
        within = path.removeprefix(entry.name)
        await app({**scope, "root_path": PAGES, "path": PAGES + within}, receive, send)

    return Starlette(
        lifespan=few_threads,
        routes=[
            Route("/", table),
            Route("/thumbnails/{version}/{number}.png", picture),
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
        """Pass a request on."""
        is_page = scope["type"] == "http" and str(scope["path"]).startswith(f"{PAGES}/")
        await (self._page if is_page else self._app)(scope, receive, send)
