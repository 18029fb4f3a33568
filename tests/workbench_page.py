"""Folders to show, made up, and the server that shows one of them: over a socket, or asked within this process."""

import json
import shutil
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cache
from http.client import HTTPConnection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import unquote

import uvicorn
from anyio import Event
from anyio.from_thread import BlockingPortal, start_blocking_portal
from mock_comparison import GRID, Kind, write_comparison
from starlette.applications import Starlette

from endoct.fusion.files.store import load_comparison, save_comparison
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.scoring.cells import measure
from endoct.fusion.scoring.overlap import Surface
from endoct.workbench.page.serving import listening_socket, page_or_table

PAIR = {
    "a": {"theta_rad": 2.0, "z_mm": 1.5},
    "b": {"theta_rad": 2.1, "z_mm": 1.4},
    "role": "correct",
    "name": "rim",
    "sigma_mm": 0.05,
}
"""Landmarks as the page sends them."""
PORT = 8765
"""Of a server that is none."""
Answer = tuple[int, bytes, dict[str, str]]
"""Status, body and headers."""
IN_PLACE = Alignment(0.0, 0.0, confidence=0.6, correlation=0.9, ratio=3.0)


def written(folder: Path, **changed: object) -> Path:
    """Write a comparison whose sides lie in place, with fields of its result changed."""
    if changed:
        return _made(folder, **changed)
    for name, content in _unchanged().items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return folder


@cache
def _unchanged() -> dict[Path, bytes]:
    """Return the files of a comparison of which nothing is changed: most tests want one of their own."""
    with TemporaryDirectory() as place:
        made = _made(Path(place) / "comparison")
        return {path.relative_to(made): path.read_bytes() for path in made.rglob("*") if path.is_file()}


def _made(folder: Path, **changed: object) -> Path:
    write_comparison(folder, Kind("endoscope", depth=False), Kind("oct"), **{"doubts": (), **changed})
    found = load_comparison(folder / "comparison.zarr")
    shutil.rmtree(folder / "comparison.zarr")
    surfaces = [Surface(side.name, side.mask, side.valid, None, None) for side in found.sides]
    cells = measure(*surfaces, GRID, aligned=True)
    save_comparison(replace(found, alignment=IN_PLACE, cells=cells), folder / "comparison.zarr")
    return folder


@dataclass(frozen=True)
class Served:
    """A server that runs: where, and who it is."""

    port: int

    @property
    def url(self) -> str:
        """The address of the page."""
        return f"http://127.0.0.1:{self.port}/"

    def get(self, path: str, **headers: str) -> Answer:
        """Ask for ``path`` exactly as it is, which a browser would tidy up; return status, body and headers."""
        method = headers.pop("method", "GET")
        return self.answer(method, path, {name.replace("_", "-"): value for name, value in headers.items()})

    def answer(self, method: str, path: str, headers: dict[str, str], body: bytes | None = None) -> Answer:
        """Send a request as it is; return status, body and headers."""
        connection = HTTPConnection("127.0.0.1", self.port, timeout=60)
        try:
            connection.putrequest(method, path, skip_host="Host" in headers)
            for name, value in (headers | lengths(body)).items():
                connection.putheader(name, value)
            connection.endheaders(body)
            answer = connection.getresponse()
            return answer.status, answer.read(), {name.lower(): value for name, value in answer.getheaders()}
        finally:
            connection.close()


def lengths(body: bytes | None) -> dict[str, str]:
    """Return the header that says how long a body is."""
    return {} if body is None else {"Content-Length": str(len(body))}


@dataclass(frozen=True)
class Asked(Served):
    """The same application without a server: it is called as a server would call it."""

    app: Starlette
    portal: BlockingPortal

    def answer(self, method: str, path: str, headers: dict[str, str], body: bytes | None = None) -> Answer:
        """Have the application answer."""
        return self.portal.call(self._answered, method, path, headers | lengths(body), body)

    async def _answered(self, method: str, path: str, headers: dict[str, str], body: bytes | None) -> Answer:
        place, _, query = path.partition("?")
        named = {"Host": f"127.0.0.1:{self.port}", "Accept-Encoding": "identity"} | headers
        scope = {
            "type": "http", "asgi": {"version": "3.0"}, "http_version": "1.1", "method": method, "scheme": "http",
            "path": unquote(place), "raw_path": place.encode("ascii"), "query_string": query.encode("ascii"),
            "root_path": "", "client": ("127.0.0.1", 50_000), "server": ("127.0.0.1", self.port),
            "headers": [(name.lower().encode("latin-1"), value.encode("latin-1")) for name, value in named.items()],
        }  # fmt: skip
        sent: list[Any] = []
        coming, answered = [{"type": "http.request", "body": body or b""}], Event()

        async def receive() -> Any:
            if not coming:
                await answered.wait()
            return coming.pop() if coming else {"type": "http.disconnect"}

        async def send(message: Any) -> None:
            sent.append(message)
            if message["type"] == "http.response.body" and not message.get("more_body"):
                answered.set()

        with suppress(Exception):  # it has answered that something went wrong; a server would write it down
            await self.app(scope, receive, send)
        return (
            sent[0]["status"],
            b"".join(message.get("body", b"") for message in sent),
            {name.decode("latin-1"): value.decode("latin-1") for name, value in sent[0]["headers"]},
        )


def post(served: Served, path: str, body: Any, **headers: str | None) -> tuple[int, str]:
    """Send ``body`` as the page does, headers changed or (None) left out; return status and answer."""
    origin = served.url.rstrip("/")
    sent = {"Origin": origin, "Content-Type": "application/json", **headers}
    data = body if isinstance(body, bytes) else json.dumps(body).encode()
    named = {name.replace("_", "-"): value for name, value in sent.items() if value is not None}
    status, answer, _ = served.answer("POST", path, named, data)
    return status, answer.decode()


@contextmanager
def application(served: Path | Callable[[str, int], Starlette]) -> Iterator[Asked]:
    """Have what :class:`serving` serves at hand without a server: where no browser asks, and no socket matters."""
    app = (page_or_table(served) if isinstance(served, Path) else served)("127.0.0.1", PORT)
    with (
        start_blocking_portal() as portal,
        portal.wrap_async_context_manager(app.router.lifespan_context(app)),
    ):
        yield Asked(PORT, app, portal)


class serving:
    """Serves the page of a folder, or what makes an application for a host and a port, as long as the block runs."""

    def __init__(self, served: Path | Callable[[str, int], Starlette]) -> None:
        self._socket = listening_socket("127.0.0.1", 0)
        self._port: int = self._socket.getsockname()[1]
        app = (page_or_table(served) if isinstance(served, Path) else served)("127.0.0.1", self._port)
        self._server = uvicorn.Server(uvicorn.Config(app, log_level="error", log_config=None))
        self._thread = threading.Thread(target=self._server.run, kwargs={"sockets": [self._socket]})

    def __enter__(self) -> Served:
        self._thread.start()
        return Served(self._port)

    def __exit__(self, *_: object) -> None:
        self._server.should_exit = True
        self._thread.join()
        self._socket.close()
