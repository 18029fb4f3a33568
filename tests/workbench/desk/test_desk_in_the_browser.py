"""The pages of `endoct open` in a real browser: a newcomer's way from two bare folders to a verdict."""

import json
import re
import shutil
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from page_browser import WITHOUT_CARD, Watched, answered_last_first, browser, opened
from workbench_page import Served, serving

from endoct.workbench.desk.desk import Desk
from endoct.workbench.desk.desk_app import desk_app

LONG_MS = 120_000


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    with browser(WITHOUT_CARD) as started:
        yield started


@pytest.fixture
def served(desk: Desk) -> Iterator[Served]:
    with serving(lambda host, port: desk_app(desk, host, port)) as found:
        yield found


def page_of(chromium: Any, served: Served, address: str, ready: str, **context: Any) -> Any:
    return opened(chromium, served.url.rstrip("/") + address, ready, **context)


def says(page: Any, selector: str, pattern: str) -> None:
    """Wait until an element says what the pattern asks for; the page forbids programs that are no files of its own."""
    page.locator(selector, has_text=re.compile(pattern)).first.wait_for(state="attached", timeout=LONG_MS)


def keys_of(sidecar: Path) -> dict[str, str]:
    return dict(re.findall(r"^(\w+) = \"?([^\"\n]+)\"?$", sidecar.read_text(), re.MULTILINE))


def described(page: Any, name: str, keys: dict[str, str]) -> None:
    """Fill in what a recording lacks, see it drawn, and save."""
    page.click(f".inputs tr[data-name='{name}'] a:has-text('describe it')")
    page.wait_for_selector("figure canvas", timeout=LONG_MS)
    assert page.locator("[role=status]").inner_text().startswith("Still needed: bore_diameter_mm")
    for key, value in keys.items():
        if key != "modality":
            control = page.locator(f"#key-{key}")
            if not control.is_visible():
                page.click("summary:has-text('more that may be known')")
            if control.evaluate("node => node.tagName") == "SELECT":
                control.select_option(value)
            else:
                control.fill(value)
    says(page, ".desk [role=status]", "^Nothing is missing. Not saved yet.$")
    page.wait_for_selector("figcaption .legend", timeout=LONG_MS)
    page.click("button:text('Save')")
    says(page, ".desk [role=status]", "It is saved.$")
    page.click(".above")
    page.wait_for_selector(f".inputs tr[data-name='{name}'] button:has-text('compare')", timeout=LONG_MS)


def test_from_two_bare_folders_to_a_verdict_without_a_terminal(chromium: Any, served: Served, desk: Desk, study: Path):
    keys = {}
    for side in ("endoscope", "oct"):
        sidecar = study / "bore-1" / side / "acquisition.toml"
        keys[side] = keys_of(sidecar)
        sidecar.unlink()
    with page_of(chromium, served, f"{desk.root}/", ".folders") as watched:
        page = watched.page
        page.fill("input[type=text]", str(study))
        page.click("text=Open this folder")
        page.wait_for_selector(".inputs tr[data-name='bore-1/oct']", timeout=LONG_MS)
        for side in ("endoscope", "oct"):
            described(page, f"bore-1/{side}", keys[side])
        page.click(".inputs tr[data-name='bore-1/oct'] button:has-text('compare')")
        says(page, "dialog .command", "^endoct compare")
        assert page.locator("dialog .command").inner_text() == (
            "endoct compare bore-1/endoscope bore-1/oct --output=results/bore-1"
        )
        page.click("dialog >> text=Run")
        page.wait_for_selector(".queue li.running progress", timeout=LONG_MS)
        page.wait_for_selector(".results tr[data-name='results/bore-1'] .level", timeout=LONG_MS)
        assert page.locator(".results .level").inner_text() in ("trusted", "doubted", "not aligned")
        page.click(".results tbody a")
        page.wait_for_selector(".pane[data-z-mm]", timeout=LONG_MS)
        assert page.locator(".verdict strong").inner_text()
        page.click(".above")
        page.wait_for_selector(".results tr[data-name='results/bore-1']", timeout=LONG_MS)


def test_the_file_that_a_browser_is_started_on_leads_to_the_page(
    chromium: Any, served: Served, desk: Desk, study: Path
):
    address = served.url.rstrip("/") + desk.open(study).address
    page = chromium.new_page()
    page.goto(desk.state.address_file(address).as_uri())
    page.wait_for_selector(".inputs tr[data-name]", timeout=LONG_MS)
    assert page.url == address
    page.close()


