"""The wall as a cylinder: what stands where, by hand, and that it goes along with the panes."""

import base64
import io
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from page_browser import Watched, opened
from PIL import Image
from volume_store import write_volume_store
from workbench_page import Served, serving

from endoct.workbench.page.opening import open_shown
from endoct.workbench.page.report import frozen_data, frozen_page

RADIUS_MM = 1.25
HALF_FIELD_RAD = math.radians(38 / 2)
MARK_PX = 3.0
"""How far a mark may stand from where it belongs: half a line, and what the relief's noise moves it."""


@pytest.fixture(scope="module", autouse=True)
def webgl(chromium: Any) -> None:
    page = chromium.new_page()
    has_webgl = page.evaluate("() => !!document.createElement('canvas').getContext('webgl2')")
    page.close()
    if not has_webgl:
        pytest.skip("this Chromium has no WebGL")


def drawn(watched: Watched) -> None:
    """Wait until what was changed is drawn."""
    watched.page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")


def open_cylinder(watched: Watched) -> None:
    watched.page.get_by_role("button", name="3-D").click()
    watched.page.wait_for_selector(".cylinder[data-filled][data-eye-mm]", timeout=60_000)
    drawn(watched)


@pytest.fixture
def page(chromium: Any, served: Served) -> Iterator[Watched]:
    with opened(chromium, served.url) as watched:
        # colours that are none of a mark's
        watched.page.locator(".pane").nth(1).locator(".bar select").select_option("viridis")
        open_cylinder(watched)
        enlarge(watched)
        yield watched


def enlarge(watched: Watched) -> None:
    """Put the cylinder in place of the panes, or give these their place again."""
    watched.page.locator(".cylinder").get_by_role("button", name="larger").click()
    drawn(watched)
    drawn(watched)  # after its size is known


def look(watched: Watched, name: str, opening_deg: int = 0, cut_deg: int = 270) -> None:
    for label, value in (("where it is cut open, θ", cut_deg), ("how far it is open", opening_deg)):
        control = watched.page.get_by_label(label)
        if control.input_value() != str(value):  # it is drawn anew each time
            control.fill(str(value))
    watched.page.locator(".cylinder footer").get_by_role("button", name=name, exact=True).click()
    drawn(watched)


def choose(watched: Watched, layer: str | None = None, shape: str | None = None) -> None:
    for which, value in enumerate((layer, shape)):
        if value is not None:
            watched.page.locator(".cylinder header select").nth(which).select_option(value)
            watched.page.wait_for_selector(".cylinder[data-filled]", timeout=60_000)
            drawn(watched)


def shown(watched: Watched) -> np.ndarray:
    """Return the cylinder as it is shown, int (rows, columns, 3)."""
    png = watched.page.locator(".cylinder .view").screenshot()
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


def seen_from(watched: Watched, theta_rad: float, z_mm: float, r_mm: float = RADIUS_MM) -> tuple[float, float]:
    """Return where a place stands in the view along the axis: x right, y down, smaller the farther in."""
    x_mm, y_mm, eye_z_mm = (
        float(one) for one in watched.page.locator(".cylinder").get_attribute("data-eye-mm").split()
    )
    box = watched.page.locator(".cylinder .view").bounding_box()
    scale = box["height"] / 2 / math.tan(HALF_FIELD_RAD) / (z_mm - eye_z_mm)
    across, down = r_mm * math.cos(theta_rad) - x_mm, r_mm * math.sin(theta_rad) - y_mm
    return box["width"] / 2 + scale * across, box["height"] / 2 + scale * down


def point(watched: Watched, x: float, y: float) -> tuple[float, float] | None:
    """Move the mouse there; return (θ rad, z mm) of the place that it points at, None where it points at none."""
    box = watched.page.locator(".cylinder .view").bounding_box()
    watched.page.locator(".cylinder").evaluate("one => { delete one.dataset.pointed; }")
    watched.page.mouse.move(box["x"] + x, box["y"] + y)
    found = watched.page.wait_for_selector(".cylinder[data-pointed]").get_attribute("data-pointed")
    assert found is not None
    if found == "none":
        assert re.search(r"θ\n–", watched.page.locator(".readout").inner_text())
        return None
    theta_rad, z_mm = (float(one) for one in found.split())
    said = re.search(r"θ\n([\d.]+)°", watched.page.locator(".readout").inner_text())
    assert said is not None
    assert float(said[1]) == pytest.approx(math.degrees(theta_rad) % 360, abs=0.0101)  # both are rounded
    return theta_rad, z_mm


