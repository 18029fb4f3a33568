"""The page as people look at it, on three screens, light and dark: nothing is cut off, and nothing misleads."""

import csv
import io
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mock_comparison import GRID
from page_browser import Watched, opened
from PIL import Image
from workbench_page import Served, application, serving, written

from endoct.base.doubt import Doubt
from endoct.fusion.files.masks import DRAWN_STORE, save_drawings
from endoct.fusion.files.store import PROPERTIES, read_outline, write_cells
from endoct.fusion.scoring.raters import Drawing
from endoct.workbench.report.figures.drawing import DEPTH_COLOURS, HATCH, NOT_OBSERVED
from endoct.workbench.report.figures.frames import STYLES

SCREENS = {"desk": (1280, 800), "tablet": (1024, 768), "phone": (390, 844)}
FRONTEND = Path(__file__).parents[3] / "workbench" / "page" / "frontend" / "src"


@pytest.fixture(params=SCREENS)
def screen(request: pytest.FixtureRequest) -> dict[str, int]:
    return dict(zip(("width", "height"), SCREENS[request.param], strict=True))


@pytest.fixture
def page(chromium: Any, served: Served) -> Iterator[Watched]:
    with opened(chromium, served.url) as watched:
        yield watched


def test_every_page_says_what_it_is_and_where_its_content_lies(comparison: Path) -> None:
    with application(comparison) as page, application(comparison.parent) as collection:
        pages = [page.get("/manual/how-to/export.md"), collection.get("/")]
        assert "<main" not in page.get("/")[1].decode()  # its program makes it, as the test below says
    for status, data, _ in pages:
        html = data.decode()
        assert status == 200
        assert '<html lang="en">' in html
        assert re.search(r"<title>[^<]+</title>", html)
        assert len(re.findall(r"<main[ >]", html)) == len(re.findall(r"<h1[ >]", html)) == 1


def test_every_control_has_a_name_in_words(page: Watched) -> None:
    page.page.keyboard.press("d")
    page.page.wait_for_selector(".masks:not([hidden])")
    nameless = page.page.evaluate(
        """() => [...document.querySelectorAll("button, select, textarea, input:not([type=hidden])")].filter((one) => {
          const said = one.getAttribute("aria-label") ?? one.labels?.[0]?.textContent ?? one.textContent;
          return !/[\\p{L}\\p{N}]/u.test(said);
        }).map((one) => one.outerHTML)"""
    )
    assert nameless == []
    assert (page.page.locator("main").count(), page.page.locator("h1").count()) == (1, 1)
    assert page.page.get_by_role("button", name="contrast and colours as at first").count() == 2


@pytest.fixture(scope="module")
def with_truth(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A comparison with a truth that has a cell around θ = 115° only; the sides' other cells are wrong."""
    folder = written(tmp_path_factory.mktemp("judged") / "with-truth")
    theta, z_mm = np.meshgrid(GRID.theta_rad, GRID.z_mm)
    cell = np.hypot(1.25 * (theta - 2.0), z_mm - 1.5) < 0.5
    save_drawings([Drawing("truth", "1", cell, np.ones(GRID.shape, np.bool_))], GRID, folder / DRAWN_STORE)
    return folder


def pixels(watched: Watched, of: str, k: int = 0) -> np.ndarray:
    """Return a screenshot of an element, int (rows, columns, 3)."""
    png = watched.page.locator(of).nth(k).screenshot()
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


def luminance(colour: str) -> float:
    """Return the relative luminance of "#rrggbb", as WCAG 2 defines it."""
    parts = np.array([int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)])
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return float(linear @ (0.2126, 0.7152, 0.0722))