def test_a_run_is_cancelled_and_queued_again(chromium: Any, served: Served, desk: Desk, study: Path):
    with page_of(chromium, served, desk.open(study).address, ".queue") as watched:
        page = watched.page
        page.click("text=simulate…")
        says(page, "dialog .command", "^endoct simulate")
        page.click("dialog >> text=Run")
        page.wait_for_selector(".queue li.running", timeout=LONG_MS)
        page.click(".queue >> text=cancel")
        page.wait_for_selector(".queue li.cancelled", timeout=LONG_MS)
        assert not (study / "specimen-1").exists()
        page.click(".queue >> text=log")
        page.wait_for_selector(".queue pre", timeout=LONG_MS)
        assert "endoct simulate --output=specimen-1" in page.locator(".queue li code").inner_text()
        page.click(".queue >> text=again")
        page.wait_for_selector(".queue li:nth-child(2)", timeout=LONG_MS)
        page.click(".queue >> text=cancel")
        page.wait_for_selector(".queue li.cancelled:nth-child(1)", timeout=LONG_MS)
        assert page.locator(".queue li.cancelled").count() == 2
        page.click(".queue >> text=clear")
        page.wait_for_selector(".queue li", state="detached", timeout=LONG_MS)


def test_the_queue_is_in_the_order_in_which_it_runs_and_cuts_no_name(
    chromium: Any, served: Served, desk: Desk, study: Path
):
    output = "results/" + "/".join(["a folder with a rather long name"] * 3)
    states = {"1": "done", "2": "failed", "3": "running", "4": "waiting", "5": "waiting"}
    rest = {"command": "endoct unroll", "verb": "unroll", "folder": str(study), "seconds": 1, "stages": {}}
    with page_of(chromium, served, desk.open(study).address, ".queue") as watched:
        page = watched.page

        def queue(route: Any) -> None:
            runs = [{"name": k, "output": f"{output} {k}", "state": states[k], "last_line": ""} | rest for k in states]
            route.fulfill(json={"runs": runs})

        page.route("**/queue.json", queue)
        page.reload()
        page.wait_for_selector(".queue li:nth-child(5)", timeout=LONG_MS)
        rows = page.locator(".queue .output")
        assert [text[-1] for text in rows.all_inner_texts()] == ["3", "4", "5", "2", "1"]
        assert rows.evaluate_all("all => all.every(row => row.scrollWidth <= row.clientWidth && row.clientHeight > 30)")
        states["4"] = "done"
        page.wait_for_selector(".queue li:nth-child(3).done", timeout=LONG_MS)
        assert [text[-1] for text in rows.all_inner_texts()] == ["3", "5", "4", "2", "1"]
        assert page.locator(".queue h2 button").inner_text() == "clear what has ended"


def test_a_menu_has_no_word_twice(chromium: Any, served: Served, desk: Desk, study: Path):
    address = f"{desk.open(study).address}recording?name=bore-1/oct"
    with page_of(chromium, served, address, "#key-travel") as watched:
        page = watched.page
        first = page.locator("#key-travel option").first
        assert first.inner_text() == "not stated: out is taken"

        def cited(route: Any) -> None:
            sidecar = route.fetch().json()
            for field in sidecar["fields"]:
                field["cited"] = "in" if field["key"] == "travel" else field["cited"]
            route.fulfill(json=sidecar)

        page.route("**/sidecar.json*", cited)
        page.reload()
        says(page, "#key-travel option", "calibration")
        assert first.inner_text() == "not stated here: in is taken (from the calibration)"
        choices = page.locator("#key-travel option").all_inner_texts()
        assert len(choices) == len(set(choices)) == 4


def test_what_is_missing_stays_said_where_a_picture_takes_long_to_show(
    chromium: Any, served: Served, desk: Desk, study: Path
):
    address = f"{desk.open(study).address}recording?name=bore-1/oct"
    with page_of(chromium, served, address, "figure canvas") as watched:
        with watched.page.expect_response("**/preview") as answer:
            watched.page.reload()
        drawn = answer.value.json()
        page = watched.page.context.new_page()  # what its pictures take is not for the tests after this
        page.add_init_script("HTMLImageElement.prototype.decode = () => new Promise(done => setTimeout(done, 2500))")
        page.route("**/preview", lambda route: route.fulfill(json=drawn))
        page.goto(watched.page.url)
        page.wait_for_selector("figure canvas", timeout=LONG_MS)
        assert page.locator("[role=status]").inner_text() == "Nothing is missing. It is saved."
        page.close()


