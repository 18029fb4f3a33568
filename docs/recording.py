"""Make the recording of the page in use that stands in the README: python docs/recording.py [--result FOLDER].

Drives the page of a comparison in Chromium, of a simulated specimen unless one is given, and takes a picture at
every step.
"""

import argparse
import io
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from PIL import Image

from endoct.workbench import compare, simulate

ENDOCT = Path(sys.executable).with_name("endoct")
RECORDING = Path(__file__).parent / "page.webp"
PAGE_SIZE = 1280, 800
SIZE = 960, 600
FRAME_MS = 110
QUALITY = 55
MOST_BYTES = 2_000_000
FLAGS = "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"
READ = "() => { const said = document.querySelector('.drawer .said').textContent; return !/reading/.test(said); }"
POINTER = """([x, y]) => {
  let dot = document.getElementById('pointer');
  if (!dot) {
    dot = document.createElementNS('http://www.w3.org/2000/svg', 'svg');
    dot.id = 'pointer';
    const arrow = document.createElementNS('http://www.w3.org/2000/svg', 'path');
    arrow.setAttribute('d', 'M1 1 L1 19 L6 14.5 L9.5 22 L12.5 20.5 L9 13.5 L16 13.5 Z');
    arrow.setAttribute('fill', '#fff');
    arrow.setAttribute('stroke', '#000');
    dot.append(arrow);
    Object.assign(dot.style, {position: 'fixed', width: '20px', height: '26px', zIndex: 99, pointerEvents: 'none'});
    document.body.append(dot);
  }
  dot.style.left = `${x}px`;
  dot.style.top = `${y}px`;
}"""


class Recorder:
    """Moves the pointer over a page, and keeps a picture of every step."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.frames: list[Image.Image] = []
        self.at = PAGE_SIZE[0] / 2, PAGE_SIZE[1] / 2

    def keep(self, count: int = 1) -> None:
        """Keep what the page shows, for ``count`` frames."""
        self.page.wait_for_timeout(60)
        picture = Image.open(io.BytesIO(self.page.screenshot())).convert("RGB")
        self.frames += [picture.resize(SIZE, Image.Resampling.LANCZOS)] * count

    def move(self, x: float, y: float, steps: int = 4) -> None:
        """Move the pointer there."""
        (from_x, from_y), self.at = self.at, (x, y)
        for k in range(1, steps + 1):
            here = from_x + (x - from_x) * k / steps, from_y + (y - from_y) * k / steps
            self.page.mouse.move(*here)
            self.page.evaluate(POINTER, here)
            self.keep()

    def drag(self, x: float, y: float, steps: int) -> None:
        """Move it there with the button held."""
        self.page.mouse.down()
        self.move(x, y, steps)
        self.page.mouse.up()

    def click(self) -> None:
        """Click where it is."""
        self.page.mouse.click(*self.at)

    def wheel(self, by: int, notches: int) -> None:
        """Turn the wheel."""
        for _ in range(notches):
            self.page.mouse.wheel(0, by)
            self.keep()

    def middle(self, selector: str, x: float = 0.5, y: float = 0.5) -> tuple[float, float]:
        """Return a place in the element that ``selector`` selects, by shares of its width and height."""
        box = self.page.locator(selector).first.bounding_box()
        return box["x"] + x * box["width"], box["y"] + y * box["height"]


def use(page: Any) -> list[Image.Image]:
    """Zoom, swipe, ask for the frames at a place, and turn the cylinder."""
    recorder = Recorder(page)
    recorder.keep(6)
    recorder.move(*recorder.middle(".pane:nth-child(1) .view", 0.62, 0.5))
    recorder.wheel(-100, 6)
    recorder.keep(5)
    header = page.locator(".pane").first.locator("header")
    header.locator("select").nth(1).select_option("swipe")
    header.locator("select").nth(2).select_option("oct-relief")
    page.wait_for_timeout(800)
    recorder.keep(3)
    recorder.move(*recorder.middle(".pane:nth-child(1) .handle", y=0.6))
    recorder.drag(*recorder.middle(".pane:nth-child(1) .view", 0.08, 0.6), steps=7)
    recorder.drag(*recorder.middle(".pane:nth-child(1) .view", 0.92, 0.6), steps=12)
    recorder.keep(3)
    recorder.move(*recorder.middle(".pane:nth-child(2) .view", 0.5, 0.75))
    recorder.click()
    page.wait_for_selector(".drawer figure")
    recorder.keep(3)
    for what in ("every frame of endoscope", "every slice of oct"):
        page.locator(f"button:text('{what}')").click()
    page.wait_for_function(READ, timeout=300_000)
    page.wait_for_timeout(1500)
    recorder.keep(8)
    for _ in range(5):
        page.keyboard.press("ArrowUp")
        page.wait_for_timeout(1200)
        recorder.keep(3)
    page.keyboard.press("Escape")
    recorder.move(*recorder.middle("button:text('3-D')"))
    recorder.click()
    page.wait_for_selector(".cylinder[data-filled]")
    page.wait_for_timeout(2500)
    recorder.keep(5)
    recorder.move(*recorder.middle(".cylinder .view", 0.3))
    recorder.drag(*recorder.middle(".cylinder .view", 0.75, 0.4), steps=14)
    recorder.keep(8)
    return recorder.frames


def main() -> None:
    """Record, and write the file."""
    from playwright.sync_api import sync_playwright

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--result", type=Path)
    given: Path | None = parser.parse_args().result
    with tempfile.TemporaryDirectory() as name, sync_playwright() as driver:
        result = given or Path(name) / "specimen-1006"
        if given is None:
            specimen = Path(name) / "specimen"
            simulate(specimen, preset="quick", seed=1006)
            compare(specimen / "endoscope", specimen / "oct", result)
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        page = browser.new_page(viewport={"width": PAGE_SIZE[0], "height": PAGE_SIZE[1]}, color_scheme="light")
        server = subprocess.Popen([ENDOCT, "serve", result, "--port", "0"], stdout=subprocess.PIPE, text=True)
        try:
            page.goto(next(found[0] for line in server.stdout or () if (found := re.search(r"http://\S+", line))))
            page.wait_for_selector(".pane[data-z-mm]")
            page.wait_for_timeout(1500)
            first, *others = use(page)
        finally:
            browser.close()
            server.terminate()
            server.wait()
    first.save(RECORDING, save_all=True, append_images=others, duration=FRAME_MS, loop=0, quality=QUALITY, method=6)
    if (size := RECORDING.stat().st_size) > MOST_BYTES:
        raise SystemExit(f"{RECORDING} is too large: {size / 1e6:.2f} MB, {MOST_BYTES / 1e6:g} MB at most")


if __name__ == "__main__":
    main()
