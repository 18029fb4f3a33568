"""The view saved as PNG, SVG and PDF: opened again, the files hold what was on the screen, as large as stated."""

import base64
import io
import re
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from page_browser import Watched, answered_last_first, opened
from PIL import Image
from workbench_page import Served, serving, written

from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import save_panorama
from endoct.workbench.page.opening import open_shown
from endoct.workbench.page.report import frozen_data, frozen_page

SVG = "{http://www.w3.org/2000/svg}"
HREF = "{http://www.w3.org/1999/xlink}href"
MARGIN_PX, AXES_PX, GAP_MM = 10, 36, 25.4 / 96
MODES = ("swipe", "opacity", "blink", "checker", "lens")


@pytest.fixture
def page(chromium: Any, served: Served) -> Iterator[Watched]:
    with opened(chromium, served.url) as watched:
        yield watched


def one_pane(watched: Watched, layer: str, mode: str = "single", second: str = "oct-relief") -> None:
    """Leave a single pane with these layers, a relief in colours that have no black."""
    while watched.page.locator(".close").count():
        watched.page.locator(".close").last.click()
    selects = watched.page.locator(".pane header select")
    selects.nth(0).select_option(layer)
    selects.nth(1).select_option(mode)
    if mode != "single":
        selects.nth(2).select_option(second)
    if "oct-relief" in (layer, second if mode != "single" else ""):
        watched.page.locator(".pane .bar select").last.select_option("viridis")
    watched.settle()


def ask(watched: Watched, kind: str, width_mm: float = 100, dpi: float = 200) -> Any:
    watched.page.get_by_role("button", name="save view").click()
    dialog = watched.page.locator("dialog.save")
    dialog.locator("select").select_option(kind)
    dialog.get_by_label("width in mm").fill(str(width_mm))
    dialog.get_by_label("dots per inch").fill(str(dpi))
    return dialog


def saved(watched: Watched, kind: str, path: Path, width_mm: float = 100, dpi: float = 200, caption: str = "") -> bytes:
    dialog = ask(watched, kind, width_mm, dpi)
    if caption:
        dialog.locator("textarea").fill(caption)
    with watched.page.expect_download() as download:
        dialog.get_by_role("button", name="save").click()
    assert download.value.suggested_filename.endswith(f".{kind.lower()}")
    download.value.save_as(path)
    watched.page.wait_for_selector("dialog.save", state="detached")
    return path.read_bytes()


def layers_of(svg: bytes) -> list[np.ndarray]:
    """Return the pictures of panes in the figure, int (rows, columns, 3); colour bars are pictures of a few rows."""
    found = []
    for one in ElementTree.fromstring(svg).iter(f"{SVG}image"):
        data = base64.b64decode(one.attrib[HREF].removeprefix("data:image/png;base64,"))
        found.append(np.asarray(Image.open(io.BytesIO(data)).convert("RGB")).astype(int))
    return [one for one in found if one.shape[0] > 20]


def is_coloured(part: np.ndarray) -> np.ndarray:
    """Say of every pixel whether it has a colour of viridis, and none of grey or of the hatching."""
    hatched = (part[..., 2] - part[..., 0] > 25) & (part[..., 2] > 180)  # viridis has no blue above 145
    return (np.ptp(part, axis=2) > 30) & ~hatched


