"""A browser for tests: the Chromium that is installed, watched for errors and for requests that leave the machine."""

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import pytest

QUIET = (
    "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
)  # fmt: skip


@dataclass
class Watched:
    """A page with what went wrong on it, and what it asked for."""

    page: Any
    errors: list[str] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)

    def panes(self) -> list[dict[str, float]]:
        """Return what every pane shows: thetaDeg, zMm, mmPerPx."""
        script = "all => all.map(pane => ({...pane.dataset}))"
        return [{k: float(v) for k, v in one.items()} for one in self.page.locator(".pane").evaluate_all(script)]

    def settle(self) -> None:
        """Wait until the panes show the same twice in a row."""
        before: list[dict[str, float]] = []
        for _ in range(100):
            self.page.wait_for_timeout(80)
            now = self.panes()
            if now and now == before and all(now):
                return
            before = now
        pytest.fail("the panes do not come to rest")


# The wall in three dimensions is drawn by an emulated card, the page itself without one
GRAPHICS = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
WITHOUT_CARD = "--disable-gpu-compositing"
SIZE = {"width": 1280, "height": 800}
EMPTY = '<link rel="icon" href="data:,">'
"""A page that asks for nothing, not even for an icon."""
IDLE: list[Any] = []
"""Pages that a test is done with: opening another address on one of them takes a third of the time of a new one."""


@contextmanager
def browser(*graphics: str) -> Iterator[Any]:
    """Start the browser; the test is skipped where there is none."""
    playwright = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
    with playwright.sync_playwright() as driver:
        started = launched(driver.chromium, *graphics)
        yield started
        IDLE.clear()
        started.close()


def launched(kind: Any, *graphics: str) -> Any:
    """Start a browser of a kind of Playwright's, of which one thread can have only one."""
    path = shutil.which("chromium") or shutil.which("chromium-browser")
    if path is None:
        pytest.skip("there is no Chromium on this machine")
    return kind.launch(executable_path=path, args=[*QUIET, *GRAPHICS, *graphics])


@contextmanager
def opened(
    started: Any, url: str, ready: str = "", viewport: dict[str, int] = SIZE, color_scheme: str = "light"
) -> Iterator[Watched]:
    """Open ``url``, and at the end see to it that nothing went wrong and nothing left the machine.

    It is open when there is what ``ready`` selects; without, when its panes are at rest.
    """
    idle = next((page for page in IDLE if page.context.browser == started), None)
    if idle is not None:
        IDLE.remove(idle)
    page = idle or started.new_context().new_page()
    page.set_viewport_size(viewport)
    page.emulate_media(media="null", color_scheme=color_scheme)
    watched = Watched(page)
    # OpenSeadragon warns of tiles that arrive after their layer was taken away, which is no fault
    watching = {
        "console": lambda m: watched.errors.append(m.text) if m.type == "error" else None,
        "pageerror": lambda error: watched.errors.append(str(error)),
        "request": lambda request: watched.asked.append(request.url),
    }
    for event, heard in watching.items():
        page.on(event, heard)
    page.goto(url)
    page.wait_for_selector(ready or ".pane[data-z-mm]")
    if not ready:
        watched.settle()
    yield watched
    assert watched.errors == [], "; ".join(watched.errors)
    server = url if url.startswith("file:") else "/".join(url.split("/")[:3]) + "/"
    here = ("data:", "blob:", server.split("?")[0])
    assert [one for one in watched.asked if not one.startswith(here)] == []
    for event, heard in watching.items():
        page.remove_listener(event, heard)
    leave(page, server)
    IDLE.append(page)


def leave(page: Any, server: str) -> None:
    """Have the page ask for no more: one of the same server costs nothing, a blank one does."""
    page.unroute_all()
    page.mouse.move(0, 0)  # nothing of the next page is to lie under it
    if server.startswith("file:"):
        page.goto("about:blank")
        return
    page.route("**/left", lambda route: route.fulfill(body=EMPTY, content_type="text/html"))
    page.goto(f"{server}left")
    page.unroute_all()


@contextmanager
def answered_last_first(page: Any, address: str) -> Iterator[Callable[[str], None]]:
    """Hold every question to this address until the block ends, then answer the last first.

    What it yields waits until a question with these words in it is held.
    """
    held = list[Any]()

    def wait_for(words: str) -> None:
        for _ in range(500):
            if held and words in (held[-1].request.post_data or ""):
                return
            page.wait_for_timeout(20)
        pytest.fail(f"nobody asks {address} for {words}")

    page.route(address, lambda route: held.append(route))
    yield wait_for
    assert len(held) > 1
    for route in reversed(held):
        with page.expect_response(address):
            route.continue_()
    page.unroute(address)
