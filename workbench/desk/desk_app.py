"""The application that `endoct open` serves: a start page, a page of every open folder, and the queue of runs.

All of it lies below an address that holds a secret: other pages, other users of the machine and whoever guesses get
nothing. What changes anything is posted as JSON by the page itself. Files are dropped on the page of a folder: each
appears whole at its place, or not at all.
"""

import os
from collections.abc import AsyncIterable, AsyncIterator, Callable
from contextlib import asynccontextmanager
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
from endoct.base.files.scratch import put_new, scratch_next_to
from endoct.modalities.registry import manifests
from endoct.workbench.desk.desk import Desk, whole_path
from endoct.workbench.page.heading import RESEARCH
from endoct.workbench.page.server import (
    ANSWERS_TO_ERRORS,
    FRESH,
    KEPT,
    Guard,
    Json,
    allowed_hosts,
    asset,
    posted_json,
    refused_post,
    whole_number,
)
from endoct.workbench.page.serving import answer_page
from endoct.workbench.page.wall import NoSuchTile
from endoct.workbench.report.html_templates import rendered

MOST_THREADS = 6
"""Enough that a thumbnail, a preview and a large folder do not keep the queue waiting."""
REPORT_POLICY = "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:"
POSTED = "what the page sent"
MOST_PARTS = 12
"""Of the path of a dropped file: as deep as folders are looked through, and more."""

Answer = Callable[[Request], Any]