def test_png_has_the_size_that_was_asked_for_and_says_so(page: Watched, tmp_path: Path):
    picture = Image.open(io.BytesIO(saved(page, "PNG", tmp_path / "view.png", width_mm=150, dpi=400)))
    assert picture.width == round(150 / 25.4 * 400)
    assert picture.info["dpi"] == pytest.approx((400, 400), abs=0.1)
    assert picture.info["Description"].startswith(
        "specimen-7: endoscope and oct. From left to right: endoscope: image;"
    )
    shown = np.asarray(picture.convert("RGB")).astype(int)
    third = shown.shape[1] // 3
    middle = shown[shown.shape[0] // 2 - 60 : shown.shape[0] // 2]
    coloured = [is_coloured(middle[:, k * third + 150 : (k + 1) * third - 60]).mean() for k in range(3)]
    assert coloured[0] < 0.3  # outlines only
    assert coloured[1] > 0.6  # cells lie in it, whose outlines have numbers


def test_a_finer_figure_has_finer_samples(chromium: Any, tmp_path: Path):
    grid = SurfaceGrid.full_circle(40, 2048, z0_mm=0.0, dz_mm=0.05, radius_mm=1.25)
    striped = np.broadcast_to(np.arange(2048) // 4 % 2, grid.shape).astype(np.float32)
    known = np.ones(grid.shape, np.bool_)
    panorama = Panorama(
        grid=grid, intensity=striped, depth_mm=None, valid=known, weight=known.astype(np.float32), modality="oct",
        handedness_known=True, travel_known=True, frame_dim="slice", per_frame={}, provenance={},
    )  # fmt: skip
    save_panorama(panorama, tmp_path / "striped.zarr")
    with serving(tmp_path / "striped.zarr") as striped_wall, opened(chromium, striped_wall.url) as page:
        spread, levels = [], []
        for width_mm, dpi in ((60, 60), (250, 300)):
            [shown] = layers_of(saved(page, "SVG", tmp_path / "v.svg", width_mm=width_mm, dpi=dpi))
            spread.append(shown[shown.shape[0] // 2, :, 0].std())
            asked = [re.search(r"/(\d+)/\d+_\d+\.png", one) for one in page.asked]
            levels.append(max(int(one[1]) for one in asked if one))
        assert levels == [2, 3]  # on the screen, and in the finer figure
        assert spread[0] < 30  # stripes of 15 µm are grey there
        assert spread[1] > 100


@pytest.mark.parametrize("mode", MODES)
def test_both_layers_are_in_the_figure_as_they_are_shown(page: Watched, tmp_path: Path, mode: str):
    one_pane(page, "endoscope-image", mode)
    box = page.page.locator(".view").bounding_box()
    if mode == "swipe":
        page.page.locator(".pane input[type=range]").fill("0.25")
    if mode == "opacity":
        page.page.locator(".pane input[type=range]").fill("0.6")
    page.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.settle()
    [shown] = layers_of(saved(page, "SVG", tmp_path / "view.svg"))
    rows, columns, _ = shown.shape
    per_px = columns / box["width"]
    coloured = is_coloured(shown)
    middle = coloured[rows // 2 - 4 : rows // 2 + 4]
    if mode == "swipe":
        assert not middle[:, : int(0.24 * columns)].any()
        assert middle[:, int(0.26 * columns) :].mean() > 0.9
    elif mode == "checker":
        assert 0.3 < middle.mean() < 0.7
    elif mode == "lens":
        reach = 90 * per_px
        assert middle[:, int(columns / 2 - 0.9 * reach) : int(columns / 2 + 0.9 * reach)].mean() > 0.9
        assert not middle[:, : int(columns / 2 - 1.1 * reach)].any()
    else:
        assert middle.mean() > 0.9
    if mode == "blink":
        page.page.keyboard.press("b")
        [first] = layers_of(saved(page, "SVG", tmp_path / "first.svg"))
        assert not is_coloured(first).any()
    if mode == "opacity":
        one_pane(page, "oct-relief")
        [alone] = layers_of(saved(page, "SVG", tmp_path / "alone.svg"))
        middles = [one[one.shape[0] // 2 - 4 : one.shape[0] // 2 + 4, 10:-10] for one in (shown, alone)]
        colours = [np.ptp(one, axis=2).mean() for one in middles]
        assert colours[0] == pytest.approx(0.6 * colours[1], rel=0.02)


def test_the_figure_is_the_picture_on_the_screen(page: Watched, tmp_path: Path):
    one_pane(page, "oct-relief", "swipe", "endoscope-image")
    page.page.get_by_role("button", name="oct", exact=True).click()
    page.page.get_by_role("button", name="endoscope", exact=True).click()
    page.page.keyboard.press("0")  # the wall fills the middle
    page.settle()
    page.page.wait_for_timeout(500)
    box = page.page.locator(".view").bounding_box()
    width_mm = (box["width"] + AXES_PX + 2 * MARGIN_PX) * GAP_MM
    [shown] = layers_of(saved(page, "SVG", tmp_path / "view.svg", width_mm=round(width_mm), dpi=96))
    screen = np.asarray(Image.open(io.BytesIO(page.page.locator(".view").screenshot())).convert("RGB")).astype(int)
    rows = min(screen.shape[0], shown.shape[0])
    inner = np.s_[rows // 2 - 60 : rows // 2 + 60 : 4, 60 : shown.shape[1] - 60 : 4]
    assert np.median(np.abs(screen[inner] - shown[inner])) <= 6


@pytest.mark.parametrize("width_mm", [80, 240])
def test_the_scale_bar_in_svg_is_as_long_as_it_says(page: Watched, tmp_path: Path, width_mm: float):
    root = ElementTree.fromstring(saved(page, "SVG", tmp_path / "view.svg", width_mm=width_mm))
    wide_px, tall_px = map(float, root.attrib["viewBox"].split()[2:])
    assert root.attrib["width"] == f"{width_mm}mm"
    assert float(root.attrib["height"].removesuffix("mm")) == pytest.approx(width_mm * tall_px / wide_px, abs=0.01)
    stated = [one.text for one in root.iter(f"{SVG}text") if re.fullmatch(r"[\d.]+ (mm|µm)", one.text or "")]
    length_mm = float(stated[0].split()[0]) * (1e-3 if "µm" in stated[0] else 1)
    bars = [
        one for one in root.iter(f"{SVG}path") if (one.attrib["stroke-width"], one.attrib["stroke"]) == ("3", "#111111")
    ]
    lengths = {
        round(float(end[0]) - float(start[0]), 2)
        for start, end in (
            re.findall(r"([\d.]+) ([\d.]+)", bar.attrib["d"]) for bar in bars if "Z" not in bar.attrib["d"]
        )
        if start[1] == end[1]
    }
    assert len(lengths) == 1
    assert lengths.pop() * page.panes()[0]["mmPerPx"] == pytest.approx(length_mm, rel=0.002)
    caption = root.find(f"{SVG}desc").text
    paper_mm = float(re.search(r"A millimetre of wall has ([\d.]+) mm here", caption)[1])
    assert paper_mm == pytest.approx(width_mm / wide_px / page.panes()[0]["mmPerPx"], rel=0.01)


def test_svg_has_lines_and_texts_as_such(page: Watched, tmp_path: Path):
    root = ElementTree.fromstring(saved(page, "SVG", tmp_path / "view.svg"))
    texts = {one.text for one in root.iter(f"{SVG}text")}
    assert {"endoscope: image", "oct: relief", "oct: relief, mm", "180°", "only oct"} <= texts
    strokes = {one.attrib["stroke"] for one in root.iter(f"{SVG}path")}
    assert {"#e69f00", "#0072b2"} <= strokes  # the outlines of either side


def objects_of(pdf: bytes) -> dict[int, tuple[bytes, bytes]]:
    """Return the objects of a PDF, each where the table at its end says: (entries, what its stream holds)."""
    start = int(re.search(rb"startxref\n(\d+)", pdf)[1])
    assert pdf[start:].startswith(b"xref")
    places = [int(one) for one in re.findall(rb"(\d{10}) 00000 n ", pdf[start:])]
    found = {}
    for number, place in enumerate(places, 1):
        assert pdf[place:].startswith(b"%d 0 obj" % number)
        entries = pdf[place : pdf.index(b"endobj", place)]
        content = b""
        if length := re.search(rb"/Length (\d+) >>\nstream\n", entries):
            begin = place + length.end()
            content = zlib.decompress(pdf[begin : begin + int(length[1])])
            assert pdf[begin + int(length[1]) :].startswith(b"\nendstream")
        found[number] = entries, content
    return found


def test_pdf_has_the_stated_size_and_both_layers(page: Watched, tmp_path: Path):
    one_pane(page, "endoscope-image", "swipe")
    pdf = saved(page, "PDF", tmp_path / "view.pdf", width_mm=120, dpi=300)
    objects = objects_of(pdf)
    wide, tall = (float(one) for one in re.search(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", pdf).groups())
    assert wide == pytest.approx(120 / 25.4 * 72, abs=0.01)
    drawn = objects[4][1].decode()
    scale = float(drawn.split()[0])
    pictures = []
    for number, (entries, content) in objects.items():
        if b"/DeviceRGB" in entries:
            columns, rows = (int(one) for one in re.search(rb"/Width (\d+) /Height (\d+)", entries).groups())
            pictures.append(np.frombuffer(content, np.uint8).reshape(rows, columns, 3).astype(int))
            assert set(objects[number + 1][1]) == {255}  # opaque
    layer = max(pictures, key=lambda one: one.size)
    placed = re.search(r"q ([\d.]+) 0 0 -([\d.]+) ([\d.]+) ([\d.]+) cm /I0 Do", drawn)
    inches = float(placed[1]) * scale / 72
    assert layer.shape[1] / inches == pytest.approx(300, rel=0.01)
    middle = is_coloured(layer)[layer.shape[0] // 2 - 4 : layer.shape[0] // 2 + 4]
    half = layer.shape[1] // 2
    assert not middle[:, : half - 5].any()
    assert middle[:, half + 5 :].mean() > 0.9
    texts = [bytes.fromhex(one).decode("cp1252") for one in re.findall(r"/F[01] [\d.]+ Tf <(\w+)> Tj", drawn)]
    assert "endoscope: image | oct: relief" in texts
    [stated] = {one for one in texts if re.fullmatch(r"[\d.]+ (mm|µm)", one)}
    length_mm = float(stated.split()[0]) * (1e-3 if "µm" in stated else 1)
    [bar] = re.findall(r"0.0667 RG 3 w \[\] 0 d ([\d.]+) ([\d.]+) m ([\d.]+) \2 l S", drawn)
    assert (float(bar[2]) - float(bar[0])) * page.panes()[0]["mmPerPx"] == pytest.approx(length_mm, rel=0.002)
    assert tall < 800


def test_the_caption_is_what_people_made_of_it(page: Watched, tmp_path: Path):
    caption = 'A <b>bone</b> & "its" cells, 骨 θ −1 mm.'
    root = ElementTree.fromstring(saved(page, "SVG", tmp_path / "view.svg", caption=caption))
    assert root.find(f"{SVG}desc").text == caption
    assert caption in {one.text for one in root.iter(f"{SVG}text")}
    pdf = saved(page, "PDF", tmp_path / "view.pdf", caption=caption)
    assert f"/Subject <feff{caption.encode('utf-16-be').hex()}>".encode() in pdf
    assert (
        Image.open(io.BytesIO(saved(page, "PNG", tmp_path / "v.png", caption=caption))).info["Description"] == caption
    )


def test_a_figure_that_is_too_large_is_refused_in_words(page: Watched):
    dialog = ask(page, "PNG", width_mm=900, dpi=1200)
    assert "too many, choose fewer dots per inch" in dialog.locator(".said").inner_text()
    assert dialog.get_by_role("button", name="save").is_disabled()
    dialog.get_by_label("dots per inch").fill("7")
    assert dialog.get_by_role("button", name="save").is_disabled()
    dialog.get_by_label("dots per inch").fill("100")
    assert dialog.get_by_role("button", name="save").is_enabled()
    dialog.locator("textarea").press("b")  # a letter there, and no key of the page
    dialog.get_by_role("button", name="cancel").click()
    page.page.wait_for_selector("dialog", state="detached")


def test_names_with_html_are_texts_in_svg(chromium: Any, tmp_path: Path):
    name = '<script>document.title=1</script> & "x"'
    folder = written(tmp_path / name.replace("/", ":"))
    with serving(folder) as hostile, opened(chromium, hostile.url) as page:
        root = ElementTree.fromstring(saved(page, "SVG", tmp_path / "view.svg"))
        assert not list(root.iter(f"{SVG}script"))
        assert root.find(f"{SVG}title").text.startswith('<script>document.title=1<:script> & "x"')


@pytest.mark.parametrize("kind", ["PNG", "SVG", "PDF"])
def test_the_offline_file_saves_the_view_too(chromium: Any, comparison: Path, tmp_path: Path, kind: str):
    path = tmp_path / "report.html"
    shown_there = open_shown(comparison)
    path.write_text(frozen_page(shown_there, shown_there.sections, frozen_data(shown_there)), encoding="utf-8")
    with opened(chromium, path.as_uri()) as page:
        one_pane(page, "oct-relief")
        content = saved(page, kind, tmp_path / f"view.{kind.lower()}")
        assert content.startswith({"PNG": b"\x89PNG", "SVG": b"<?xml", "PDF": b"%PDF-1.7"}[kind])
        if kind == "SVG":
            [shown] = layers_of(content)
            assert is_coloured(shown[shown.shape[0] // 2 :][:8]).mean() > 0.9


def test_a_file_for_another_program_is_chosen_by_keys_alone(chromium: Any, tmp_path: Path):
    folder = written(tmp_path / "result")
    with serving(folder) as served, opened(chromium, served.url) as watched:
        page = watched.page
        page.get_by_role("button", name="export…").focus()
        page.keyboard.press("Enter")
        page.wait_for_selector("dialog .command:not(:empty)")
        assert page.get_by_role("button", name="download").is_disabled()  # the first format is a folder
        page.locator("dialog input:checked").focus()
        with answered_last_first(page, "**/export-line.json*") as wait_for:
            while page.locator("dialog input:checked").input_value() != "csv":
                page.keyboard.press("ArrowDown")
            wait_for("csv")
        page.locator("dialog .command", has_text="--to csv --side=endoscope").wait_for()
        page.get_by_label("side", exact=True).select_option("oct")
        line = f"endoct export {folder} --to csv --side=oct -o {tmp_path / 'result.csv'}"
        page.locator("dialog .command", has_text=line).wait_for()
        with page.expect_download() as arriving:
            page.get_by_role("button", name="download").click()
        assert arriving.value.suggested_filename == "result.csv"
        page.locator("dialog .said", has_text="is downloaded").wait_for()
        page.get_by_role("button", name="save beside the result").click()
        page.locator("dialog .said", has_text=str(tmp_path / "result.csv")).wait_for()
        assert (tmp_path / "result.csv").read_bytes() == Path(arriving.value.path()).read_bytes()
        page.keyboard.press("Escape")
        page.wait_for_selector("dialog", state="detached")
