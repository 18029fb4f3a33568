"""Make the pictures of the README and the tutorials again: python docs/pictures.py [--recordings FOLDER].

Needs Chromium for the picture of the report, and for that of the real pullback the folder of real recordings.
"""

import argparse
import shutil
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import xarray
from PIL import Image

from endoct.workbench import compare, pose, simulate, unroll
from endoct.workbench.page.opening import open_shown

DOCS = Path(__file__).parent
FIGURES = DOCS / "figures"
COLOURS = 256
PAGE_SIZE = 1440, 900
CELL_DEG, CELL_Z_MM = 213, 5.22
"""A deep cell in a slice of which there is a picture."""


def main() -> None:
    """Write every picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", type=Path)
    recordings = parser.parse_args().recordings
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        first_comparison(folder)
        report(folder)
        pose_in_ct(folder)
        if recordings:
            real_pullback(recordings, folder)


def first_comparison(folder: Path) -> None:
    """Write the pictures of the first tutorial."""
    simulate(folder / "specimen", preset="learning", seed=3)
    compare(folder / "specimen" / "endoscope", folder / "specimen" / "oct", folder / "result")
    for name in ("panoramas", "masks", "frames-oct"):
        picture = Image.open(folder / "result" / "figures" / f"{name}.png")
        save(picture, FIGURES / f"tutorial_{name.replace('-', '_')}.png", width=1100 if name == "frames-oct" else 1400)


def report(folder: Path) -> None:
    """Write the picture of a report, with a deep cell chosen and its frames shown."""
    from playwright.sync_api import sync_playwright

    specimen, result, picture = folder / "quick", folder / "quick-result", folder / "page.png"
    simulate(specimen, preset="quick", seed=1006)
    compare(specimen / "endoscope", specimen / "oct", result)
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        shown = browser.new_page(viewport={"width": PAGE_SIZE[0], "height": PAGE_SIZE[1]})
        shown.goto((result / "report.html").as_uri())
        shown.wait_for_selector(".pane[data-z-mm]")
        pane = shown.locator(".pane").first
        pane.locator("header select").nth(1).select_option("swipe")
        pane.locator("header select").nth(2).select_option(open_shown(result).description.panes[1])
        shown.wait_for_timeout(1000)
        box = shown.locator(".view").nth(1).bounding_box()
        now = shown.locator(".pane").nth(1).evaluate("pane => ({...pane.dataset})")
        along_px = (CELL_Z_MM - float(now["zMm"])) / float(now["mmPerPx"])
        shown.mouse.click(box["x"] + CELL_DEG / 360 * box["width"], box["y"] + box["height"] / 2 + along_px)
        shown.wait_for_selector(".drawer figure")
        shown.wait_for_timeout(2000)
        shown.screenshot(path=picture)
        browser.close()
    save(Image.open(picture), DOCS / "page.png", width=PAGE_SIZE[0])


def pose_in_ct(folder: Path) -> None:
    """Write the picture of the tutorial on a bore in a CT."""
    case, found = folder / "case", folder / "pose"
    simulate(case, preset="small-patient", seed=7, ct=True, vary={"ct.voxel_mm": (0.3, 0.3)})
    pose(
        [case / "oct", case / "endoscope"],
        case / "truth" / "ct.nii.gz",
        found,
        plan=case / "plan.mrk.json",
        labels=case / "truth" / "ct_labels.nii.gz",
    )
    save(Image.open(found / "figures" / "cut.png"), FIGURES / "tutorial_pose.png", width=1400)


def real_pullback(recordings: Path, folder: Path) -> None:
    """Write the picture of the second tutorial."""
    unroll(recordings / "coronary-oct", folder / "wall.zarr", settings={"bore_diameter_mm": 2.2})
    wall = xarray.open_zarr(folder / "wall.zarr").load()
    figure, axes = plt.subplots(figsize=(7, 6))
    wall["depth_mm"].where(wall["valid"]).plot(ax=axes, yincrease=False, robust=True, cmap="magma_r")
    axes.set(title="Wall radius − nominal radius, mm", xlabel="θ, rad", ylabel="z, mm")
    figure.savefig(folder / "wall.png", dpi=120)
    picture = Image.open(folder / "wall.png")
    save(picture, FIGURES / "tutorial_pullback.png", width=picture.width)


def save(picture: Image.Image, path: Path, *, width: int) -> None:
    """Write ``picture`` with few colours, at most ``width`` pixels wide."""
    width = min(width, picture.width)
    size = width, round(picture.height * width / picture.width)
    small = picture.convert("RGB").resize(size, Image.Resampling.LANCZOS)
    few = small.quantize(COLOURS, method=Image.Quantize.MAXCOVERAGE, kmeans=2, dither=Image.Dither.NONE)
    few.save(path, optimize=True)


if __name__ == "__main__":
    main()
