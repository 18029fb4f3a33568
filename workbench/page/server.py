"""The server of the page: its files, its description, tiles, values. It opens nothing but what it was given.

Only the addresses at which the page asks about landmarks and drawings, saves them, and exports, take what somebody
sends. Only the page that the server served itself may ask, by the name under which the server was called.
"""

import json
import threading
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
from contextlib import asynccontextmanager, suppress
from functools import partial
from importlib.resources import files
from typing import Any

from anyio.to_thread import current_default_thread_limiter
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers, MutableHeaders
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import HTMLResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from endoct.base.errors import EndoctError, cause_of, visible
from endoct.base.files.files import SMALL_BYTES
from endoct.workbench.page.exports import Exports
from endoct.workbench.page.heading import Link, document
from endoct.workbench.page.layers import png_of
from endoct.workbench.page.presence import Gone, Origin, concerning
from endoct.workbench.page.shown import Shown
from endoct.workbench.page.wall import NoSuchTile, Tile
from endoct.workbench.report.manual import manual_page
from endoct.workbench.running.refusals import in_one_line

FRESH = {"cache-control": "no-store"}
LOOPBACK = frozenset(("127.0.0.1", "localhost", "[::1]"))
_EMPTY_STYLE = "'sha256-47DEQpj8HBSa+/TImW+5JCeuQeRkm5NMpJWZG3hSuFU='"
"""An empty style, which keeps OpenSeadragon from adding one."""
POLICY = (
    f"default-src 'none'; script-src 'self'; style-src 'self' {_EMPTY_STYLE}; img-src 'self' data: blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "content-security-policy": POLICY,
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
}
PACKAGE = "endoct.workbench.page"
ASSETS = ("page.js", "cylinder.js", "folder.js", "desk.js", "page.css", "desk.css")
TYPES = {"js": "text/javascript", "css": "text/css"}
"""Media types by suffix."""
MOST_DIGITS = 9
"""Digits of a number in an address; longer ones name nothing here."""
KEPT = "private, max-age=3600"
"""How long a browser may keep a tile: addresses of tiles have a part that is new with every server."""
MOST_THREADS = 2
"""Threads that cut tiles: more take memory and save no time."""
FARTHEST_MM, MOST_TURNS_RAD = 1e5, 1e5


async def _answer(act: Callable[[bytes], dict[str, Any] | Response], origin: Origin, request: Request) -> Response:
    """Answer with what ``act`` makes of the body, as JSON where that is no answer yet."""
    data = await posted_json(request)
    if isinstance(data, Response):
        return data
    try:
        origin.check_named(request)
        answer = await run_in_threadpool(act, data)
        return answer if isinstance(answer, Response) else Json(answer, headers=FRESH)
    except Gone:
        raise
    except EndoctError as error:
        await run_in_threadpool(origin.check_present)  # rather than what is amiss with what lies there now
        return PlainTextResponse(str(error), status_code=409)


def refused_post(request: Request, media_type: str) -> Response | None:
    """Return the answer that refuses what the page itself did not send, or sent as anything but ``media_type``."""
    if "origin" not in request.headers:
        return PlainTextResponse("only the page itself may send this", status_code=403)
    if request.headers.get("content-type", "").split(";")[0].strip().lower() != media_type:
        return PlainTextResponse(f"only {media_type} is taken", status_code=415)
    return None


async def posted_json(request: Request) -> bytes | Response:
    """Return the body of a request that the page itself sent as JSON, or the answer that refuses it.

    The guard has seen to it that an origin is the page's own.
    """
    if refused := refused_post(request, "application/json"):
        return refused
    data = b""
    try:
        async for part in request.stream():
            data += part
            if len(data) > SMALL_BYTES:
                return PlainTextResponse("that is too much", status_code=413, headers={"connection": "close"})
    except ClientDisconnect:  # the page was closed meanwhile: nobody waits for an answer
        return Response(status_code=400)
    return data


def allowed_hosts(host: str, port: int) -> frozenset[str]:
    """Return what a browser may call a server bound to ``host`` and ``port``.

    A server on this machine alone has the names of this machine; one that is bound to an address has that too. A page
    from elsewhere that has its own name lead here (DNS rebinding) calls it by another.
    """
    named = f"[{host}]" if ":" in host else host
    return frozenset(f"{name}:{port}" for name in {*LOOPBACK, named})


