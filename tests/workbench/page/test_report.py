"""The report says what result.json says, shows what there is, and needs nothing but itself."""

import base64
import hashlib
import html
import io
import re
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mock_comparison import Kind, mock_pictures, write_comparison
from PIL import Image

from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError
from endoct.fusion.result import (
    CellScores,
    Consensus,
    Limits,
    MaskScores,
    PairScores,
    RaterPair,
    Raters,
    Result,
    Threshold,
)
from endoct.workbench.page.report import write_report
from endoct.workbench.report.pictures import load_pictures, save_pictures
from endoct.workbench.running.scheduler import scheduler

LARGEST_PAGE_BYTES = 15_000_000


class _Page(HTMLParser):
    """Collects what a page loads and what it says, but for what a "?" unfolds."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.source = page.read_text(encoding="utf-8")
        self.tags: list[str] = []
        self.images: list[str] = []
        self.links: list[str] = []
        self.said: list[str] = []
        self.inline: list[str] = []
        self.ids: list[str] = []
        self.is_explaining = False
        self.feed(self.source)
        self.text = re.sub(r"\s+", " ", " ".join(self.said))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        values = dict(attrs)
        self.is_explaining |= tag == "details" and values.get("class") == "explain"
        self.ids += [value for key, value in attrs if key == "id" and value]
        if tag == "img":
            self.images.append(values["src"] or "")
        self.inline += [key for key, _ in attrs if key == "style" or key.startswith("on")]
        self.links += [value for key, value in attrs if key in ("href", "src", "srcset", "data") and value]

    def handle_endtag(self, tag: str) -> None:
        self.is_explaining &= tag != "details"

    def handle_data(self, data: str) -> None:
        if not self.is_explaining and self.tags[-1:] not in (["style"], ["script"]):
            self.said.append(data)


Made = tuple[Path, Result, _Page]


@pytest.fixture(scope="module")
def make(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Made]:
    def made(*sides: Kind, **changed: Any) -> Made:
        folder = tmp_path_factory.mktemp("report") / "comparison"
        result = write_comparison(folder, *sides, **changed)
        return folder, result, _Page(write_report(folder))

    return made


@pytest.fixture(scope="module")
def aligned(make: Callable[..., Made]) -> Made:
    return make(Kind("endoscope", depth=False), Kind("oct"))


@pytest.fixture(scope="module")
def unaligned(make: Callable[..., Made]) -> Made:
    return make(Kind("endoscope", depth=False), Kind("oct"), aligned=False)


def headline(page: _Page) -> str:
    return page.text[: page.text.index("Where JavaScript is allowed")]


def section(page: _Page, name: str) -> str:
    """Return the source of a section."""
    start = page.source.index(f'<details class="section" id="{name}"')
    return page.source[start : page.source.find('<details class="section"', start + 1)]


def test_the_headline_says_what_the_result_says(aligned: Made) -> None:
    _, result, page = aligned
    said = headline(page)
    assert f"{result.jaccard:.3f}" in said
    assert f"{result.dice:.3f}" in said
    assert f"Jaccard index on the common grid {result.jaccard:.3f} 95 % interval" in said
    assert f"Jaccard index on the rows of oct {0.8765:.3f} not interpolated" in said
    assert "Jaccard index by Li's threshold alone 0.432 on the common grid, 95 % interval 0.38 to 0.48" in said
    assert "by Li's threshold alone, on the rows of oct" not in said
    assert "endoscope and oct, by Li's threshold alone, on the rows of oct 0.457" in page.text
    assert "Aligned with confidence 0.63 (correlation 0.93, 3.1 times the runner-up)" in said
    # the answer comes first, how it came about last; a number is named for what it is
    assert said.index(f"Aligned and trusted. Jaccard {result.jaccard:.2f} (") < said.index("Aligned with confidence")
    assert said.index("Aligned with confidence") < said.index("Jaccard index on the common grid")
    assert "turned by 85.94° and shifted by −0.432 mm" in said
    assert "scaled by 1.0123; mirrored in θ." in said
    assert "94.3%" in said
    assert "60 × 256 samples (z × θ), 50 µm along the bore" in said
    assert "Cells of endoscope: darkness <capped>, above 0.412." in said


def test_an_unaligned_comparison_says_so_and_shows_no_score(unaligned: Made) -> None:
    folder, _, page = unaligned
    assert "Not aligned: the two sides could not be brought onto each other." in headline(page)
    assert "The best place is only 1.1 times as good as the runner-up. Without an alignment" in headline(page)
    stated, _, _ = page.text.rpartition(" Words ")  # which explains all of them
    assert stated
    assert "Jaccard" not in stated
    assert "Dice" not in stated
    shown = {path.stem for path in (folder / "figures").iterdir()}
    assert shown >= {"panoramas", "masks", "depth-oct", "frames-oct", "frames-endoscope", "quality-oct"}
    assert "alignment" not in shown


def test_the_page_needs_no_other_file(aligned: Made) -> None:
    _, _, page = aligned
    assert {"iframe", "object", "base", "form", "embed"}.isdisjoint(page.tags)
    assert page.tags.count("link") == 1  # the icon, empty
    assert all(link.startswith(("data:", "#")) for link in page.links)
    style = page.source[page.source.index("<style>") : page.source.index("</style>")]
    assert "url(" not in style
    assert "@import" not in style
    assert len(page.source.encode()) < LARGEST_PAGE_BYTES


def test_everything_is_there_once_and_can_be_read_without_the_program(aligned: Made) -> None:
    _, _, page = aligned
    assert len(page.ids) == len(set(page.ids))
    links = [link[1:] for link in page.links if link.startswith("#")]
    assert set(links) <= set(page.ids)
    opened = re.findall(r'<details class="section" id="([^"]*)" open>', page.source)
    assert opened == [link for k, link in enumerate(links) if link not in links[:k]]  # the table of contents
    assert {"panoramas", "frames", "numbers", "sides", "notes", "quality-oct", "words", "provenance"} <= set(opened)
    assert page.source.count("Alignment of oct to endoscope") == 1
    assert page.text.count("specimen/oct/pullback.tif") == 1


def test_every_figure_is_embedded_and_lies_beside_the_page(aligned: Made) -> None:
    folder, _, page = aligned
    files = list((folder / "figures").glob("*.png"))
    assert {path.stem for path in files} == {
        "panoramas", "masks", "alignment", "depth-oct", "frames-endoscope", "frames-oct",
        "quality-endoscope", "quality-oct", "numbers-endoscope", "numbers-oct",
    }  # fmt: skip
    assert len(page.images) == len(files)
    assert set(page.ids) >= {f"figure-{path.stem}" for path in files}
    for source in page.images:
        image = Image.open(io.BytesIO(base64.b64decode(source.partition(",")[2])))
        image.load()
        assert np.asarray(image).std() > 1
    for path in files:
        with Image.open(path) as image:
            assert image.size[0] > 800
            assert image.info["dpi"] == pytest.approx((250, 250), abs=0.1)
            pixels = np.asarray(image)
        for edge in (pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]):
            assert (edge == 255).all(), f"{path.name} is cut off"


DOUBTS = (
    Doubt("scale-at-limit", "The scale ended at 1.050 <of its search>.", value=1.05, unit="1", expected=(0.95, 1.05)),
    Doubt("wall-far-from-nominal", "The wall lies 0.30 mm behind the nominal bore.", side="oct", value=3.1, unit="mm"),
)


def test_doubts_head_the_report_in_full_and_once(make: Callable[..., Made]) -> None:
    _, _, page = make(Kind("endoscope", depth=False), Kind("oct"), doubts=DOUBTS)
    said = headline(page)
    assert "2 doubts. Aligned." in said
    assert 'class="verdict doubted"' in page.source
    assert 'class="verdict trusted"' not in page.source
    for doubt in DOUBTS:
        assert page.text.count(doubt.what) == 1
        assert said.index(doubt.what) < said.index("with confidence 0.63")
    assert "oct: The wall lies" in said
    assert said.index(DOUBTS[0].code) < said.index(DOUBTS[1].what)


def test_doubts_about_a_side_head_the_report_of_what_is_not_aligned(make: Callable[..., Made]) -> None:
    _, _, page = make(Kind("endoscope", depth=False), Kind("oct"), aligned=False, doubts=DOUBTS[1:])
    assert headline(page).index("Not aligned") < headline(page).index(DOUBTS[1].what)


def test_notes_are_listed_once_and_flagged_frames_in_a_table(aligned: Made) -> None:
    _, _, page = aligned
    assert '<a href="#notes">1 note</a>' in page.source
    assert page.text.count("Depth rows 92–93 hold fixed lines & were interpolated.") == 1
    assert "Depth rows 92–93" in section(page, "notes")
    flagged = re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", section(page, "quality-oct")))
    assert "bridged 3 of 15 3, 8–9 0.60, 1.60–1.80 mm" in flagged
    assert "pair" not in flagged[: flagged.index("All that was measured")]


def test_numbers_with_a_usual_range_are_in_view_and_all_others_folded_away(aligned: Made) -> None:
    source = section(aligned[2], "quality-endoscope")
    opened, folded = source.index("<details>"), source.index("</details>")
    shown, hidden = source.index('id="figure-quality-endoscope"'), source.index('id="figure-numbers-endoscope"')
    assert source.index('<div class="printed">') < shown < opened < hidden < folded
    rows = re.sub(r"<[^>]+>", " ", source[opened:folded])
    assert re.search(r"residual_mm\s+misfit of the face\s+0 to 0.0045 mm\s+0.00\d+ to 0.00\d+ mm", rows)
    assert re.search(r"signal\s+signal\s+at least 12 dB\s+20 dB", rows)
    assert re.search(r"phase_rad\s+phase\s+–\s+−?[\d.]+ to [\d.]+°", rows)


def test_the_caption_of_single_frames_says_what_is_what(aligned: Made) -> None:
    _, _, page = aligned
    assert "Drawn in: outer face (orange). Lines: the sheath." in page.text


def test_differences_say_of_what(make: Callable[..., Made]) -> None:
    limits = Limits(pairs=4, bias=-0.018, low=-0.194, high=0.158)
    cells = CellScores(of_reference=7, of_other=5, matched=5)
    _, _, page = make(Kind("endoscope", depth=False), Kind("oct"), scores=PairScores(area_mm2=limits, cells=cells))
    assert "Cells counted endoscope 7, oct 5" in page.text
    assert "oct − endoscope: −0.018 mm² (95 % within −0.194 to 0.158, 4 cells)" in page.text


def test_two_of_one_modality_and_nothing_to_score(make: Callable[..., Made]) -> None:
    _, _, page = make(Kind("oct-1"), Kind("oct-2"), jaccard=None, dice=None, scores=None)
    assert "depth-oct-1.png" in page.text
    assert "depth-oct-2.png" in page.text


def test_sides_without_depth_or_drawn_by_hand_are_shown(make: Callable[..., Made]) -> None:
    folder, result, page = make(
        Kind("mask", depth=False, drawn=True),
        Kind("endoscope", depth=False),
        truth={"truth/cells.png": {"endoscope": MaskScores(jaccard=0.8125, dice=0.8965, both_mm2=1.0)}},
    )
    shown = {path.stem for path in (folder / "figures").iterdir()}
    assert {"panoramas", "masks", "alignment", "quality-endoscope"} <= shown
    assert not any(name.startswith("depth") or name.endswith("-mask") for name in shown)
    assert "Jaccard index of endoscope against cells.png" in page.text
    assert "0.812" in page.text
    assert f"{result.jaccard:.3f}" in page.text


def test_texts_are_escaped(aligned: Made) -> None:
    _, _, page = aligned
    assert "<script>alert(1)</script>" in page.text
    assert html.escape("<script>alert(1)</script>") in page.source


def test_the_page_may_load_nothing_and_run_its_own_programs_only(aligned: Made) -> None:
    _, _, page = aligned
    policy, referrer = (re.search(rf'<meta {name}" content="([^"]*)">', page.source) for name in (
        'http-equiv="Content-Security-Policy', 'name="referrer'
    ))  # fmt: skip
    assert policy is not None
    assert referrer is not None
    assert referrer[1] == "no-referrer"
    programs = re.findall(r"<script>(.*?)</script>", page.source, re.DOTALL)
    style = _only(r"<style>(.*?)</style>", page.source)
    cylinder, program = programs
    assert "three.js" in cylinder.partition("\n")[0]
    assert "OpenSeadragon" in program.partition("\n")[0]
    assert html.unescape(policy[1]).split("; ") == [
        "default-src 'none'",
        " ".join(["script-src", *(f"'{_digest(one)}'" for one in programs)]),
        f"style-src '{_digest(style)}' '{_digest('')}'",
        "img-src data: blob:",
        "base-uri 'none'",
        "form-action 'none'",
    ]
    assert page.source.index("Content-Security-Policy") < page.source.index("<title>")
    assert page.tags.count("script") == 4  # the programs, and their data, which no browser runs
    assert page.source.count('<script type="application/json" id="frozen">') == 1
    assert page.source.count('<script type="application/json" id="glossary">') == 1
    assert not page.inline


def _only(pattern: str, source: str) -> str:
    (found,) = re.findall(pattern, source, re.DOTALL)
    return str(found)


def _digest(text: str) -> str:
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"


def raters_called(name: str) -> Raters:
    scores = {
        "jaccard": 0.8,
        "dice": 0.9,
        "boundary_mean_mm": None,
        "boundary_p95_mm": None,
        "boundary_within_share": None,
    }
    pair = RaterPair(first=(name, name), second=(name, name), within=False, **scores)
    agreed = Consensus(method=name, sides={"oct": MaskScores(jaccard=0.8, dice=0.9)})
    return Raters(pairs=(pair,), consensus={"majority": agreed, name: agreed})


def test_no_text_of_a_file_leaves_its_place(make: Callable[..., Made]) -> None:
    hostile = "</style></title>\"'><img src=x onerror=alert(1)><script>alert(1)</script>&\x1b[31m\u202e\udce9"
    _, _, page = make(
        Kind("endoscope", depth=False),
        Kind("oct"),
        doubts=(Doubt("odd", hostile, side=hostile),),
        notes={"endoscope": (hostile,), "oct": ()},
        inputs={hostile: hostile},
        versions={hostile: hostile, "endoct": hostile},
        seconds={hostile: 1.0},
        parameters={hostile: {hostile: hostile}},
        threshold={"endoscope": Threshold(value=0.5, unit=hostile, of=hostile)},
        polarity={"oct": hostile},
        truth={f"truth/{hostile}.png": {"oct": MaskScores(jaccard=0.8, dice=0.9)}},
        raters=raters_called(hostile),
    )
    assert {"iframe", "object", "base"}.isdisjoint(page.tags)
    assert (page.tags.count("script"), page.tags.count("link")) == (4, 1)
    assert all(image.startswith(("data:image/png;base64,", "data:image/jpeg;base64,")) for image in page.images)
    assert not page.inline
    assert page.text.count("<script>alert(1)</script>") >= 11
    before, after = page.source.split("<script type", 1)
    assert before.replace("\n", "").isprintable()
    assert after.partition("</script>")[0].isascii()
    assert r"\x1b[31m\u202e\udce9" in page.text


def test_only_figures_and_page_are_written_and_again_the_same(aligned: Made) -> None:
    folder, _, _ = aligned

    def digests() -> dict[str, str]:
        return {
            str(path.relative_to(folder.parent)): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in folder.parent.rglob("*")
            if path.is_file()
        }

    first = digests()
    with scheduler() as second:  # that draws half of the figures
        write_report(folder, second)
    assert digests() == first
    written = {name.split("/")[1] for name in first}
    assert written == {"comparison.zarr", "panoramas", "pictures", "result.json", "figures", "report.html"}


def test_what_is_no_comparison_is_refused(tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match="no comparison"):
        write_report(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_pictures_are_read_as_they_were_written(tmp_path: Path) -> None:
    written = mock_pictures()
    save_pictures(tmp_path, "oct-1", "0012", written)
    save_pictures(tmp_path, "oct-1", "0003", written[:1])
    read = load_pictures(tmp_path)
    assert list(read) == ["oct-1"]
    assert list(read["oct-1"]) == [3, 12]
    for before, after in zip(written, read["oct-1"][12], strict=True):
        assert (after.name, after.title, after.x_label, after.y_label) == (
            before.name,
            before.title,
            before.x_label,
            before.y_label,
        )
        assert (after.x_extent, after.y_extent) == (before.x_extent, before.y_extent)
        np.testing.assert_array_equal(after.image, before.image)
        assert list(after.curves) == list(before.curves)
        for label, curve in before.curves.items():
            np.testing.assert_array_equal(after.curves[label], curve)
