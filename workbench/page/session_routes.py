"""The addresses at which the page asks about landmarks and saves them: the only ones that take what somebody sends."""

from collections.abc import Callable
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Route

from endoct.stitching.errors import EndoctError
from endoct.stitching.files import SMALL_BYTES
from endoct.workbench.page.presence import Gone, Origin, concerning
from endoct.workbench.page.sessions import Sessions

FRESH = {"cache-control": "no-store"}


def session_routes(session: Sessions | None) -> list[Route]:
    """Return the routes of a comparison's ``session``; none where there is no comparison."""
    if session is None:
        return []

    @concerning(session.origin)
    def state(_: Request) -> Response:
        return JSONResponse(session.state(), headers=FRESH)

    async def judged(request: Request) -> Response:
        return await _answer(request, session.judged_from, session.origin)

    async def save(request: Request) -> Response:
        return await _answer(request, session.save, session.origin)

    return [
        Route("/session.json", state),
        Route("/session.json", save, methods=["POST"]),
        Route("/landmarks.json", judged, methods=["POST"]),
    ]


async def _answer(request: Request, act: Callable[[bytes], dict[str, Any]], origin: Origin) -> Response:
    """Answer with what ``act`` makes of the body; the guard has seen to it that an origin is the page's own."""
    if "origin" not in request.headers:
        return PlainTextResponse("only the page itself may send this", status_code=403)
    if request.headers.get("content-type", "").split(";")[0].strip().lower() != "application/json":
        return PlainTextResponse("only JSON is taken", status_code=415)
    data = b""
    try:
        async for part in request.stream():
            data += part
            if len(data) > SMALL_BYTES:
                return PlainTextResponse("that is too much", status_code=413, headers={"connection": "close"})
    except ClientDisconnect:  # the page was closed meanwhile: nobody waits for an answer
        return Response(status_code=400)
    try:
        origin.check_named(request)
        return JSONResponse(await run_in_threadpool(act, data), headers=FRESH)
    except Gone:
        raise
    except EndoctError as error:
        await run_in_threadpool(origin.check_present)  # rather than what is amiss with what lies there now
        return PlainTextResponse(str(error), status_code=409)