def test_what_is_wrong_is_said_while_it_is_entered(chromium: Any, served: Served, desk: Desk, study: Path):
    with page_of(chromium, served, desk.open(study).address, ".inputs tr[data-name]") as watched:
        page = watched.page
        page.click(".inputs tr[data-name='bore-1/oct'] button:has-text('unroll')")
        page.fill("dialog #field-output", "../elsewhere.zarr")
        says(page, "dialog .fault", "no path in the folder")
        assert page.locator("dialog >> text=Run").is_disabled()
        with answered_last_first(page, "**/command") as wait_for:
            for output in ("elsewhere.zarr", "../again.zarr"):
                page.fill("dialog #field-output", output)
                wait_for(output)
        says(page, "dialog .fault", "no path in the folder")
        page.wait_for_timeout(50)
        assert page.locator("dialog >> text=Run").is_disabled()
        page.fill("dialog #field-output", "elsewhere.zarr")
        says(page, "dialog .command", "elsewhere.zarr$")
        page.keyboard.press("Escape")
        page.wait_for_selector("dialog", state="detached")
        watched.errors[:] = [one for one in watched.errors if "409" not in one]  # Chromium notes the refusal


def test_nothing_is_entered_into_a_form_that_is_about_to_be_replaced(
    chromium: Any, served: Served, desk: Desk, study: Path
):
    address = f"{desk.open(study).address}recording?name=bore-1/oct"
    with page_of(chromium, served, address, "figure canvas") as watched:
        page = watched.page
        held = list[Any]()
        for asked in ("**/sidecar.json?*modality=*", "**/sidecar"):
            page.route(asked, lambda route: held.append(route))
        diameter, instrument = page.locator("#key-bore_diameter_mm"), page.get_by_label("which instrument recorded it")
        before, was = diameter.input_value(), instrument.input_value()

        def type_there(held_by_then: int) -> None:
            while len(held) < held_by_then:
                page.wait_for_timeout(20)
            diameter.evaluate("node => node.focus()")
            page.keyboard.type("9")

        others = instrument.locator("option").evaluate_all("all => all.map(option => option.value)")
        instrument.select_option(next(other for other in others if other != was))
        type_there(1)
        assert diameter.input_value() == before
        held[0].fulfill(status=409, body="that instrument did not record it")
        says(page, ".fault", "did not record it")
        assert instrument.input_value() == was
        page.wait_for_timeout(1000)
        says(page, ".fault", "did not record it")  # nothing is drawn that would hide it
        type_there(1)
        assert diameter.input_value() != before
        diameter.fill("2.75")
        says(page, ".desk [role=status]", "Not saved yet.$")
        page.click("button:text('Save')")
        type_there(2)
        assert diameter.input_value() == "2.75"
        held[1].continue_()
        says(page, ".desk [role=status]", "It is saved.$")
        assert diameter.input_value() == "2.75"
        assert keys_of(study / "bore-1" / "oct" / "acquisition.toml")["bore_diameter_mm"] == "2.75"
        watched.errors[:] = [one for one in watched.errors if "409" not in one]  # Chromium notes the refusal


def test_a_button_can_be_pressed_while_the_folder_is_looked_through_and_no_answer_ends_that(
    chromium: Any, served: Served, desk: Desk, study: Path
):
    with page_of(chromium, served, desk.open(study).address, ".inputs tr[data-name]") as watched:
        page = watched.page
        says(page, ".desk [role=status]", "^2$")
        answers = list[str]()
        answer = ["looking"]

        def found(route: Any) -> None:
            answers.append(answer[0])
            if answer[0] == "failed":
                route.fulfill(status=503, body="not just now")
            else:
                route.fulfill(json=route.fetch().json() | {"looking": answer[0] == "looking"})

        def answered(which: str) -> None:
            answer[0] = which
            before = answers.count(which)
            while answers.count(which) < before + 3 and which != "found":
                page.wait_for_timeout(50)

        page.route("**/found.json", found)
        page.click("text=look again")
        answered("looking")
        while not page.evaluate("[...document.images].every((each) => each.complete)"):  # they move what is below
            page.wait_for_timeout(50)
        page.hover(".inputs tr[data-name='bore-1/oct'] button:has-text('unroll')")
        page.mouse.down()
        answered("looking")
        page.mouse.up()
        page.wait_for_selector("dialog", timeout=LONG_MS)
        page.keyboard.press("Escape")
        answered("failed")
        says(page, ".fault", "not just now")
        answered("found")
        says(page, ".desk [role=status]", "^2$")
        assert page.locator(".fault").first.inner_text() == ""
        watched.errors[:] = [one for one in watched.errors if "503" not in one]  # Chromium notes the failures


