"""What tests share is what it stands for: a kept second process a new one, an application that is asked a server."""

import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from kept_process import KeptProcess
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse
from starlette.routing import Route
from workbench_page import Served, application, post, serving

from endoct.base.errors import EndoctError


@pytest.fixture
def kept() -> Iterator[KeptProcess]:
    made = KeptProcess()
    yield made
    made.end()


def identity(kept: KeptProcess) -> int:
    with kept.lent() as process:
        return process.call(os.getpid).result()


def test_one_process_is_lent_to_one_after_the_other(kept: KeptProcess) -> None:
    first = identity(kept)
    assert first != os.getpid()
    with kept.lent() as process:
        assert identity(kept) != first  # who asks meanwhile gets another one
        late = process.call(sum, range(5_000_000))
    assert late.done()  # nobody gets the answer to what another asked for
    assert identity(kept) == first


def test_what_one_has_stored_goes_with_the_next(kept: KeptProcess) -> None:
    with kept.lent() as process:
        mine = process.store("mine")
        assert process.call(str.upper, mine).result() == "MINE"
    with kept.lent() as process:
        assert process.store("yours") == mine
        assert process.call(str.upper, mine).result() == "YOURS"


def test_it_goes_along_into_another_folder(kept: KeptProcess, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = identity(kept)
    monkeypatch.chdir(tmp_path)
    with kept.lent() as process:
        assert process.call(os.getcwd).result() == str(tmp_path)
    assert identity(kept) == first


@pytest.mark.parametrize("change", ["variable", "path"])
def test_other_surroundings_get_a_new_one(
    kept: KeptProcess, change: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = identity(kept)
    if change == "variable":
        monkeypatch.setenv("OF_MINE", "1")
    else:
        monkeypatch.syspath_prepend(tmp_path)
    assert identity(kept) not in (first, os.getpid())


def test_who_comes_after_a_failure_gets_the_same_one_unless_it_ended(kept: KeptProcess) -> None:
    first = identity(kept)
    with pytest.raises(ZeroDivisionError), kept.lent():
        _ = 1 / 0
    assert identity(kept) == first
    with kept.lent() as process, pytest.raises(EndoctError, match="has ended"):
        process.call(os._exit, 1).result()
    assert identity(kept) not in (first, os.getpid())


def echo(host: str, port: int) -> Starlette:
    async def answered(request: Request) -> JSONResponse:
        if request.headers.get("fails"):
            raise ValueError("asked for")
        sent = {name: value for name, value in request.headers.items() if name != "host"}
        here = request.headers["host"] == f"{host}:{port}"
        facts = (request.method, request.url.path, request.url.query, sent, here, (await request.body()).decode())
        return JSONResponse(facts, headers={"X-Facts": str(len(facts))})

    async def failed(request: Request, error: Exception) -> PlainTextResponse:
        return PlainTextResponse(str(error), 500)

    return Starlette(
        routes=[Route("/{rest:path}", answered, methods=["GET", "POST"])], exception_handlers={Exception: failed}
    )


def answers(served: Served) -> list[object]:
    same = {"Origin": "http://localhost"}
    return [
        [served.get(path)[:2] for path in ("/", "//", "/a/../b", "/%2e%2e/x%20y?z=%26", "/%C3%A9")],
        served.get("/", Host="elsewhere", Sec_Fetch_Site="none")[1],
        served.get("/", method="PUT")[0],
        served.get("/")[2]["x-facts"],
        post(served, "/x", {"a": 1}, **same),
        post(served, "/x", b"\x41", **same, Content_Type=None),
        served.get("/", fails="yes")[:2],
    ]


def test_an_application_that_is_asked_answers_as_by_a_server() -> None:
    by: list[Callable[..., object]] = [serving, application]
    found = []
    for how in by:
        with how(echo) as served:
            found.append(answers(served))
    assert found[0] == found[1]
    method, path, query, *_ = json.loads(found[0][0][3][1])
    assert (method, path, query) == ("GET", "/../x y", "z=%26")
