"""The server of a collection: its table, thumbnails, and the page of each that is opened, under an address of its own.

Addresses are looked up among what was found in the folder: none is made into a path.
"""

import threading
import time
from collections import OrderedDict
from pathlib import Path

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, PlainTextResponse, RedirectResponse, Response
from starlette.routing import Mount, Route
from starlette.types import ASGIApp, Receive, Scope, Send

from endoct.stitching.errors import EndoctError
from endoct.workbench.page.collection import Entry, check_no_links, read_collection
from endoct.workbench.page.collection_page import address_of, collection_html
from endoct.workbench.page.guard import Guard, allowed_hosts
from endoct.workbench.page.opening import open_shown
from endoct.workbench.page.server import (
    KEPT,
    app_for,
    asset,
    failed,
    few_threads,
    not_found,
    whole_number,
)
from endoct.workbench.page.thumbnails import thumbnail
from endoct.workbench.page.wall import NoSuchTile

MOST_OPEN = 6
"""Pages that are held open, those that were looked at last."""


class Collection:
    """What was found in ``folder`` when its table was asked for last, and the pages that were opened.

    Raises :class:`EndoctError` where there is nothing to show.
    """

    def __init__(self, folder: Path) -> None:
        self.title = folder.resolve().name or str(folder.resolve())
        self._folder = folder
        self._entries = read_collection(folder)
        self._pages: OrderedDict[str, ASGIApp] = OrderedDict()
        self._lock = threading.Lock()

    def table(self) -> str:
        """Look into the folder again and return the page of what is there now."""
        self._entries = read_collection(self._folder)
        with self._lock:
            self._pages.clear()  # what was opened may have been made anew
        return collection_html(self.title, self._entries, f"{time.time_ns():x}")

    def entry(self, number: int) -> Entry:
        """Return an entry by its place. Raises :class:`NoSuchTile` where there is none."""
        if number >= len(self._entries):
            raise NoSuchTile("there is no such entry", found=str(number))
        return self._entries[number]

    def named(self, path: str) -> Entry | None:
        """Return the entry to whose page an address belongs; None where there is none."""
        return next((one for one in self._entries if one.can_be_opened and f"{path}/".startswith(f"{one.name}/")), None)

    def page(self, entry: Entry, host: str, port: int) -> ASGIApp:
        """Return the application that serves the page of ``entry``."""
        with self._lock:
            if entry.name not in self._pages:
                check_no_links(entry.path)
                above = "/", self.title
                self._pages[entry.name] = app_for(open_shown(entry.path), host, port, above)
                while len(self._pages) > MOST_OPEN:
                    self._pages.popitem(last=False)
            self._pages.move_to_end(entry.name)
            return self._pages[entry.name]


def collection_app(collection: Collection, host: str, port: int) -> Starlette:
    """Return the application that serves ``collection`` to those who call it by ``host`` and ``port``."""

    def table(_: Request) -> Response:
        return HTMLResponse(collection.table(), headers={"cache-control": "no-store"})

    def picture(request: Request) -> Response:
        png = thumbnail(collection.entry(whole_number(request.path_params["number"])))
        return Response(png, media_type="image/png", headers={"cache-control": KEPT})

    async def page(scope: Scope, receive: Receive, send: Send) -> None:
        path = str(scope["path"]).removeprefix(str(scope["root_path"])).lstrip("/")
        entry = collection.named(path)
        if entry is None:
            await PlainTextResponse("there is no such page", status_code=404)(scope, receive, send)
            return
        if path == entry.name:
            await RedirectResponse(address_of(entry))(scope, receive, send)
            return
        try:
            app = await run_in_threadpool(collection.page, entry, host, port)
        except EndoctError as error:
            await PlainTextResponse(str(error), status_code=500)(scope, receive, send)
            return
        await app({**scope, "root_path": f"{scope['root_path']}/{entry.name}"}, receive, send)

    return Starlette(
        lifespan=few_threads,
        routes=[
            Route("/", table),
            Route("/thumbnails/{version}/{number}.png", picture),
            Mount("/at", app=page),
            Route("/{name}", asset),
        ],
        middleware=[Middleware(Guard, hosts=allowed_hosts(host, port))],
        exception_handlers={NoSuchTile: not_found, EndoctError: failed},
    )