def apart(one: float, other: float) -> float:
    """Return the angle between two directions, rad."""
    return abs((one - other + math.pi) % (2 * math.pi) - math.pi)


def pin(watched: Watched, theta_deg: float, z_mm: float) -> None:
    """Mark a place in a pane, and put the mouse out of the way."""
    enlarge(watched)
    while watched.page.locator(".pane .close").count():
        watched.page.locator(".pane .close").last.click()  # the pane is wide enough for every θ then
    watched.settle()
    view = watched.page.locator(".view").first.bounding_box()
    now = watched.panes()[0]
    x = view["x"] + view["width"] / 2 + math.radians(theta_deg - now["thetaDeg"]) * RADIUS_MM / now["mmPerPx"]
    y = view["y"] + view["height"] / 2 + (z_mm - now["zMm"]) / now["mmPerPx"]
    watched.page.mouse.click(x, y)
    watched.page.locator(".drawer").get_by_role("button", name="larger").wait_for()
    watched.page.mouse.move(640, 20)
    enlarge(watched)


@pytest.mark.parametrize(("theta_deg", "z_mm"), [(60, 1.2), (200, 0.9), (300, 2.6)])
def test_a_mark_stands_where_it_belongs(page: Watched, theta_deg: float, z_mm: float):
    pin(page, theta_deg, z_mm)
    look(page, "in")
    text = page.page.locator(".readout").inner_text()
    theta = math.radians(float(re.search(r"θ\n([\d.]+)°", text)[1]))
    z_mm = float(re.search(r"z\n([\d.]+) mm", text)[1])
    assert theta == pytest.approx(math.radians(theta_deg), abs=0.05)
    picture = shown(page)
    rows, columns = np.nonzero((picture[..., 0] > 150) & (picture[..., 1] < 90) & (picture[..., 2] > 80))
    x, y = seen_from(page, theta, z_mm)
    assert columns.mean() == pytest.approx(x, abs=MARK_PX)
    assert rows.mean() == pytest.approx(y, abs=MARK_PX)


def test_the_mouse_is_at_the_place_that_it_points_at(page: Watched):
    look(page, "in")
    for theta_deg in (5, 100, 190, 280):
        theta = math.radians(theta_deg)
        found = point(page, *seen_from(page, theta, 2.4))
        assert found is not None, theta_deg
        assert apart(found[0], theta) < math.radians(1), theta_deg
        assert found[1] == pytest.approx(2.4, abs=0.1), theta_deg


def seen_through_the_cut(watched: Watched, cut_rad: float, place_mm: tuple[float, float, float]) -> tuple[float, float]:
    """Return where a point of the bore frame stands in the view from the side: looking at the axis, the mouth up."""
    eye_mm = np.array([float(one) for one in watched.page.locator(".cylinder").get_attribute("data-eye-mm").split()])
    forward, up = np.array([-math.cos(cut_rad), -math.sin(cut_rad), 0.0]), np.array([0.0, 0.0, -1.0])
    away = np.array(place_mm) - eye_mm
    box = watched.page.locator(".cylinder .view").bounding_box()
    scale = box["height"] / 2 / math.tan(HALF_FIELD_RAD) / (away @ forward)
    return box["width"] / 2 + scale * (away @ np.cross(forward, up)), box["height"] / 2 - scale * (away @ up)