def test_it_is_used_by_keyboard_alone(chromium: Any, served: Served, desk: Desk, study: Path):
    with page_of(chromium, served, f"{desk.root}/", ".folders li") as watched:
        page = watched.page
        page.keyboard.press("Tab")
        assert page.evaluate("document.activeElement.getAttribute('aria-label')") == "path of a folder"
        page.keyboard.press("Control+a")
        page.keyboard.type(str(study))
        page.keyboard.press("Enter")
        page.wait_for_selector(".inputs tr[data-name='bore-1/oct'] button", timeout=LONG_MS)
        for _ in range(40):
            page.keyboard.press("Tab")
            if page.evaluate("document.activeElement.textContent") == "unroll…":
                break
        page.keyboard.press("Enter")
        says(page, "dialog .command", "^endoct unroll")
        page.keyboard.press("Escape")
        page.wait_for_selector("dialog", state="detached")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_sticks_out(chromium: Any, served: Served, desk: Desk, study: Path, scheme: str):
    address = desk.open(study).address
    server = served.url.rstrip("/")
    pages = {
        address: ".inputs tr[data-name='bore-1/oct'] button",
        f"{address}recording?name=bore-1/oct": "figure canvas",
        f"{desk.root}/": ".folders li",
    }
    with page_of(chromium, served, address, ".inputs tr[data-name]", color_scheme=scheme) as watched:
        for path, ready in pages.items():
            watched.page.goto(server + path)
            watched.page.wait_for_selector(ready, timeout=LONG_MS)
            for width, height in ((1280, 800), (1024, 768), (390, 844)):
                watched.page.set_viewport_size({"width": width, "height": height})
                assert watched.page.evaluate("document.documentElement.scrollWidth") <= width, path


def dropped(watched: Watched, names: dict[str, str]) -> None:
    """Drop files with these contents on the page."""
    watched.page.evaluate(
        """names => {
          const dropped = new DataTransfer();
          for (const [name, content] of Object.entries(names)) dropped.items.add(new File([content], name));
          const drop = new DragEvent('drop', {dataTransfer: dropped, bubbles: true, cancelable: true});
          document.querySelector('.desk').dispatchEvent(drop);
        }""",
        names,
    )


def test_dropped_files_are_copied_and_looked_at(chromium: Any, served: Served, desk: Desk, study: Path):
    with page_of(chromium, served, desk.open(study).address, ".inputs tr[data-name]") as watched:
        with watched.page.expect_response(lambda response: "note.txt" in response.url):
            dropped(watched, {"frame_0.txt": "{}", "note.txt": "of mine"})
        says(watched.page, ".desk [role=status]", "^2$")
        assert (study / "note.txt").read_text() == "of mine"
        dropped(watched, {"note.txt": "another"})
        says(watched.page, ".fault", "exists already")
        assert (study / "note.txt").read_text() == "of mine"
        watched.errors[:] = [one for one in watched.errors if "409" not in one]


def test_a_sample_bore_is_queued_from_the_start_page(chromium: Any, served: Served, desk: Desk, tmp_path: Path):
    (tmp_path / "mine" / "sample").mkdir(parents=True)
    desk.state.queue.leave()  # queued, not run
    with page_of(chromium, served, f"{desk.root}/", ".folders") as watched:
        page = watched.page
        page.fill("input[type=text]", str(tmp_path / "mine"))
        page.click("text=Try it here")
        page.wait_for_selector(".queue li", timeout=LONG_MS)
        (run,) = desk.state.queue.runs()
        assert (run.arguments, run.folder) == (("demo", "--output=sample-2"), tmp_path / "mine")


