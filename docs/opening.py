"""Record the way from two bare folders to a verdict without a terminal: python docs/opening.py.

Writes docs/open.webp and docs/open.png, and prints how long it took. Needs Chromium.
"""

import os
import re
import shutil
import subprocess
import tempfile
import time
import tomllib
from pathlib import Path
from typing import Any

from recording import ENDOCT, FRAME_MS, PAGE_SIZE, QUALITY, Recorder

from endoct.workbench import simulate

DOCS = Path(__file__).parent
LONG_MS = 300_000
KEYS = ("bore_diameter_mm", "feed_pitch_mm", "axial_pixel_mm", "pullback_pitch_mm", "capillary_outer_diameter_mm")


def main() -> None:
    """Record, and write both files."""
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as name, sync_playwright() as driver:
        study = Path(name) / "study"
        known = {}
        for number in (1, 2):
            simulate(study / f"bore-{number}", preset="quick", seed=1005 + number)
        for side in ("endoscope", "oct"):
            sidecar = study / "bore-1" / side / "acquisition.toml"
            known[side] = {key: str(value) for key, value in tomllib.loads(sidecar.read_text()).items() if key in KEYS}
            sidecar.unlink()
        environment = os.environ | {"XDG_STATE_HOME": str(Path(name) / "state")}
        command = [ENDOCT, "open", study, "--port", "0", "--no-browser"]
        server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": PAGE_SIZE[0], "height": PAGE_SIZE[1]}, color_scheme="light")
        try:
            address = next(found[0] for line in server.stdout or () if (found := re.search(r"http://\S+", line)))
            begun = time.monotonic()
            page.goto(address)
            recorder = Recorder(page)
            for side, keys in known.items():
                describe(recorder, f"bore-1/{side}", keys)
            compare(recorder)
            print(f"from two bare folders to a verdict: {(time.monotonic() - begun) / 60:.1f} min")  # noqa: T201
        finally:
            browser.close()
            server.terminate()
            server.wait()
    first, *others = recorder.frames
    first.save(
        DOCS / "open.webp", save_all=True, append_images=others, duration=FRAME_MS, quality=QUALITY, method=6, loop=0
    )


def describe(recorder: Recorder, name: str, keys: dict[str, str]) -> None:
    """Fill in what a recording lacks, and save."""
    page = recorder.page
    row = f".inputs tr[data-name='{name}']"
    page.wait_for_selector(f"{row} img", timeout=LONG_MS)
    page.wait_for_timeout(1500)
    recorder.keep(4)
    press(recorder, f"{row} a:has-text('describe it')")
    page.wait_for_selector("figure canvas", timeout=LONG_MS)
    recorder.keep(4)
    for key, value in keys.items():
        press(recorder, f"#key-{key}")
        page.fill(f"#key-{key}", value)
        recorder.keep(2)
    page.wait_for_selector("figcaption .legend", timeout=LONG_MS)
    page.wait_for_timeout(500)
    recorder.keep(8)
    press(recorder, "button:text('Save')")
    page.locator("[role=status]", has_text="It is saved").wait_for(timeout=LONG_MS)
    recorder.keep(4)
    press(recorder, ".above")


def compare(recorder: Recorder) -> None:
    """Compare the two, see it under way, and open the result."""
    page = recorder.page
    button = ".inputs tr[data-name='bore-1/oct'] button:has-text('compare')"
    page.wait_for_selector(button, timeout=LONG_MS)
    page.wait_for_timeout(1500)
    recorder.keep(4)
    press(recorder, button)
    page.locator("dialog .command", has_text="endoct compare").wait_for()
    recorder.keep(6)
    press(recorder, "dialog >> text=Run")
    page.wait_for_selector(".queue li.running progress", timeout=LONG_MS)
    press(recorder, "text=compare all")
    page.screenshot(path=DOCS / "open.png")
    result = ".results tr[data-name='results/bore-1'] a"
    while not page.locator(result).count():
        page.wait_for_timeout(1500)
        recorder.keep()
    page.wait_for_timeout(800)
    page.screenshot(path=DOCS / "open.png")
    recorder.keep(6)
    press(recorder, result)
    page.wait_for_selector(".pane[data-z-mm]", timeout=LONG_MS)
    page.wait_for_timeout(1500)
    recorder.keep(16)


def press(recorder: Recorder, selector: str) -> Any:
    """Move to an element, and click it."""
    recorder.page.locator(selector).first.scroll_into_view_if_needed()
    recorder.move(*recorder.middle(selector))
    recorder.page.locator(selector).first.click()


if __name__ == "__main__":
    main()