def test_a_cell_is_as_deep_as_its_relief(page: Watched):
    cut_deg = round(math.degrees(2.0)) + 180
    look(page, "side", opening_deg=150, cut_deg=cut_deg)
    floor_mm = RADIUS_MM + 0.6  # of the mock's cell, about θ = 2 rad
    at = seen_through_the_cut(page, math.radians(cut_deg), (floor_mm * math.cos(2.2), floor_mm * math.sin(2.2), 1.4))
    assert point(page, *at) == pytest.approx((2.2, 1.4), abs=0.015)
    eye_mm = np.array([float(one) for one in page.page.locator(".cylinder").get_attribute("data-eye-mm").split()])
    choose(page, shape="")
    away = np.array([floor_mm * math.cos(2.2), floor_mm * math.sin(2.2), 1.4]) - eye_mm
    a, b, c = away[:2] @ away[:2], away[:2] @ eye_mm[:2], eye_mm[:2] @ eye_mm[:2] - RADIUS_MM**2
    x, y, z_mm = eye_mm + away * (-b + math.sqrt(b * b - a * c)) / a  # where the line of sight meets the bore, within
    assert abs(math.atan2(y, x) - 2.2) > 0.04
    assert point(page, *at) == pytest.approx((math.atan2(y, x), z_mm), abs=0.015)


def test_it_is_cut_open_where_it_is_said(page: Watched):
    look(page, "in", opening_deg=90, cut_deg=90)
    assert point(page, *seen_from(page, math.radians(90), 2.5)) is None
    for theta_deg in (52, 128):
        assert point(page, *seen_from(page, math.radians(90 + (theta_deg - 90) * 0.85), 2.5)) is None
        beside = point(page, *seen_from(page, math.radians(90 + (theta_deg - 90) * 1.35), 2.5))
        assert beside is not None
        assert apart(beside[0], math.radians(90 + (theta_deg - 90) * 1.35)) < math.radians(1.5)


def test_it_is_shown_from_z_to_z(page: Watched):
    look(page, "in")
    place = seen_from(page, math.radians(100), 1.0)
    assert point(page, *place) is not None
    page.page.get_by_label("from this z on").fill("1.6")
    drawn(page)
    found = point(page, *place)
    assert found is None or found[1] >= 1.59


def test_what_was_not_observed_is_a_hole(page: Watched):
    look(page, "in")
    theta = math.radians(150)
    seen = [point(page, *seen_from(page, theta, z_mm)) for z_mm in (1.9, 2.075, 2.3)]
    assert [one is None for one in seen] == [False, True, False]  # the mock's rows that the OCT did not observe


