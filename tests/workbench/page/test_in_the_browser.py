"""The page in a real browser: what people do on it, and what they see then."""

import io
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mock_comparison import Kind, write_comparison
from page_browser import Watched, opened
from PIL import Image
from workbench_page import Served, serving, written

from endoct.base.doubt import Doubt
from endoct.workbench.page.opening import open_shown
from endoct.workbench.page.report import frozen_data, frozen_page, write_report

HTML = '<img src=x onerror="document.title=1"><script>document.title=2</script>'


@pytest.fixture
def page(chromium: Any, served: Served) -> Iterator[Watched]:
    with opened(chromium, served.url) as watched:
        yield watched


@pytest.fixture(scope="module")
def frozen_file(comparison: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("frozen") / "report.html"
    path.write_text(frozen(comparison), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_report(written(tmp_path_factory.mktemp("reported") / "specimen-7"))


def frozen(folder: Path) -> str:
    shown = open_shown(folder)
    return frozen_page(shown, shown.sections, frozen_data(shown))


def middle(watched: Watched, pane: int = 0) -> tuple[float, float]:
    box = watched.page.locator(".view").nth(pane).bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def choose(watched: Watched, pane: int, which: int, value: str) -> None:
    watched.page.locator(".pane").nth(pane).locator("header select").nth(which).select_option(value)


def picture(watched: Watched, pane: int = 0) -> np.ndarray:
    """Return the middle of a pane, where the wall is, int (60, columns, 3), without the axis."""
    png = watched.page.locator(".view").nth(pane).screenshot()
    shown = np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)
    return shown[shown.shape[0] // 2 - 30 : shown.shape[0] // 2 + 30, 40:-10]


def test_it_says_what_it_is_before_it_shows_it(page: Watched):
    assert page.page.title() == "endoct: specimen-7: endoscope and oct"
    tops = [page.page.locator(one).first.bounding_box()["y"] for one in ("h1", ".panes", ".more")]
    assert tops == sorted(tops)
    assert "trusted" in page.page.locator(".verdict").get_attribute("class")
    assert page.page.locator(".scores b").first.inner_text().startswith("0.")
    assert len(page.panes()) == 3


def test_the_panes_have_pictures_in_colours(page: Watched):
    image, relief, difference = (picture(page, k) for k in range(3))
    colours = [len(np.unique(one.reshape(-1, 3), axis=0)) for one in (image, relief, difference)]
    assert min(colours) > 50
    assert np.median(np.ptp(image, axis=2)) == 0
    assert np.median(np.ptp(relief, axis=2)) > 30  # viridis


def test_a_pane_says_what_lies_beyond_its_view(page: Watched):
    beyond = page.page.locator(".pane .beyond").first
    assert beyond.inner_text() == ""
    for _ in range(6):
        page.page.keyboard.press("+")
    page.settle()
    (view,), height = page.panes()[:1], page.page.locator(".view").first.bounding_box()["height"]
    half_mm = height / 2 * view["mmPerPx"]
    above, below = (float(mm) for mm in re.findall(r"([\d.]+) mm more", beyond.inner_text()))
    facts = " ".join(page.page.locator(".facts, .more").all_inner_texts()).replace("−", "-")
    top_mm, bottom_mm = map(float, re.search(r"z\s*(-?[\d.]+) to ([\d.]+) mm", facts).groups())
    assert above == pytest.approx(view["zMm"] - half_mm - top_mm, abs=0.07)
    assert below == pytest.approx(bottom_mm - view["zMm"] - half_mm, abs=0.07)


def test_nobody_is_asked_to_stay_where_nothing_was_drawn(page: Watched):
    page.page.mouse.click(*middle(page))
    left = "() => window.dispatchEvent(new Event('beforeunload', {cancelable: true}))"
    assert page.page.evaluate(left)


def test_zooming_one_pane_zooms_the_others_by_mm(page: Watched):
    before = page.panes()
    page.page.mouse.move(*middle(page, 1))
    page.page.mouse.wheel(0, -400)
    page.settle()
    after = page.panes()
    assert after[1]["mmPerPx"] < before[1]["mmPerPx"] / 1.2
    for key in ("mmPerPx", "zMm", "thetaDeg"):
        assert len({one[key] for one in after}) == 1


def test_panes_of_other_widths_show_the_same_mm_per_pixel(page: Watched):
    page.page.locator(".panes").evaluate("one => { one.style.gridTemplateColumns = '2fr 1fr 1fr'; }")
    page.settle()
    page.page.mouse.move(*middle(page, 2))
    page.page.mouse.wheel(0, -300)
    page.settle()
    assert len({one["mmPerPx"] for one in page.panes()}) == 1
    widths = [page.page.locator(".view").nth(k).bounding_box()["width"] for k in (0, 2)]
    assert widths[0] > 1.5 * widths[1]


def test_panes_that_are_not_linked_stay_where_they_are(page: Watched):
    page.page.keyboard.press("l")
    before = page.panes()
    page.page.mouse.move(*middle(page, 1))
    page.page.mouse.wheel(0, -400)
    page.settle()
    after = page.panes()
    assert after[1] != before[1]
    assert [after[0], after[2]] == [before[0], before[2]]
    page.page.keyboard.press("l")
    page.settle()
    assert len({json.dumps(one) for one in page.panes()}) == 1


def test_the_wall_goes_on_across_the_seam(page: Watched):
    for _ in range(2):
        x, y = middle(page)
        page.page.mouse.move(x, y)
        page.page.mouse.down()
        page.page.mouse.move(x + 60, y, steps=4)
        page.page.mouse.move(x + 120, y, steps=4)
        page.page.wait_for_timeout(300)  # held still, so that it is not thrown
        page.page.mouse.up()
        page.settle()
    now = page.panes()
    assert len({one["thetaDeg"] for one in now}) == 1
    assert (picture(page).std(axis=(0, 2)) > 0).all()  # no empty stripe, on either side of the seam


def test_layers_are_brought_together(page: Watched):
    over = page.page.locator(".layer.over")
    choose(page, 0, 1, "swipe")
    choose(page, 0, 2, "oct-relief")
    page.page.locator(".pane").first.locator("input[type=range]").fill("0.25")
    page.settle()
    assert over.evaluate("one => one.style.clipPath") == "inset(0px 0px 0px 25%)"
    shown = picture(page)
    left, right = shown[:, :20], shown[:, shown.shape[1] // 3 :]
    assert np.median(np.ptp(left, axis=2)) == 0
    assert np.median(np.ptp(right, axis=2)) > 30
    choose(page, 0, 1, "opacity")
    page.page.locator(".pane").first.locator("input[type=range]").fill("0.4")
    assert over.evaluate("one => one.style.opacity") == "0.4"
    choose(page, 0, 1, "checker")
    assert "conic-gradient" in over.evaluate("one => one.style.maskImage")
    choose(page, 0, 1, "lens")
    page.page.mouse.move(*middle(page))
    assert over.evaluate("one => one.style.clipPath").startswith("circle(90px at ")
    choose(page, 0, 1, "blink")
    page.page.locator("h1").click()
    opacities = []
    for _ in range(3):
        opacities.append(over.evaluate("one => one.style.opacity"))
        page.page.keyboard.press("b")
    assert opacities == ["1", "0", "1"]
    choose(page, 0, 1, "single")
    assert over.count() == 0


def test_the_swipe_can_be_dragged(page: Watched):
    choose(page, 1, 1, "swipe")
    page.settle()
    handle = page.page.locator(".handle:visible").bounding_box()
    x, y = handle["x"] + handle["width"] / 2, handle["y"] + handle["height"] / 2
    page.page.mouse.move(x, y)
    page.page.mouse.down()
    page.page.mouse.move(x - 60, y, steps=3)
    page.page.mouse.up()
    share = float(page.page.locator(".pane").nth(1).locator("input[type=range]").input_value())
    assert 0.2 < share < 0.45
    assert len({one["zMm"] for one in page.panes()}) == 1


def test_the_values_under_the_cursor_are_those_of_the_place(page: Watched, served: Served):
    page.page.mouse.move(*middle(page, 1))
    panel = page.page.locator(".readout")
    page.page.wait_for_function("() => /mm\\n/.test(document.querySelector('.readout').innerText)")
    page.page.wait_for_timeout(500)
    text = panel.inner_text()
    theta_deg, z_mm = (float(re.search(rf"{name}\n(−?[\d.]+)", text)[1].replace("−", "-")) for name in "θz")
    assert theta_deg == pytest.approx(page.panes()[1]["thetaDeg"], abs=1)
    assert z_mm == pytest.approx(page.panes()[1]["zMm"], abs=0.05)
    values = json.loads(served.get(f"/values.json?theta_rad={np.radians(theta_deg)}&z_mm={z_mm}")[1])
    shown = float(re.search(r"oct: relief\n(−?[\d.]+)", text)[1].replace("−", "-"))
    assert shown == pytest.approx(values["oct-relief"], abs=0.03)


def test_a_marked_place_is_stepped_by_rows_and_degrees(page: Watched):
    page.page.mouse.click(*middle(page, 1))
    page.page.mouse.move(5, 5)
    where = page.page.locator(".readout dd")
    before = [float(where.nth(k).inner_text().split()[0].rstrip("°")) for k in (0, 1)]
    page.page.keyboard.press("ArrowDown")
    page.page.keyboard.press("ArrowRight")
    after = [float(where.nth(k).inner_text().split()[0].rstrip("°")) for k in (0, 1)]
    assert after[0] - before[0] == pytest.approx(1.0, abs=0.02)
    assert after[1] % 0.2 == pytest.approx(0.0, abs=0.001) or after[1] % 0.2 == pytest.approx(0.2, abs=0.001)
    assert 0 < after[1] - before[1] <= 0.3
    page.page.keyboard.press("Escape")
    assert where.first.inner_text() == "–"


def test_keys_act_once_wherever_the_focus_is(page: Watched):
    page.page.mouse.click(*middle(page, 1))  # the focus is in the pane then
    page.settle()
    before = page.panes()
    page.page.keyboard.press("ArrowRight")
    page.settle()
    assert page.panes() == before  # the place was stepped, the view stayed
    page.page.keyboard.press("Escape")
    page.settle()
    page.page.keyboard.press("+")
    page.settle()
    assert page.panes()[0]["mmPerPx"] == pytest.approx(before[0]["mmPerPx"] / 1.5, rel=1e-4)


def test_cells_are_sorted_filtered_and_shown(page: Watched):
    rows = page.page.locator(".cells tbody tr")
    assert rows.count() == 4
    page.page.locator(".cells th button", has_text="mm²").click()
    areas = [float(rows.nth(k).locator("td").nth(3).inner_text()) for k in range(4)]
    assert areas == sorted(areas)
    page.page.locator(".cells select").select_option("of oct")
    assert rows.count() == 2
    rows.last.click()
    page.settle()
    assert rows.last.get_attribute("aria-selected") == "true"
    cell = [float(rows.last.locator("td").nth(k).inner_text()) for k in (1, 2)]
    for pane in page.panes():
        assert pane["thetaDeg"] == pytest.approx(cell[0], abs=0.2)
        assert pane["zMm"] == pytest.approx(cell[1], abs=0.02)
    assert "oct" in page.page.locator(".about").inner_text()
    page.page.mouse.move(*middle(page, 1))
    page.page.wait_for_function("() => /oct: cell\\n\\d/.test(document.querySelector('.readout').innerText)")


def test_the_ruler_measures_along_the_wall(page: Watched):
    page.page.keyboard.press("r")
    x, y = middle(page, 1)
    page.page.mouse.click(x - 40, y)
    page.page.mouse.click(x + 40, y + 60)
    page.settle()
    text = page.page.locator(".readout").inner_text()
    mm = page.panes()[0]["mmPerPx"]
    length_mm, degrees = map(float, re.search(r"ruler\n([\d.]+) mm, ([\d.]+)° from the axis", text).groups())
    wide_mm, tall_mm, area_mm2 = map(
        float, re.search(r"rectangle\n([\d.]+) × ([\d.]+) mm, ([\d.]+) mm²", text).groups()
    )
    assert [length_mm, wide_mm, tall_mm] == pytest.approx([100 * mm, 80 * mm, 60 * mm], rel=0.03)
    assert degrees == pytest.approx(53.1, abs=1)
    assert area_mm2 == pytest.approx(4800 * mm**2, rel=0.06)


def test_contrast_and_colours_change_without_new_tiles(page: Watched):
    before = picture(page, 1)
    asked = len([one for one in page.asked if "/tiles/" in one])
    bar = page.page.locator(".pane").nth(1).locator(".bar")
    bar.locator("select").select_option("magma")
    after = picture(page, 1)
    bar.locator("input").nth(1).fill("2")
    bar.locator("input").nth(1).press("Enter")
    darker = picture(page, 1)
    assert np.abs(before - after).mean() > 5
    assert darker.mean() < after.mean()
    assert len([one for one in page.asked if "/tiles/" in one]) == asked


def test_two_to_six_panes(page: Watched):
    add = page.page.get_by_role("button", name="+ pane")
    while add.is_enabled():
        add.click()
    page.settle()
    assert len(page.panes()) == 6
    assert len({one["mmPerPx"] for one in page.panes()}) == 1
    for _ in range(4):
        page.page.locator(".close").last.click()
    assert len(page.panes()) == 2


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_is_cut_off_at_1280_by_800(chromium: Any, served: Served, scheme: str):
    with opened(chromium, served.url, color_scheme=scheme) as page:
        wide = page.page.evaluate("() => document.documentElement.scrollWidth")
        assert wide <= 1280
        foot = page.page.locator(".panes").bounding_box()
        assert foot["y"] + foot["height"] <= 800


@pytest.mark.parametrize(
    "changed", [{"parameters": {"compare": {"force": True}}}, {"doubts": (Doubt("forced", "Forced."),)}]
)
def test_what_was_forced_or_doubted_is_never_green(chromium: Any, tmp_path: Path, changed: dict[str, Any]):
    folder = written(tmp_path / "doubted", **changed)
    with serving(folder) as doubted, opened(chromium, doubted.url) as page:
        verdict = page.page.locator(".verdict")
        assert "doubted" in verdict.get_attribute("class")
        red, green, _ = map(
            int, re.findall(r"\d+", verdict.locator("strong").evaluate("e => getComputedStyle(e).color"))[:3]
        )
        assert red > green


def test_names_and_sentences_with_html_are_shown_as_text(chromium: Any, tmp_path: Path):
    notes = {"oct": (HTML,), "endoscope": ()}
    folder = written(tmp_path / HTML.replace("/", ":"), doubts=(Doubt("forced", HTML, "oct"),), notes=notes)
    with serving(folder) as hostile, opened(chromium, hostile.url) as page:
        assert HTML in page.page.locator(".verdict").inner_text()
        assert page.page.locator("img, body script:not(#glossary)").count() == 0
        assert page.page.title().startswith("endoct: <img")
    alone = tmp_path / "hostile.html"
    alone.write_text(frozen(folder), encoding="utf-8")
    with opened(chromium, alone.as_uri()) as page:
        assert page.page.locator("img").count() == 0
        assert page.page.title().startswith("endoct: <img")


def test_the_offline_file_is_the_same_page(chromium: Any, frozen_file: Path, served: Served):
    with opened(chromium, frozen_file.as_uri()) as page:
        assert [one for one in page.asked if not one.startswith(("file:", "data:", "blob:"))] == []
        assert page.page.get_by_role("button", name="export…").count() == 0  # nobody is there to write a file
        page.page.mouse.move(*middle(page, 1))
        page.page.mouse.wheel(0, -300)
        page.settle()
        assert len({one["mmPerPx"] for one in page.panes()}) == 1
        assert np.median(np.ptp(picture(page, 1), axis=2)) > 30
        page.page.wait_for_function(
            "() => /oct: relief\\n−?[\\d.]+ mm/.test(document.querySelector('.readout').innerText)"
        )
        text = page.page.locator(".readout").inner_text()
        place = [float(re.search(rf"{name}\n(−?[\d.]+)", text)[1].replace("−", "-")) for name in "θz"]
        values = json.loads(served.get(f"/values.json?theta_rad={np.radians(place[0])}&z_mm={place[1]}")[1])
        shown = float(re.search(r"oct: relief\n(−?[\d.]+)", text)[1].replace("−", "-"))
        assert shown == pytest.approx(values["oct-relief"], abs=0.05)


def test_a_click_shows_the_frames_there(page: Watched):
    drawer = page.page.locator(".drawer")
    assert drawer.is_hidden()
    page.page.mouse.click(*middle(page, 1))
    page.page.wait_for_selector(".drawer figure")
    assert drawer.locator("figure").count() == 4  # two of either side
    assert "oct: slice 7 of 0–14" in drawer.locator(".said").inner_text()
    shown = np.asarray(Image.open(io.BytesIO(drawer.locator("canvas").first.screenshot())).convert("RGB"))
    assert len(np.unique(shown.reshape(-1, 3), axis=0)) > 50
    before = page.page.locator(".readout dd").nth(1).inner_text()
    page.page.mouse.move(5, 5)
    page.page.keyboard.press("ArrowDown")
    assert page.page.locator(".readout dd").nth(1).inner_text() != before
    drawer.get_by_role("button", name="close").click()
    assert drawer.is_hidden()


def test_the_offline_file_has_the_pictures_that_were_kept(chromium: Any, frozen_file: Path):
    with opened(chromium, frozen_file.as_uri()) as page:
        page.page.mouse.click(*middle(page, 1))
        page.page.wait_for_selector(".drawer figure")
        assert page.page.locator(".drawer figure").count() == 4
        assert page.page.locator(".drawer button", has_text="every").count() == 0


def test_what_lies_below_the_panes_is_folded_and_opened_by_links(page: Watched):
    sections = page.page.locator(".more > details")
    assert sections.count() >= 5
    assert [one for one in sections.evaluate_all("all => all.map(one => one.open)") if one] == []
    page.page.locator(".verdict a", has_text="note").click()
    assert page.page.locator("#notes").evaluate("one => one.open")
    assert page.page.locator("#notes td").first.is_visible()
    page.page.locator(".contents summary").click()
    page.page.locator(".contents a", has_text="Overlap and alignment").click()
    assert page.page.locator("#numbers table").first.is_visible()
    assert not page.page.locator(".contents ul").is_visible()


def test_on_paper_all_of_the_report_is_there_and_no_pane(chromium: Any, report: Path):
    with opened(chromium, report.as_uri()) as page:
        assert not page.page.locator("figure img").first.is_visible()
        page.page.emulate_media(media="print")
        page.page.evaluate("() => window.dispatchEvent(new Event('beforeprint'))")
        assert page.page.locator(".more > details:not([open])").count() == 0
        figures = page.page.locator("figure img")
        assert figures.count() == len(list((report.parent / "figures").glob("*.png")))
        for k in range(figures.count()):
            assert figures.nth(k).is_visible()
            assert figures.nth(k).evaluate("one => one.decode().then(() => one.naturalWidth)") > 500
        assert page.page.locator(".how p").first.is_visible()
        for gone in (".workspace", ".plots canvas", ".contents"):
            assert not page.page.locator(gone).first.is_visible()
        page.page.evaluate("() => window.dispatchEvent(new Event('afterprint'))")
        page.page.emulate_media(media="screen")
        assert not page.page.locator("figure img").first.is_visible()
        page.page.locator("#quality-oct > summary").click()
        assert page.page.locator("#quality-oct canvas").first.is_visible()
        assert not page.page.locator("#figure-quality-oct").is_visible()  # the same numbers, once


def test_without_javascript_the_report_is_read_as_it_is(chromium: Any, report: Path):
    context = chromium.new_context(viewport={"width": 820, "height": 1180}, java_script_enabled=False)
    page = context.new_page()
    errors: list[str] = []
    page.on("console", lambda message: errors.append(message.text))
    page.goto(report.as_uri())
    for part in (
        ".verdict",
        ".scores b",
        "#figure-panoramas img",
        "#figure-quality-oct img",
        "#numbers table",
        "noscript",
    ):
        assert page.locator(part).first.is_visible(), part
    assert page.evaluate("() => document.documentElement.scrollWidth") <= 820
    assert errors == []
    context.close()


def test_the_report_is_read_where_its_panes_cannot_be_opened(chromium: Any, report: Path, tmp_path: Path):
    broken = tmp_path / "broken.html"
    broken.write_text(report.read_text("utf-8").replace('id="frozen">{', 'id="frozen">', 1), encoding="utf-8")
    context = chromium.new_context()
    page = context.new_page()
    page.goto(broken.as_uri())
    assert "The panes could not be opened" in page.locator("[role=alert]").inner_text()
    assert page.locator("#figure-panoramas img").is_visible()
    context.close()


def test_quality_says_which_frames_lie_beyond_a_limit_and_goes_there(page: Watched):
    part = page.page.locator("#quality-oct")
    assert (
        "3 of 15 slices beyond a limit" in part.locator("summary").inner_text() or "of 15 slices" in part.inner_text()
    )
    part.locator("summary").click()
    plots = part.locator("canvas")
    bridged = [k for k in range(plots.count()) if "3, 8, 9" in plots.nth(k).get_attribute("aria-label")]
    assert len(bridged) == 1  # the mock's bridged slices
    box = plots.nth(bridged[0]).bounding_box()
    x = 52 + (box["width"] - 62) * 8 / 14
    plots.nth(bridged[0]).click(position={"x": x, "y": 30})
    assert page.page.locator(".readout dd").nth(1).inner_text() == "1.600 mm"


def test_sides_that_are_not_aligned_have_no_place_in_common(chromium: Any, tmp_path: Path):
    folder = tmp_path / "unaligned"
    write_comparison(folder, Kind("endoscope", depth=False), Kind("oct"), aligned=False, doubts=())
    with serving(folder) as unaligned, opened(chromium, unaligned.url) as page:
        verdict = page.page.locator(".verdict")
        assert "unaligned" in verdict.get_attribute("class")
        assert "Not aligned" in verdict.inner_text()
        options = page.page.locator(".pane").first.locator("select").first.locator("option").all_inner_texts()
        assert not any("difference" in one for one in options)
        before = page.panes()
        page.page.mouse.move(*middle(page))
        page.page.mouse.wheel(0, -300)
        page.settle()
        assert page.panes()[1] == before[1]  # not linked
        assert "endoscope: image" in page.page.locator(".readout").inner_text()
        assert "oct" not in page.page.locator(".readout").inner_text()


def test_every_doubt_is_in_view_at_once(chromium: Any, tmp_path: Path):
    doubts = tuple(
        Doubt("forced", f"Sentence {k}, of some length, that says what is doubted and how much.") for k in range(4)
    )
    with serving(written(tmp_path / "doubts", doubts=doubts)) as doubted, opened(chromium, doubted.url) as page:
        items = page.page.locator(".verdict li:has(code)", has_text="Sentence")
        assert items.count() == 4
        panes = page.page.locator(".panes").bounding_box()
        for k in range(4):
            box = items.nth(k).bounding_box()
            assert box["height"] > 10
            assert box["y"] + box["height"] <= panes["y"]
        assert panes["y"] + panes["height"] <= 800


def test_a_pane_that_becomes_smaller_shows_the_same_place(page: Watched):
    page.page.mouse.move(*middle(page))
    page.page.mouse.wheel(0, -300)
    page.settle()
    before = page.panes()[0]
    page.page.get_by_role("button", name="+ pane").click()
    page.page.wait_for_timeout(300)
    page.settle()
    assert len(page.panes()) == 4
    for pane in page.panes():
        assert pane == pytest.approx(before, rel=1e-4)
