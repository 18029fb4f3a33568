"""A browser for tests: the Chromium that is installed, watched for errors and for requests that leave the machine."""

import shutil
from collections.abc import Iterator
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


SOFTWARE_WEBGL = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


@contextmanager
def browser(graphics: tuple[str, ...] = ("--disable-gpu",)) -> Iterator[Any]:
    """Start the browser; the test is skipped where there is none."""
    path = shutil.which("chromium") or shutil.which("chromium-browser")
    if path is None:
        pytest.skip("there is no Chromium on this machine")
    playwright = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
    with playwright.sync_playwright() as driver:
        started = driver.chromium.launch(executable_path=path, args=[*QUIET, *graphics])
        yield started
        started.close()


@contextmanager
def opened(started: Any, url: str, ready: str = "", **context: Any) -> Iterator[Watched]:
    """Open ``url``, and at the end see to it that nothing went wrong and nothing left the machine.

    It is open when there is what ``ready`` selects; without, when its panes are at rest.
    """
    made = started.new_context(**{"viewport": {"width": 1280, "height": 800}, **context})
    watched = Watched(made.new_page())
    # OpenSeadragon warns of tiles that arrive after their layer was taken away, which is no fault
    watched.page.on("console", lambda m: watched.errors.append(m.text) if m.type == "error" else None)
    watched.page.on("pageerror", lambda error: watched.errors.append(str(error)))
    watched.page.on("request", lambda request: watched.asked.append(request.url))
    watched.page.goto(url)
    watched.page.wait_for_selector(ready or ".pane[data-z-mm]")
    if not ready:
        watched.settle()
    yield watched
    assert watched.errors == [], "; ".join(watched.errors)
    server = url if url.startswith("file:") else "/".join(url.split("/")[:3]) + "/"
    here = ("data:", "blob:", server.split("?")[0])
    assert [one for one in watched.asked if not one.startswith(here)] == []
    made.close()
