"""Folders to show, made up, and the server that shows one of them."""

import json
import shutil
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import uvicorn
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
IN_PLACE = Alignment(0.0, 0.0, confidence=0.6, correlation=0.9, ratio=3.0)


def written(folder: Path, **changed: object) -> Path:
    """Write a comparison whose sides lie in place, with fields of its result changed."""
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

    def get(self, path: str, **headers: str) -> tuple[int, bytes, dict[str, str]]:
        """Ask for ``path`` exactly as it is, which a browser would tidy up; return status, body and headers."""
        connection = HTTPConnection("127.0.0.1", self.port, timeout=60)
        try:
            connection.putrequest(headers.pop("method", "GET"), path, skip_host="Host" in headers)
            for name, value in headers.items():
                connection.putheader(name.replace("_", "-"), value)
            connection.endheaders()
            answer = connection.getresponse()
            return answer.status, answer.read(), {name.lower(): value for name, value in answer.getheaders()}
        finally:
            connection.close()


def post(served: Served, path: str, body: Any, **headers: str | None) -> tuple[int, str]:
    """Send ``body`` as the page does, headers changed or (None) left out; return status and answer."""
    origin = served.url.rstrip("/")
    sent = {"Origin": origin, "Content-Type": "application/json", **headers}
    data = body if isinstance(body, bytes) else json.dumps(body).encode()
    connection = HTTPConnection("127.0.0.1", served.port, timeout=60)
    try:
        named = {name.replace("_", "-"): value for name, value in sent.items() if value is not None}
        connection.request("POST", path, data, named)
        answer = connection.getresponse()
        return answer.status, answer.read().decode()
    finally:
        connection.close()


class serving:
    """Serves the page of a folder, or what makes an application for a host and a port, as long as the block runs."""

    def __init__(self, served: Path | Callable[[str, int], Starlette]) -> None:
        self._socket = listening_socket("127.0.0.1", 0)
        self._port: int = self._socket.getsockname()[1]
        app = (page_or_table(served) if isinstance(served, Path) else served)("127.0.0.1", self._port)
        self._server = uvicorn.Server(uvicorn.Config(app, log_level="error"))
        self._thread = threading.Thread(target=self._server.run, kwargs={"sockets": [self._socket]})

    def __enter__(self) -> Served:
        self._thread.start()
        return Served(self._port)

    def __exit__(self, *_: object) -> None:
        self._server.should_exit = True
        self._thread.join()
        self._socket.close()
