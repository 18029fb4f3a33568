"""The application that `endoct open` serves: a start page, a page of every open folder, and the queue of runs.

All of it lies below an address that holds a secret: other pages, other users of the machine and whoever guesses get
nothing. What changes anything is posted as JSON by the page itself. Files are dropped on the page of a folder: each
appears whole at its place, or not at all.
"""

import os
import signal
from collections.abc import AsyncIterable, AsyncIterator, Callable
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from secrets import compare_digest
from typing import Any

from anyio.to_thread import current_default_thread_limiter
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Receive, Scope, Send

from endoct.base.errors import EndoctError
from endoct.base.files.files import inside, leads_below
from endoct.base.files.json_values import object_in
from endoct.base.files.scratch import clear_dead_scratch, put_new, scratch_next_to
from endoct.modalities.registry import manifests
from endoct.workbench.desk.desk import Desk, OpenFolder, whole_path
from endoct.workbench.page.heading import RESEARCH
from endoct.workbench.page.server import (
    ANSWERS_TO_ERRORS,
    FRESH,
    Guard,
    Json,
    allowed_hosts,
    asset,
    kept,
    manual,
    posted_json,
    refused_post,
    whole_number,
)
from endoct.workbench.page.serving import answer_page
from endoct.workbench.page.sessions import POSTED
from endoct.workbench.page.wall import NoSuchTile
from endoct.workbench.report.html_templates import rendered
from endoct.workbench.report.manual import words_json

MOST_THREADS = 6
"""Enough that a thumbnail, a preview and a large folder do not keep the queue waiting."""
REPORT_POLICY = "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:"
MOST_PARTS = 12
"""Of the path of a dropped file: as deep as folders are looked through, and more."""

Answer = Callable[[Request], Any]
Act = Callable[[Request, dict[str, Any]], Any]
"""What is done with a request, and with what was posted as JSON."""


def desk_app(desk: Desk, host: str, port: int) -> Starlette:
    """Return the application of ``desk`` for those who call it by ``host`` and ``port``."""
    answers = _Answers(desk)
    routes, data, actions = answers.pages(), answers.data(), answers.actions()
    return Starlette(
        lifespan=answers.lifespan,
        routes=[
            *(Route(f"{desk.root}{path}", answer) for path, answer in routes.items()),
            *(Route(f"{desk.root}{path}", _json(answer)) for path, answer in data.items()),
            *(Route(f"{desk.root}{path}", _posted(act), methods=["POST"]) for path, act in actions.items()),
            Route(f"{desk.root}/f/{{key}}/file", answers.file, methods=["POST"]),
            Route(f"{desk.root}/manual/{{page:path}}", manual),
            Route(f"{desk.root}/{{name}}", asset),
        ],
        middleware=[
            Middleware(Guard, hosts=allowed_hosts(host, port), is_secret=True),
            Middleware(_Secret, root=desk.root, results=partial(answers.results, host, port)),
        ],
        exception_handlers=ANSWERS_TO_ERRORS,
    )