def test_masks_that_were_drawn_are_compared_against(
    chromium: Any, served: Served, desk: Desk, study: Path, comparison: Path
):
    result = shutil.copytree(comparison, study / "results" / "x")
    (result / "masks" / "endoscope").mkdir(parents=True)
    (result / "masks" / "endoscope" / "me_1.png").write_bytes(b"")
    with page_of(chromium, served, f"{desk.open(study).address}at/results/x/", ".pane[data-z-mm]") as watched:
        page = watched.page
        page.keyboard.press("d")
        page.click("text=compare again, against this mask")
        says(page, "dialog .command", "^endoct compare")
        sides = "results/x/panoramas/endoscope.zarr results/x/panoramas/oct.zarr"
        truth = "--output=results/x-drawn --truth results/x/masks/endoscope/me_1.png"
        assert page.locator("dialog .command").inner_text() == f"endoct compare {sides} {truth}"
        assert all((study / side).is_dir() for side in sides.split())


def test_it_is_ended_from_the_start_page(chromium: Any, served: Served, desk: Desk, monkeypatch: pytest.MonkeyPatch):
    ended: list[bool] = []
    monkeypatch.setattr("endoct.workbench.desk.desk_app.end", lambda: ended.append(True))
    with page_of(chromium, served, f"{desk.root}/", ".folders") as watched:
        watched.page.click("text=Quit")
        says(watched.page, "main [role=status]", "has ended")
        assert ended == [True]


def test_results_are_sorted_filtered_grouped_and_noted_on(
    chromium: Any, served: Served, desk: Desk, study: Path, comparison: Path
):
    for bore, jaccard in (("bore-1", 0.5), ("bore-2", 0.9)):
        folder = shutil.copytree(comparison, study / "results" / bore / "run-1")
        result = json.loads((folder / "result.json").read_text())
        inputs = {f"bore-1/{side}/x": "0" * 64 for side in ("endoscope", "oct")} if bore == "bore-1" else {}
        (folder / "result.json").write_text(json.dumps({**result, "jaccard": jaccard, "inputs": inputs}))
    shutil.copytree(study / "bore-1", study / "bore-3")
    with page_of(chromium, served, desk.open(study).address, ".results tr[data-name]") as watched:
        page = watched.page
        rows = "document.querySelectorAll('.results tr[data-name]')"

        def listed(*wanted: str) -> None:
            named = f"[...{rows}].map((row) => row.dataset.name).join(' ')"
            page.wait_for_function(f"(wanted) => {named} === wanted", arg=" ".join(wanted))

        one, two = "results/bore-1/run-1", "results/bore-2/run-1"
        listed(one, two)
        page.get_by_role("button", name="Jaccard index").focus()
        page.keyboard.press("Enter")
        page.keyboard.press("Enter")
        assert page.locator("th[aria-sort=descending]").inner_text().startswith("Jaccard index")
        listed(two, one)
        page.fill("input[type=search]", "BORE-1 trusted")
        listed(one)
        page.fill("input[type=search]", "")
        page.get_by_label("groups").select_option("folder")
        listed(one, two)
        assert page.locator(".results .group").all_inner_texts() == ["results/bore-1", "results/bore-2"]
        page.get_by_label("groups").select_option("bore")
        page.locator(".results .group", has_text="bore-1").wait_for()  # of whose recordings it is
        page.click(f".results tr[data-name='{one}'] button")
        page.get_by_label("note", exact=True).fill("wet <b>")
        looked = count(1)  # what is listed is looked at again meanwhile: before recordings are found, and then
        with page.expect_response(lambda response: "results.json" in response.url and next(looked) == 2):
            dropped(watched, {"read me.txt": "of mine"})
        page.wait_for_timeout(50)  # and drawn
        page.click("dialog button:text('Save')")
        page.locator(f".results tr[data-name='{one}'] button", has_text="wet <b>").wait_for()
        page.wait_for_selector(".pairs button:text('compare 1 of 2 pairs')")  # the other has a result
        page.click("text=choose pairs")
        page.click(".pairs button:text('none')")
        assert page.locator(".pairs button").first.is_disabled()
        page.click(".pairs li:has-text('bore-1') input")
        page.wait_for_selector(".pairs button:text('compare 1 of 2 pairs'):enabled")
        page.click("button:text('summarise')")
        says(page, "dialog .command", f"^endoct summarise {two} {one} --output=results/summary$")
        page.click("dialog button:text('Close')")