def desk_app(desk: Desk, host: str, port: int) -> Starlette:
    """Return the application of ``desk`` for those who call it by ``host`` and ``port``."""
    queue = desk.state.queue

    def home(_: Request) -> Response:
        return _page("desk/home.html", "start", root=desk.root, recent=desk.recent_json())

    def study(request: Request) -> Response:
        folder = desk.folder(request.path_params["key"])
        folder.study.look()
        name = folder.folder.name or str(folder.folder)
        return _page("desk/study.html", name, root=desk.root, folder=folder.folder)

    def recording(request: Request) -> Response:
        folder = desk.folder(request.path_params["key"])
        found = folder.study.input(request.query_params.get("name", ""))
        shown = {"folder": folder.folder, "recording": found, "modalities": [*manifests()]}
        return _page("desk/recording.html", found.name, root=desk.root, **shown)

    def picture(request: Request) -> Response:
        png = desk.picture(desk.folder(request.path_params["key"]), request.query_params.get("name", ""))
        return Response(png, media_type="image/png", headers={"cache-control": KEPT})

    def thumbnail(request: Request) -> Response:
        parts = request.path_params
        png = desk.folder(parts["key"]).thumbnail(parts["version"], whole_number(parts["number"]))
        return Response(png, media_type="image/png", headers={"cache-control": KEPT})

    def report(request: Request) -> Response:
        html = desk.folder(request.path_params["key"]).report(request.query_params.get("name", ""))
        return HTMLResponse(html, headers={**FRESH, "content-security-policy": REPORT_POLICY})

    def found_json(request: Request) -> dict[str, Any]:
        return desk.folder(request.path_params["key"]).study.to_json()

    def results_json(request: Request) -> dict[str, Any]:
        return desk.folder(request.path_params["key"]).results_json()

    def sidecar_json(request: Request) -> dict[str, Any]:
        asked = request.query_params
        return desk.sidecar(
            desk.folder(request.path_params["key"]), asked.get("name", ""), asked.get("modality") or None
        )

    def opened(_: Request, posted: dict[str, Any]) -> dict[str, str]:
        return {"address": desk.open(whole_path(posted.get("folder"))).address}

    def clear(_request: Request, _posted: dict[str, Any]) -> dict[str, bool]:
        queue.clear()
        return {"done": True}

    def of_run(act: Callable[[str], object]) -> Callable[[Request, dict[str, Any]], Any]:
        return lambda request, _: {"done": act(request.path_params["name"])}

    def of_folder(act: Callable[[Any, dict[str, Any]], Any]) -> Callable[[Request, dict[str, Any]], Any]:
        return lambda request, posted: act(desk.folder(request.path_params["key"]), posted)

    async def file(request: Request) -> Response:
        """Take a file that was dropped on the page of a folder."""
        if refused := refused_post(request, "application/octet-stream"):
            return refused
        folder = await run_in_threadpool(desk.folder, request.path_params["key"])
        try:
            await take_file(folder.folder, request.query_params.get("name", ""), request.stream())
        except ClientDisconnect:  # the page was closed meanwhile
            return Response(status_code=400)
        except EndoctError as error:
            return PlainTextResponse(str(error), status_code=409, headers={**FRESH, "connection": "close"})
        return Json({"done": True}, headers=FRESH)

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        current_default_thread_limiter().total_tokens = MOST_THREADS
        queue.start()
        yield
        queue.leave()
        desk.previewer.close()

    async def results(scope: Scope, receive: Receive, send: Send) -> None:
        try:
            folder = await run_in_threadpool(desk.folder, str(scope["path"]).split("/")[3])
            await run_in_threadpool(folder.results.ensure_looked)  # a bookmark, or a page of before a restart
        except EndoctError as error:
            await PlainTextResponse(str(error), status_code=404)(scope, receive, send)
            return
        await answer_page(folder.results, host, port, scope, receive, send)

    routes = {
        "/": home,
        "/folders.json": _json(lambda request: desk.listed(request.query_params.get("in", ""))),
        "/forms.json": _json(lambda _: {name: form.to_json() for name, form in desk.forms.items()}),
        "/queue.json": _json(lambda _: {"runs": [run.to_json() for run in queue.runs()]}),
        "/queue/{name}/log.json": _json(lambda request: {"log": queue.log(request.path_params["name"])}),
        "/f/{key}/": study,
        "/f/{key}/recording": recording,
        "/f/{key}/picture.png": picture,
        "/f/{key}/thumbnails/{version}/{number}.png": thumbnail,
        "/f/{key}/report": report,
        "/f/{key}/found.json": _json(found_json),
        "/f/{key}/results.json": _json(results_json),
        "/f/{key}/sidecar.json": _json(sidecar_json),
    }
    actions = {
        "/open": opened,
        "/queue/clear": clear,
        "/queue/{name}/cancel": of_run(queue.cancel),
        "/queue/{name}/repeat": of_run(queue.repeat),
        "/f/{key}/look": of_folder(lambda folder, _: {"done": folder.study.look()}),
        "/f/{key}/command": of_folder(desk.command),
        "/f/{key}/run": of_folder(desk.run),
        "/f/{key}/sidecar": of_folder(desk.save_sidecar),
        "/f/{key}/preview": of_folder(desk.preview),
    }
    return Starlette(
        lifespan=lifespan,
        routes=[
            *(Route(f"{desk.root}{path}", answer) for path, answer in routes.items()),
            *(Route(f"{desk.root}{path}", _posted(act), methods=["POST"]) for path, act in actions.items()),
            Route(f"{desk.root}/f/{{key}}/file", file, methods=["POST"]),
            Route(f"{desk.root}/{{name}}", asset),
        ],
        middleware=[
            Middleware(Guard, hosts=allowed_hosts(host, port), is_secret=True),
            Middleware(_Secret, root=desk.root, results=results),
        ],
        exception_handlers=ANSWERS_TO_ERRORS,
    )


class _Secret:
    """Answers nobody who does not know the secret part of the address; passes requests for results on to them."""

    def __init__(self, app: ASGIApp, root: str, results: ASGIApp) -> None:
        self._app, self._root, self._results = app, root, results

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or answer 403."""
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
    page = rendered(template, title=title, research=RESEARCH, **values)
    return HTMLResponse(page.encode("utf-8", "backslashreplace"), headers=FRESH)


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


def _posted(act: Callable[[Request, dict[str, Any]], Any]) -> Answer:
    """Have ``act`` called with what the page itself posted as JSON."""

    async def answered(request: Request) -> Response:
        data = await posted_json(request)
        if isinstance(data, Response):
            return data
        return await run_in_threadpool(_json(lambda asked: act(asked, object_in(data, POSTED))), request)

    return answered


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
        with scratch_next_to(place) as scratch, (scratch / "file").open("wb") as file:
            async for part in content:
                await run_in_threadpool(file.write, part)
            file.flush()
            os.fsync(file.fileno())
            file.close()
            put_new(scratch / "file", place)
    except FileExistsError as error:
        raise _taken(place) from error
    except OSError as error:
        raise EndoctError(f"{place} cannot be written", found=error.strerror or str(error)) from error


def _taken(place: Path) -> EndoctError:
    return EndoctError(f"{place} exists already", remedy="rename what you dropped, or move that away")