class _Answers:
    """What ``desk`` is asked, and answers."""

    def __init__(self, desk: Desk) -> None:
        self._desk, self._queue = desk, desk.state.queue

    def pages(self) -> dict[str, Answer]:
        """Return what is answered with pages and pictures, by address."""
        return {
            "/": self.home,
            "/f/{key}/": self.study,
            "/f/{key}/recording": self.recording,
            "/f/{key}/picture.png": self.picture,
            "/f/{key}/thumbnails/{version}/{number}.png": self.thumbnail,
            "/f/{key}/report": self.report,
        }

    def data(self) -> dict[str, Answer]:
        """Return what is answered with JSON, by address."""
        desk, queue = self._desk, self._queue
        return {
            "/folders.json": lambda request: desk.listed(request.query_params.get("in", "")),
            "/forms.json": lambda _: {name: form.to_json() for name, form in desk.forms.items()},
            "/queue.json": lambda _: {"runs": [run.to_json() for run in queue.runs()]},
            "/queue/{name}/log.json": lambda request: {"log": queue.log(request.path_params["name"])},
            "/f/{key}/found.json": lambda request: self._folder(request).study.to_json(),
            "/f/{key}/results.json": lambda request: self._folder(request).results_json(),
            "/f/{key}/sidecar.json": self.sidecar,
        }

    def actions(self) -> dict[str, Act]:
        """Return what is done with what is posted, by address."""
        desk, queue = self._desk, self._queue
        return {
            "/open": lambda _, posted: {"address": desk.open(whole_path(posted.get("folder"))).address},
            "/quit": lambda *_: _done(end),
            "/queue/clear": lambda *_: _done(queue.clear),
            "/queue/{name}/cancel": lambda request, _: _done(queue.cancel, request.path_params["name"]),
            "/queue/{name}/repeat": lambda request, _: {"done": queue.repeat(request.path_params["name"])},
            "/f/{key}/look": lambda request, _: _done(self._folder(request).study.look),
            "/f/{key}/command": lambda request, posted: desk.command(self._folder(request), posted),
            "/f/{key}/run": lambda request, posted: desk.run(self._folder(request), posted),
            "/f/{key}/note": lambda request, posted: self._folder(request).note(posted),
            "/f/{key}/sidecar": lambda request, posted: desk.save_sidecar(self._folder(request), posted),
            "/f/{key}/preview": lambda request, posted: desk.preview(self._folder(request), posted),
        }

    def _folder(self, request: Request) -> OpenFolder:
        return self._desk.folder(request.path_params["key"])

    def home(self, _: Request) -> Response:
        return _page("desk/home.html", "start", root=self._desk.root, recent=self._desk.recent_json())

    def study(self, request: Request) -> Response:
        folder = self._folder(request)
        folder.study.look()
        name = folder.folder.name or str(folder.folder)
        return _page("desk/study.html", name, root=self._desk.root, folder=folder.folder)

    def recording(self, request: Request) -> Response:
        folder = self._folder(request)
        found = folder.study.input(request.query_params.get("name", ""))
        shown = {"folder": folder.folder, "recording": found, "modalities": [*manifests()]}
        return _page("desk/recording.html", found.name, root=self._desk.root, **shown)

    def picture(self, request: Request) -> Response:
        return kept(self._desk.picture(self._folder(request), request.query_params.get("name", "")), "image/png")

    def thumbnail(self, request: Request) -> Response:
        version, number = request.path_params["version"], whole_number(request.path_params["number"])
        return kept(self._folder(request).thumbnail(version, number), "image/png")

    def report(self, request: Request) -> Response:
        html = self._folder(request).report(request.query_params.get("name", ""))
        return HTMLResponse(html, headers={**FRESH, "content-security-policy": REPORT_POLICY})

    def sidecar(self, request: Request) -> dict[str, Any]:
        asked = request.query_params
        return self._desk.sidecar(self._folder(request), asked.get("name", ""), asked.get("modality") or None)

    async def file(self, request: Request) -> Response:
        if refused := refused_post(request, "application/octet-stream"):
            return refused
        folder = await run_in_threadpool(self._folder, request)
        try:
            await take_file(folder.folder, request.query_params.get("name", ""), request.stream())
        except ClientDisconnect:  # the page was closed meanwhile
            return Response(status_code=400)
        except EndoctError as error:
            return PlainTextResponse(str(error), status_code=409, headers={**FRESH, "connection": "close"})
        return Json({"done": True}, headers=FRESH)

    @asynccontextmanager
    async def lifespan(self, _: Starlette) -> AsyncIterator[None]:
        current_default_thread_limiter().total_tokens = MOST_THREADS
        self._queue.start()
        yield
        self._queue.leave()
        self._desk.previewer.close()

    async def results(self, host: str, port: int, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            folder = await run_in_threadpool(self._desk.folder, str(scope["path"]).split("/")[3])
            await run_in_threadpool(folder.results.ensure_looked)  # a bookmark, or a page of before a restart
        except EndoctError as error:
            await PlainTextResponse(str(error), status_code=404)(scope, receive, send)
            return
        await answer_page(folder.results, host, port, scope, receive, send)


class _Secret:
    """Answers nobody who does not know the secret part of the address; passes requests for results on to them."""

    def __init__(self, app: ASGIApp, root: str, results: ASGIApp) -> None:
        self._app, self._root, self._results = app, root, results

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        parts = ["", *str(scope["path"]).removeprefix("/").split("/")]
        if not compare_digest(f"/{parts[1]}".encode("utf-8", "replace"), self._root.encode()):
            refused = PlainTextResponse("open the address that `endoct open` printed", status_code=403, headers=FRESH)
            await refused(scope, receive, send)
        elif len(parts) > 5 and parts[2] == "f" and parts[4] == "at":
            await self._results(scope, receive, send)
        else:
            await self._app(scope, receive, send)


def _page(template: str, title: str, **values: object) -> Response:
    words = words_json(f"{values['root']}/manual/")
    page = rendered(template, title=title, research=RESEARCH, words=words, **values)
    return HTMLResponse(page.encode("utf-8", "backslashreplace"), headers=FRESH)


def _done(act: Callable[..., object], *given: str) -> dict[str, Any]:
    act(*given)
    return {"done": True}


def _json(answer: Answer) -> Answer:
    """Have what ``answer`` returns sent as JSON; what cannot be used is answered as 409, with why."""

    def answered(request: Request) -> Response:
        try:
            return Json(answer(request), headers=FRESH)
        except NoSuchTile:
            raise
        except EndoctError as error:
            return PlainTextResponse(str(error), status_code=409, headers=FRESH)

    return answered


def _posted(act: Act) -> Answer:
    """Have ``act`` called with what the page itself posted as JSON."""

    async def answered(request: Request) -> Response:
        data = await posted_json(request)
        if isinstance(data, Response):
            return data
        return await run_in_threadpool(_json(lambda asked: act(asked, object_in(data, POSTED))), request)

    return answered


def end() -> None:
    """End the server as Ctrl+C does, where there may be no terminal to press it in."""
    signal.raise_signal(signal.SIGINT)


async def take_file(folder: Path, name: str, content: AsyncIterable[bytes]) -> None:
    """Write ``content`` to the file ``name`` below ``folder``, with the folders that are missing.

    Raises :class:`EndoctError` where something lies there already, the path leads elsewhere or is hidden, and where it
    cannot be written.
    """
    place = inside(folder, name, "a dropped file")
    parts = Path(name).parts
    if (
        any(part.startswith(".") for part in parts)
        or len(parts) > MOST_PARTS
        or any(ord(letter) < 32 for letter in name)
    ):
        raise EndoctError("a dropped file cannot be taken", found=name[:80], expected="a plain name, no hidden file")
    if not leads_below(folder, place.parent):
        raise EndoctError("a dropped file would leave the folder by a link", found=name[:80])
    if os.path.lexists(place):
        raise _taken(place)
    try:
        await run_in_threadpool(place.parent.mkdir, parents=True, exist_ok=True)
        await run_in_threadpool(clear_dead_scratch, place.parent, place.name)  # of a server that was killed
        with scratch_next_to(place) as scratch, (scratch / "file").open("wb") as file:
            async for part in content:
                await run_in_threadpool(file.write, part)
            file.flush()
            await run_in_threadpool(os.fsync, file.fileno())
            file.close()
            await run_in_threadpool(put_new, scratch / "file", place)
    except FileExistsError as error:
        raise _taken(place) from error
    except OSError as error:
        raise EndoctError(f"{place} cannot be written", found=error.strerror or str(error)) from error


def _taken(place: Path) -> EndoctError:
    return EndoctError(f"{place} exists already", remedy="rename what you dropped, or move that away")