@pytest.mark.parametrize("scheme", [0, 1])
def test_texts_stand_out_from_what_they_lie_on(scheme: int) -> None:
    assert luminance("#ffffff") / luminance("#808080") == pytest.approx(1 / 0.2159, rel=1e-3)
    sheet = (FRONTEND / "page.css").read_text()
    colours = dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6})", re.findall(r":root \{(.*?)\}", sheet, re.DOTALL)[scheme]))
    pairs = [
        (text, ground) for text in ("ink", "soft", "accent", "good", "doubt", "bad") for ground in ("paper", "card")
    ]
    pairs += [(text, f"{text}-paper") for text in ("good", "doubt", "bad")] + [("ink", "press"), ("card", "accent")]
    for text, ground in pairs:
        dark, bright = sorted(luminance(colours[each]) for each in (text, ground))
        assert (bright + 0.05) / (dark + 0.05) >= 4.5, f"{text} on {ground}"
    # nothing takes from these: what is pale is switched off, and what is pressed is in ink
    for name in ("page.css", "desk.css"):
        pale = re.findall(r"([^{}]+)\{[^{}]*[^-]opacity: 0?\.\d", (FRONTEND / name).read_text())
        assert [rule.strip() for rule in pale] == ["button:disabled"] * (name == "page.css")
    assert re.search(r'button\[aria-pressed="true"\] \{ color: var\(--ink\); background: var\(--press\)', sheet)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_is_cut_off(chromium: Any, with_truth: Path, screen: dict[str, int], scheme: str):
    with serving(with_truth) as there, opened(chromium, there.url, viewport=screen, color_scheme=scheme) as page:
        box = page.page.locator(".view").first.bounding_box()
        page.page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        page.page.wait_for_selector(".drawer figure")
        assert page.page.evaluate("() => document.documentElement.scrollWidth") <= screen["width"]
        for part in (
            ".cells .scroll",
            ".pane > header",
            ".pane > footer",
            ".bar",
            ".scores",
            ".verdict",
            ".drawer > header",
        ):
            wide = page.page.locator(part).evaluate_all("all => all.map(one => one.scrollWidth - one.clientWidth)")
            assert wide, part
            assert max(wide) <= 0, part
        cut = page.page.locator(".pane select").evaluate_all(
            """all => all.filter(one => {
                const drawing = document.createElement("canvas").getContext("2d");
                drawing.font = getComputedStyle(one).font;
                return drawing.measureText(one.selectedOptions[0].text).width + 20 > one.clientWidth;
            }).map(one => `${one.selectedOptions[0].text} in ${one.clientWidth} px`)"""
        )
        assert cut == []


def test_six_panes_have_their_buttons_and_names(page: Watched):
    add = page.page.get_by_role("button", name="+ pane")
    while add.is_enabled():
        add.click()
    page.settle()
    heights = {round(box["y"]) for box in (one.bounding_box() for one in page.page.locator(".pane .close").all())}
    assert len(heights) == 1
    for pane in page.page.locator(".pane").all():
        outer, close = pane.bounding_box(), pane.locator(".close").bounding_box()
        assert close["x"] + close["width"] <= outer["x"] + outer["width"]


def test_the_answer_comes_before_its_numbers_and_doubts_before_both(chromium: Any, tmp_path: Path):
    doubts = (Doubt("odd", "Something is odd."),)
    with serving(written(tmp_path / "doubted", doubts=doubts)) as there, opened(chromium, there.url) as page:
        verdict = page.page.locator(".verdict")
        assert verdict.locator("strong").inner_text().startswith("1 doubt. Aligned. Jaccard 0.")
        assert "confidence" not in verdict.locator("strong").inner_text()
        tops = [page.page.locator(part).first.bounding_box()["y"] for part in (".verdict", ".scores", ".panes")]
        assert tops == sorted(tops)
        titles = page.page.locator(".scores li > span").all_inner_texts()
        assert len(set(titles)) == len(titles)


def test_one_turn_is_marked_and_its_copies_are_dimmed(page: Watched):
    for _ in range(3):
        page.page.keyboard.press("-")
    page.settle()
    view = pixels(page, ".view")
    turn_px = 2 * np.pi * 1.25 / page.panes()[0]["mmPerPx"]
    middle = view.shape[1] // 2
    row = view[view.shape[0] // 2 - 8 : view.shape[0] // 2 + 8]
    left = round(middle - turn_px / 2)
    assert left > 20, "there are copies"
    marked, copy = row[:, middle - 30 : middle + 30], row[:, 2 : left - 4]
    assert copy.mean() > marked.mean() + 20  # paler, on paper
    assert copy.std() < marked.std() / 2


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axes_have_the_ink_of_the_page_and_lie_outside(chromium: Any, served: Served, scheme: str):
    with opened(chromium, served.url, color_scheme=scheme) as page:
        view, plot = (page.page.locator(one).first.bounding_box() for one in (".view", ".plot"))
        assert view["x"] >= plot["x"] + 30
        assert view["y"] >= plot["y"] + 15
        strip = pixels(page, ".plot")[:16, 40:].mean(axis=2)
        paper = np.median(strip)
        assert (paper < 60) == (scheme == "dark")
        assert np.abs(strip - paper).max() > 120  # numbers can be read


def test_beyond_the_ends_of_the_wall_nothing_is_hatched(page: Watched):
    assert np.ptp(pixels(page, ".view")[3:8, 3:-3], axis=(0, 1)).max() == 0


def test_a_frame_of_another_place_says_so(page: Watched):
    box = page.page.locator(".view").nth(1).bounding_box()
    page.page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2 + 1.0 / page.panes()[0]["mmPerPx"])
    page.page.wait_for_selector(".drawer figure")
    texts = page.page.locator(".drawer figcaption").all_inner_texts()
    assert all("slice 7, z = 1.40 mm: B-scan" in text for text in texts)
    assert all(re.search(r"not the marked place: 1\.\d\d mm farther out", text) for text in texts)
    page.page.mouse.move(5, 5)
    said = page.page.locator(".drawer .said").inner_text()
    assert re.search(r"oct: slice 7 of 0–14, 1\.\d\d mm farther out", said)
    for _ in range(5):  # slices, from 2.4 to 1.4 mm
        page.page.keyboard.press("ArrowUp")
    assert page.page.locator(".drawer .away").first.inner_text() == ""