class Guard:
    """Refuses requests by another name, or of another page, and forbids pages whatever they do not need.

    ``is_secret``: the address cannot be guessed, so that following a link to it is no attack.
    """

    def __init__(self, app: ASGIApp, hosts: Iterable[str], *, is_secret: bool = False) -> None:
        self._app = app
        self._hosts = frozenset(hosts)
        self._is_secret = is_secret

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or answer 403."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def send_guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)  # a report may be allowed less
            await send(message)

        if refused := self._refusal(Headers(scope=scope)):
            await PlainTextResponse(refused, status_code=403)(scope, receive, send_guarded)
        else:
            await self._app(scope, receive, send_guarded)

    def _refusal(self, headers: Headers) -> str:
        host, origin = headers.get("host", ""), headers.get("origin")
        if host.lower() not in self._hosts:
            return "this server goes by another name"
        if origin is not None and origin.lower() != f"http://{host.lower()}":
            return "another page asked for this"
        # a picture or a script on another page brings no origin, but browsers say where it stands
        if headers.get("sec-fetch-site", "none") in ("none", "same-origin"):
            return ""
        # who knows a secret address may lead there, as the file does that a browser is started on
        leads = headers.get("sec-fetch-mode") == "navigate" and headers.get("sec-fetch-dest") == "document"
        return "" if self._is_secret and leads and origin is None else "another page asked for this"


def app_for(shown: Shown, host: str, port: int, above: Link | None = None) -> Starlette:
    """Return the application that serves the page of ``shown`` to those who call it by ``host`` and ``port``.

    ``above`` leads to the table that it was opened from.
    """
    return Starlette(
        lifespan=few_threads,
        routes=[*_Answers(shown, above).routes(), MANUAL, Route("/{name}", asset)],
        middleware=[Middleware(Guard, hosts=allowed_hosts(host, port))],
        exception_handlers=ANSWERS_TO_ERRORS,
    )


class _Answers:
    """What the page of ``shown`` is answered; ``above`` leads to the table that it was opened from."""

    def __init__(self, shown: Shown, above: Link | None) -> None:
        self._shown, self._above = shown, above
        self._description = json.dumps(shown.description.to_json(), allow_nan=False).encode()

    def routes(self) -> list[Route]:
        """Return the addresses; those of landmarks and drawings are there for a comparison only."""
        shown, origin = self._shown, self._shown.origin
        exports = Exports(origin)
        asked: dict[str, Callable[[Request], Response]] = {
            "/": self.page,
            "/present": lambda _: Response(status_code=204, headers=FRESH),
            "/description.json": self.description,
            "/exports.json": lambda _: Json(exports.listed(), headers=FRESH),
            "/outlines.json": lambda _: Json(shown.outlines(), headers=FRESH),
            "/values.json": self.values,
            "/relief/{version}/{key}.bin": self.relief,
            "/volume/{version}.bin": lambda _: kept(shown.volume()),
            "/pictures/{version}/{side}/{place}.json": self.pictures,
            "/reading/{side}": self.reading,
            "/tiles/{version}/{key}/{level}/{column}_{row}.png": self.tile,
        }
        posted: dict[str, Callable[[bytes], dict[str, Any] | Response]] = {
            "/export-line.json": exports.command,
            "/export.json": exports.save,
            "/export": exports.download,
        }
        if (session := shown.session) is not None:
            asked["/session.json"] = lambda _: Json(session.state(), headers=FRESH)
            posted |= {"/session.json": session.save, "/landmarks.json": session.judged_from}
        if (masks := shown.masks) is not None:
            asked["/masks.json"] = lambda _: Json(masks.listed(), headers=FRESH)
            posted |= {"/masks.json": masks.save, "/drawing.json": masks.outlined, "/score.json": masks.score}
        checked = concerning(origin)
        return [
            *(Route(path, checked(answer)) for path, answer in asked.items()),
            Route("/reading/{side}", checked(self.begin_reading), methods=["POST"]),
            *(Route(path, partial(_answer, act, origin), methods=["POST"]) for path, act in posted.items()),
        ]

    def page(self, _: Request) -> Response:
        shown, options = self._shown, {"manual": "manual/", "output": self._shown.origin.digest}
        html = document("page/served.html", shown.heading, shown.sections, above=self._above, **options)
        return HTMLResponse(html, headers=FRESH)

    def description(self, _: Request) -> Response:
        return Response(self._description, media_type="application/json", headers=FRESH)

    def tile(self, request: Request) -> Response:
        level, column, row = (whole_number(request.path_params[name]) for name in ("level", "column", "row"))
        return kept(png_of(self._shown.tile(request.path_params["key"], Tile(level, column, row))), "image/png")

    def relief(self, request: Request) -> Response:
        return kept(self._shown.relief(request.path_params["key"]))

    def values(self, request: Request) -> Response:
        theta_rad = _place(request, "theta_rad", MOST_TURNS_RAD)
        z_mm = _place(request, "z_mm", FARTHEST_MM)
        return Json(self._shown.values_at(theta_rad, z_mm), headers=FRESH)

    def pictures(self, request: Request) -> Response:
        found = self._shown.pictures(request.path_params["side"], whole_number(request.path_params["place"]))
        return Json(found, headers={"cache-control": KEPT})

    def reading(self, request: Request) -> Response:
        reader = self._shown.side(request.path_params["side"]).reader
        if reader is None:
            return Json({"state": "absent", "share": 0.0, "said": "the recording is not there"})
        return Json({"state": reader.state, "share": reader.share, "said": reader.said}, headers=FRESH)

    def begin_reading(self, request: Request) -> Response:
        if (reader := self._shown.side(request.path_params["side"]).reader) is not None:
            reader.start()
        return self.reading(request)


