"""How fast the page of a large panorama is, and what its server takes: ``python -m benchmarks.page``.

Makes a panorama of 3 000 × 14 000 samples with relief (or takes one: ``--panorama``), serves it by ``endoct serve`` in
a process of its own, and looks at it in Chromium at 1280 × 800: the first view of a new server, the same view again,
after a zoom to half of the wall, after one to single samples, after a step aside, with the cylinder. A view is there
when the last thing that it asked for has arrived. Every step is done ``--times``, with a new server and browser each.
"""

import argparse
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage

from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import save_panorama

ENDOCT = Path(sys.executable).with_name("endoct")
QUIET_S = 1.0
"""Without an answer for so long, a view is there."""
QUIET_FLAGS = "--no-sandbox", "--disable-background-networking"
PANES_FLAGS = (*QUIET_FLAGS, "--disable-gpu")
"""Panes need no graphics card, and one that is emulated is slower than none."""
CYLINDER_FLAGS = (*QUIET_FLAGS, "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
Row = dict[str, float]


def large_panorama(n_z: int, n_theta: int) -> Panorama:
    """Return a wall with cells and speckle, drawn by a fixed seed."""
    rng = np.random.default_rng(0)
    coarse = ndimage.gaussian_filter(rng.normal(size=(n_z // 10, n_theta // 50)), 3, mode=("nearest", "wrap"))
    relief_mm = np.where(coarse > np.quantile(coarse, 0.8), 0.3, 0.0) + 0.02 * coarse / coarse.std()
    depth_mm = ndimage.zoom(relief_mm, (n_z / relief_mm.shape[0], n_theta / relief_mm.shape[1]), order=1)
    depth_mm = depth_mm.astype(np.float32) + rng.normal(0, 0.003, depth_mm.shape).astype(np.float32)
    speckle = rng.exponential(1.0, depth_mm.shape).astype(np.float32)
    return Panorama(
        grid=SurfaceGrid(
            n_z, n_theta, z0_mm=0.0, dz_mm=0.01, theta0_rad=0.0, dtheta_rad=2 * np.pi / n_theta, radius_mm=1.25
        ),
        intensity=(120 - 60 * (depth_mm > 0.15) + 10 * np.log(speckle + 1e-3)).astype(np.float32),
        depth_mm=depth_mm,
        valid=np.ones(depth_mm.shape, np.bool_),
        weight=np.ones(depth_mm.shape, np.float32),
        modality="oct",
        handedness_known=True,
        travel_known=True,
    )


class Net:
    """What a page was sent: when, how much."""

    def __init__(self, page: Any) -> None:
        self.answers: list[tuple[float, float]] = []
        self._asked: set[str] = set()
        session = page.context.new_cdp_session(page)
        session.send("Network.enable")
        session.on("Network.requestWillBeSent", lambda event: self._asked.add(event["requestId"]))
        session.on("Network.loadingFailed", lambda event: self._asked.discard(event["requestId"]))
        session.on("Network.loadingFinished", self._finished)

    def _finished(self, event: dict[str, Any]) -> None:
        self._asked.discard(event["requestId"])
        self.answers.append((time.monotonic(), event["encodedDataLength"]))

    def after(self, page: Any, start: float) -> Row:
        """Wait until nothing is asked for any more; return seconds, megabytes and requests since ``start``."""
        acted = time.monotonic()
        while self._asked or time.monotonic() - max([acted, *(at for at, _ in self.answers)]) < QUIET_S:
            page.wait_for_timeout(50)
        since = [(at, size) for at, size in self.answers if at >= start]
        last = max([at for at, _ in since], default=start)
        return {"s": last - start, "MB": sum(size for _, size in since) / 1e6, "requests": len(since)}


def memory_mb(pid: int) -> Row:
    """Return what a process holds in memory, and its own share with what it has in common with others, in MB."""
    rollup = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii")
    found = {name: int(kb) / 1e3 for name, kb in re.findall(r"^(\w+):\s+(\d+) kB", rollup, re.MULTILINE)}
    return {"resident MB": found["Rss"], "own MB": found["Private_Dirty"]}


def wheel(page: Any, notches: int) -> None:
    """Turn the wheel over the middle of the first pane."""
    box = page.locator(".view").first.bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    for _ in range(notches):
        page.mouse.wheel(0, -100)
        page.wait_for_timeout(30)


Steps = dict[str, Callable[[Any, str], object]]
PANES: Steps = {
    "first view": lambda page, url: page.goto(url),
    "the same again": lambda page, _: page.reload(),
    "zoom in, 8 times": lambda page, _: wheel(page, 9),
    "zoom to single samples": lambda page, _: wheel(page, 12),
    "a step aside": lambda page, _: page.keyboard.press("ArrowRight"),
}
CYLINDER: Steps = {
    "first view, with a graphics card emulated": lambda page, url: page.goto(url),
    "cylinder": lambda page, _: page.get_by_role("button", name="3-D").click(),
}


def look(store: Path) -> dict[str, Row]:
    """Return what every step took, with a new server and a new browser."""
    from playwright.sync_api import sync_playwright

    server = subprocess.Popen([ENDOCT, "serve", store, "--port", "0"], stdout=subprocess.PIPE, text=True)
    try:
        assert server.stdout is not None
        url = next(found[0] for line in server.stdout if (found := re.search(r"http://\S+", line)))
        rows: dict[str, Row] = {"server started": memory_mb(server.pid)}
        with sync_playwright() as driver:
            for flags, steps in ((PANES_FLAGS, PANES), (CYLINDER_FLAGS, CYLINDER)):
                browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=flags)
                page = browser.new_page(viewport={"width": 1280, "height": 800})
                net = Net(page)
                for name, act in steps.items():
                    start = time.monotonic()
                    act(page, url)
                    rows[name] = {**net.after(page, start), **memory_mb(server.pid)}
                browser.close()
        return rows
    finally:
        server.terminate()
        server.wait()


def main() -> None:
    """Look, and print the medians."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--panorama", type=Path)
    parser.add_argument("--rows", type=int, default=3000)
    parser.add_argument("--columns", type=int, default=14_000)
    parser.add_argument("--times", type=int, default=3)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        store = options.panorama or Path(folder) / "large.zarr"
        if options.panorama is None:
            save_panorama(large_panorama(options.rows, options.columns), store)
        runs = [look(store) for _ in range(options.times)]
    columns = ("s", "MB", "requests", "resident MB", "own MB")
    print(f"| | {' | '.join(columns)} |\n|---|{'---|' * len(columns)}")
    for name in runs[0]:
        known = [[run[name][one] for run in runs] if one in runs[0][name] else [] for one in columns]
        cells = [f"{statistics.median(values):.3g}" if values else "" for values in known]
        print(f"| {name} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