def test_the_seam_is_not_to_be_seen(page: Watched):
    choose(page, layer="oct-image")
    look(page, "in")
    picture = shown(page)
    around = []
    for theta_deg in np.arange(-12, 12, 0.25):
        x, y = seen_from(page, math.radians(theta_deg), 2.5)
        around.append(picture[round(y), round(x)].mean())
    background = picture[4, 4].mean()
    values = np.array(around)
    assert np.abs(values - background).min() > 20
    steps = np.abs(np.diff(values))
    seam = steps[len(steps) // 2 - 3 : len(steps) // 2 + 3]
    assert seam.max() <= 1.5 * steps.max(initial=0, where=np.arange(steps.size) < steps.size // 2 - 3) + 6


def test_colours_and_contrast_are_those_of_the_panes(page: Watched):
    choose(page, layer="oct-relief")
    look(page, "in")
    before = shown(page)
    page.page.locator(".cylinder").get_by_role("button", name="light").click()
    enlarge(page)
    page.page.locator(".pane").nth(1).locator(".bar select").select_option("magma")
    enlarge(page)
    drawn(page)
    after = shown(page)
    x, y = (round(one) for one in seen_from(page, math.radians(100), 2.6))
    assert before[y, x, 2] > before[y, x, 0] + 10  # viridis begins with violet
    assert np.abs(after[y, x] - before[y, x]).max() > 15


def test_cells_and_differences_can_be_laid_on_it(page: Watched):
    choose(page, layer="difference")
    page.page.locator(".cylinder").get_by_role("button", name="light").click()
    look(page, "in")
    x, y = (round(one) for one in seen_from(page, math.radians(180), 2.5))
    assert np.abs(shown(page)[y, x] - np.array([244, 244, 242])).max() < 12  # neither shows a cell


def test_outlines_lie_over_it_as_over_the_panes(page: Watched):
    look(page, "side", opening_deg=150, cut_deg=round(math.degrees(2.0)) + 180)
    before = shown(page)
    for side in ("oct", "endoscope"):
        page.page.get_by_role("button", name=side, exact=True).click()
    drawn(page)
    changed = np.abs(shown(page) - before).max(axis=2) > 40
    assert 100 < changed.sum() < 0.05 * changed.size


def test_a_figure_has_it_as_it_is_shown(page: Watched, tmp_path: Path):
    choose(page, layer="oct-relief")
    look(page, "in")
    screen = shown(page)
    page.page.get_by_role("button", name="save view").click()
    page.page.locator("dialog.save select").select_option("SVG")
    page.page.get_by_label("width in mm").fill("240")
    page.page.get_by_label("dots per inch").fill("200")
    with page.page.expect_download() as saved:
        page.page.locator("dialog.save").get_by_role("button", name="save").click()
    saved.value.save_as(tmp_path / "view.svg")
    root = ElementTree.fromstring((tmp_path / "view.svg").read_bytes())
    texts = [one.text for one in root.iter("{http://www.w3.org/2000/svg}text")]
    assert "oct: relief, in perspective" in texts
    assert {"θ 0°", "90°", "oct: relief, mm"} <= set(texts)
    data = next(root.iter("{http://www.w3.org/2000/svg}image")).attrib["{http://www.w3.org/1999/xlink}href"]
    picture = Image.open(io.BytesIO(base64.b64decode(data.split(",")[1])))
    assert picture.width > 1.5 * screen.shape[1]
    small = np.asarray(picture.resize(screen.shape[1::-1])).astype(int)
    opaque = small[..., 3] == 255
    assert 0.05 < opaque.mean() < 0.9
    assert np.median(np.abs(small[..., :3] - screen)[opaque]) <= 4
    assert np.abs(shown(page) - screen).max() <= 3  # and the screen is as it was


def test_keys_turn_it_and_leave_the_panes(page: Watched):
    page.page.locator(".cylinder .scene").focus()
    panes, eye = page.panes(), page.page.locator(".cylinder").get_attribute("data-eye-mm")
    for key in ("ArrowLeft", "ArrowUp", "+"):
        page.page.keyboard.press(key)
        drawn(page)
        now = page.page.locator(".cylinder").get_attribute("data-eye-mm")
        assert now != eye
        eye = now
    assert page.panes() == panes


def test_it_is_dragged_round_and_a_drag_marks_nothing(page: Watched):
    eye = page.page.locator(".cylinder").get_attribute("data-eye-mm")
    box = page.page.locator(".cylinder .view").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.page.mouse.move(x, y)
    page.page.mouse.down()
    page.page.mouse.move(x + 80, y, steps=4)
    page.page.mouse.up()
    page.page.mouse.move(640, 20)
    drawn(page)
    assert page.page.locator(".cylinder").get_attribute("data-eye-mm") != eye
    assert page.page.locator(".drawer").is_hidden()


def test_a_click_marks_the_place_as_in_the_panes(page: Watched):
    look(page, "in")
    x, y = seen_from(page, math.radians(100), 2.4)
    box = page.page.locator(".cylinder .view").bounding_box()
    page.page.mouse.click(box["x"] + x, box["y"] + y)
    page.page.wait_for_selector(".drawer figure")
    page.page.mouse.move(640, 20)
    text = page.page.locator(".readout").inner_text()
    assert "at the marked place" in text
    assert float(re.search(r"θ\n([\d.]+)°", text)[1]) == pytest.approx(100, abs=1)


def test_it_closes_and_opens_again(page: Watched):
    for _ in range(2):
        page.page.locator(".cylinder").get_by_role("button", name="close the cylinder").click()
        assert page.page.locator(".cylinder").count() == 0
        page.settle()
        open_cylinder(page)


def test_a_shape_that_is_answered_late_is_not_shown_for_a_newer_choice(page: Watched):
    look(page, "side", opening_deg=150, cut_deg=round(math.degrees(2.0)) + 180)
    relief = shown(page)
    held = list[Any]()
    page.page.route("**/relief/**", lambda route: held.append(route))
    shape = page.page.locator(".cylinder header select").nth(1)
    choose(page, shape="")  # with nothing to fetch
    smooth = shown(page)
    assert np.abs(relief - smooth).max() > 40
    shape.select_option("oct-relief")
    choose(page, shape="")
    assert held
    for route in held:
        with page.page.expect_response("**/relief/**"):
            route.continue_()
    page.page.wait_for_timeout(1000)
    drawn(page)
    assert np.abs(shown(page) - smooth).max() <= 3
    page.page.unroute("**/relief/**")


def test_a_shape_that_cannot_be_fetched_is_no_smooth_bore(page: Watched):
    choose(page, shape="")
    page.page.route("**/relief/**", lambda route: route.fulfill(status=503, body="not now"))
    choose(page, shape="oct-relief")
    assert "the shape could not be fetched" in page.page.locator(".cylinder .said").inner_text()
    page.page.unroute("**/relief/**")
    choose(page, shape="")
    choose(page, shape="oct-relief")
    assert page.page.locator(".cylinder .said").inner_text() == ""
    page.errors[:] = [one for one in page.errors if "503" not in one]  # Chromium notes the refusal


def test_the_offline_file_has_it_too(chromium: Any, comparison: Path, tmp_path: Path):
    path = tmp_path / "report.html"
    shown_there = open_shown(comparison)
    path.write_text(frozen_page(shown_there, shown_there.sections, frozen_data(shown_there)), encoding="utf-8")
    with opened(chromium, path.as_uri()) as page:
        open_cylinder(page)
        look(page, "in")
        found = point(page, *seen_from(page, math.radians(100), 2.4))
        assert found == pytest.approx((math.radians(100), 2.4), abs=0.1)


def test_the_volume_stands_where_it_belongs(chromium: Any, tmp_path: Path):
    """A bright part of a dark volume: θ = 20/128 of a turn, z = 1 mm, r = 1.32 to 1.48 mm, seen along the axis."""
    store = write_volume_store(tmp_path / "bright.zarr", (30, 128, 40), at=(10, 20, 25), spread=(1, 4, 4))
    small = {"width": 800, "height": 560}  # each drawing of the volume takes a processor a second and more
    with serving(store) as served, opened(chromium, served.url, viewport=small) as page:
        page.page.locator(".pane").nth(1).locator(".bar select").select_option("viridis")
        open_cylinder(page)
        enlarge(page)
        look(page, "in")
        choose(page, layer="oct-relief", shape="volume")
        picture = shown(page)
        rows, columns = np.nonzero(picture[..., 0] - picture[..., 2] > 60)  # yellow, the end of viridis
        assert rows.size > 50
        x, y = seen_from(page, 2 * math.pi * 20 / 128, 1.0, 1.31)  # its face within, half a sample before its first one
        assert (columns.mean(), rows.mean()) == pytest.approx((x, y), abs=MARK_PX)
        found = point(page, *seen_from(page, 1.0, 1.5))
        assert found == pytest.approx((1.0, 1.5), abs=0.05)  # the wall is still there to be pointed at
        look(page, "in", opening_deg=60, cut_deg=56)
        picture = shown(page)
        assert not (picture[..., 0] - picture[..., 2] > 60).any()  # it is cut away with the wall
        choose(page, shape="")
        assert np.ptp(shown(page)[..., 1]) > 20


WITHOUT_WEBGL = """() => {
  const before = HTMLCanvasElement.prototype.getContext;
  HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
    return kind === "webgl2" ? null : before.call(this, kind, ...rest);
  };
}"""


def test_where_there_is_no_webgl_it_says_so(chromium: Any, served: Served):
    with opened(chromium, served.url) as page:
        page.page.evaluate(WITHOUT_WEBGL)
        page.page.get_by_role("button", name="3-D").click()
        said = page.page.locator(".cylinder .said")
        assert "no view in three dimensions" in said.inner_text()
        assert not [one for one in page.asked if one.endswith("cylinder.js")]