def kept(content: bytes, media_type: str = "application/octet-stream") -> Response:
    """Return an answer that a browser may keep for a while."""
    return Response(content, media_type=media_type, headers={"cache-control": KEPT})


@asynccontextmanager
async def few_threads(_: Starlette) -> AsyncIterator[None]:
    """Limit an application to few threads."""
    current_default_thread_limiter().total_tokens = MOST_THREADS
    yield


def asset(request: Request) -> Response:
    """Answer with a file of the page; there are no others."""
    name = request.path_params["name"]
    if name not in ASSETS:
        return PlainTextResponse("there is no such page", status_code=404)
    content, suffix = files(PACKAGE).joinpath("bundle", name).read_bytes(), name.rpartition(".")[2]
    return Response(content, media_type=f"{TYPES[suffix]}; charset=utf-8", headers={"cache-control": "no-cache"})


def manual(request: Request) -> Response:
    """Answer with a page of the manuals, which ship with the program."""
    page = manual_page(request.path_params["page"])
    if page is None:
        return PlainTextResponse("there is no such page in the manual", status_code=404)
    return HTMLResponse(page, headers={"cache-control": "no-cache"})


MANUAL = Route("/manual/{page:path}", manual)


def whole_number(text: str) -> int:
    """Return the number that stands in an address. Raises :class:`NoSuchTile` where there is none."""
    if not (text.isascii() and text.isdigit() and len(text) <= MOST_DIGITS):
        raise NoSuchTile("there is no such tile", found=text[:40], expected="numbers")
    return int(text)


def _place(request: Request, name: str, most: float) -> float:
    text = request.query_params.get(name, "")
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not abs(value) <= most:
        raise NoSuchTile("there is no such place", found=f"{name} {text[:40]}", expected="a number")
    return value


class Json(JSONResponse):
    """JSON with names of files, in which bytes that are no text are escaped."""

    def render(self, content: Any) -> bytes:
        """Return the bytes to send."""
        return json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode(
            "utf-8", "backslashreplace"
        )


def _answering(
    status: int, headers: dict[str, str] | None = None, say: Callable[[Any], str] = str
) -> Callable[[Request, Any], Awaitable[Response]]:
    """Return what answers an error with a status and its text."""

    async def answer(_: Request, error: Any) -> Response:
        return PlainTextResponse(say(error), status_code=status, headers=headers)

    return answer


_NOT_READ = _answering(404, say=lambda error: visible(cause_of(error)))  # the system has no such file, or refuses it
_AS_IN_A_TERMINAL = _answering(500, FRESH, lambda error: str(in_one_line(error)))


ANSWERS_TO_ERRORS: dict[Any, Any] = {
    MemoryError: _AS_IN_A_TERMINAL,
    RecursionError: _AS_IN_A_TERMINAL,
    NoSuchTile: _answering(404),
    Gone: _answering(410, FRESH),
    EndoctError: _answering(500),
    OSError: _NOT_READ,
    UnicodeError: _NOT_READ,
}


def page_app(shown: Shown, open_anew: Callable[[], Shown], host: str, port: int) -> Starlette:
    """Return the application of one page alone, as :class:`Page` serves it."""
    page = Page(shown, open_anew, host, port)
    guard = Middleware(Guard, hosts=allowed_hosts(host, port))
    return Starlette(lifespan=few_threads, routes=[Mount("/", app=page)], middleware=[guard])


class Page:
    """Serves what is ``shown`` until that is gone and the page is asked for: then what ``open_anew`` returns."""

    def __init__(
        self, shown: Shown, open_anew: Callable[[], Shown], host: str, port: int, above: Link | None = None
    ) -> None:
        self._open_anew, self._place = open_anew, (host, port, above)
        self._lock = threading.Lock()
        self._serve(shown)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request; of the page itself with what lies in the folder now."""
        path = str(scope["path"]).removeprefix(str(scope["root_path"]))
        if path in ("", "/") and (refused := await run_in_threadpool(self._follow)):
            await PlainTextResponse(refused, status_code=410, headers=FRESH)(scope, receive, send)
        else:
            await self._app(scope, receive, send)

    def _serve(self, shown: Shown) -> None:
        self._shown, self._origin, self._app = shown, shown.origin, app_for(shown, *self._place)
        self._saved = shown.masks and shown.masks.listed()

    def _follow(self) -> str:
        """Open what lies in the folder now, where that is something else; return why it cannot be, else "".

        Masks that were saved meanwhile are layers then.
        """
        with self._lock:
            with suppress(Gone):
                self._origin.check_present()
                if not self._shown.masks or self._shown.masks.listed() == self._saved:
                    return ""
            try:
                self._serve(self._open_anew())
            except EndoctError as error:
                return str(error)
            except OSError as error:
                return visible(cause_of(error))
        return ""