def test_a_click_that_takes_long_is_one(page: Watched):
    box = page.page.locator(".view").nth(1).bounding_box()
    page.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.page.mouse.down()
    page.page.wait_for_timeout(700)
    page.page.mouse.up()
    page.page.wait_for_selector(".drawer figure")


def test_what_only_one_side_has_is_right_or_wrong_by_the_truth(chromium: Any, with_truth: Path):
    with serving(with_truth) as there, opened(chromium, there.url) as page:
        rows = page.page.locator(".cells tbody tr").all_inner_texts()
        assert sorted(text.rstrip()[-1] for text in rows) == ["✓", "✓", "✗", "✗"]
        legend = page.page.locator(".cells .legend").inner_text()
        assert "= same cell there (overlap)" in legend
        assert "✓ ✗ the truth has a cell, has none" in legend
        page.page.locator(".cells tbody tr").first.click()
        assert "the truth has no cell there" in page.page.locator(".about").inner_text()


def test_the_cells_that_are_listed_are_saved_as_csv(page: Watched, comparison: Path, tmp_path: Path):
    page.page.locator(".cells select").select_option("of oct")
    with page.page.expect_download() as download:
        page.page.get_by_role("button", name="CSV").click()
    assert download.value.suggested_filename == "cells.csv"
    download.value.save_as(tmp_path / "saved.csv")
    cells = [cell for cell in read_outline(comparison / "comparison.zarr").cells if cell.side == "oct"]
    write_cells(cells, tmp_path / "cells.csv")
    saved, ours = (
        list(csv.DictReader(io.StringIO((tmp_path / name).read_text("utf-8")))) for name in ("saved.csv", "cells.csv")
    )
    assert len(saved) == len(ours) == 2
    for one, other in zip(saved, ours, strict=True):
        assert list(one)[: len(PROPERTIES)] == list(PROPERTIES)
        for name in PROPERTIES:
            assert one[name] == other[name] or float(one[name]) == pytest.approx(float(other[name]), rel=1e-5), name


def test_lines_have_the_colours_of_the_figures():
    source = (FRONTEND / "frame_picture.ts").read_text("utf-8")
    colours = re.findall(r"#[0-9a-f]{6}", re.search(r"const COLOURS = \[(.*?)\]", source)[1])
    assert colours == [colour.lower() for _, colour, _ in STYLES]


def test_what_was_not_observed_has_the_colours_of_the_figures():
    style, raster = ((FRONTEND / name).read_text("utf-8") for name in ("page.css", "raster.ts"))
    assert f"--void: {NOT_OBSERVED}; --void-line: {HATCH};" in style
    assert NOT_OBSERVED in raster
    assert HATCH in raster


def test_depth_has_the_colours_of_the_figures():
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    source = (FRONTEND / "colour_maps.ts").read_text("utf-8")
    text = "".join(
        re.findall(r'"([0-9a-f]+)"', re.search(rf"  {DEPTH_COLOURS}:\n(.*?),\n  \w+:", source, re.DOTALL)[1])
    )
    colours = [f"#{text[k : k + 6]}" for k in range(0, len(text), 6)]
    assert colours == [to_hex(colour) for colour in colormaps[DEPTH_COLOURS](np.linspace(0, 1, len(colours)))]
    assert f'layer.unit === "mm" ? "{DEPTH_COLOURS}"' in (FRONTEND / "colouring.ts").read_text("utf-8")
